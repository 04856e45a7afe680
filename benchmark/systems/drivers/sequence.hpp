// Shared by the drivers: reads the list and images of a staged sequence, and writes lines of a TUM trajectory.
#pragma once
#include <Eigen/Geometry>
#include <fstream>
#include <iomanip>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

struct Arguments {  // STAGE ASSOCIATIONS FX FY CX CY UNITS OUT
  std::string stage, associations, out;
  double fx, fy, cx, cy, units;
  Arguments(int count, char** words) {
    if (count != 9) throw std::runtime_error("expected STAGE ASSOCIATIONS FX FY CX CY UNITS OUT");
    stage = words[1], associations = words[2], out = words[8];
    fx = std::stod(words[3]), fy = std::stod(words[4]), cx = std::stod(words[5]), cy = std::stod(words[6]);
    units = std::stod(words[7]);
  }
};

struct Pair {
  std::string stamp;
  cv::Mat grey, depth;  // 8 bits; 16 bits in the units of the sequence, 0 = missing
};

class Sequence {
 public:
  explicit Sequence(const Arguments& given) : stage_(given.stage + "/"), list_(given.associations) {
    if (!list_) throw std::runtime_error("cannot read " + given.associations);
  }
  bool next(Pair& pair) {
    std::string rgb, depth, again;
    if (!(list_ >> pair.stamp >> rgb >> again >> depth)) return false;
    pair.grey = cv::imread(stage_ + rgb, cv::IMREAD_GRAYSCALE);
    pair.depth = cv::imread(stage_ + depth, cv::IMREAD_UNCHANGED);
    if (pair.grey.empty() || pair.depth.type() != CV_16U) throw std::runtime_error("cannot read " + rgb + " or " + depth);
    return true;
  }

 private:
  std::string stage_;
  std::ifstream list_;
};

class Trajectory {
 public:
  explicit Trajectory(const std::string& path) : file_(path) { file_ << std::fixed << std::setprecision(9); }
  void add(const std::string& stamp, const Eigen::Matrix4d& pose) {  // camera to world
    const Eigen::Quaterniond q(Eigen::Matrix3d(pose.topLeftCorner<3, 3>()));
    file_ << stamp << ' ' << pose(0, 3) << ' ' << pose(1, 3) << ' ' << pose(2, 3) << ' ' << q.x() << ' ' << q.y() << ' '
          << q.z() << ' ' << q.w() << '\n';
  }

 private:
  std::ofstream file_;
};
