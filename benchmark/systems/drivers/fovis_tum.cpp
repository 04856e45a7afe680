// FOVIS with its default options on a staged sequence. Install libfovis (github.com/fovis/fovis) in FOVIS, then:
// g++ -O2 fovis_tum.cpp -o fovis_tum -IFOVIS/include -I/usr/include/eigen3 -I/usr/include/opencv4 -LFOVIS/lib -Wl,-rpath,FOVIS/lib -lfovis -lopencv_core -lopencv_imgcodecs
// Add -march=native only if libfovis was built with it. Frames without a motion are left out.
#include <fovis/fovis.hpp>
#include <iostream>
#include <limits>
#include <memory>

#include "sequence.hpp"

static void run(const Arguments& given) {
  Sequence sequence(given);
  Trajectory trajectory(given.out);
  std::unique_ptr<fovis::Rectification> rectification;
  std::unique_ptr<fovis::DepthImage> depth;
  std::unique_ptr<fovis::VisualOdometry> odometry;
  for (Pair pair; sequence.next(pair);) {
    const bool first = !odometry;
    if (first) {
      fovis::CameraIntrinsicsParameters camera;
      camera.width = pair.grey.cols, camera.height = pair.grey.rows;
      camera.fx = given.fx, camera.fy = given.fy, camera.cx = given.cx, camera.cy = given.cy;
      rectification.reset(new fovis::Rectification(camera));
      depth.reset(new fovis::DepthImage(camera, camera.width, camera.height));
      odometry.reset(new fovis::VisualOdometry(rectification.get(), fovis::VisualOdometry::getDefaultOptions()));
    }
    cv::Mat metres;
    pair.depth.convertTo(metres, CV_32F, 1.0 / given.units);
    metres.setTo(std::numeric_limits<float>::quiet_NaN(), pair.depth == 0);
    depth->setDepthImage(metres.ptr<float>());
    odometry->processFrame(pair.grey.data, depth.get());
    if (first || odometry->getMotionEstimateStatus() == fovis::SUCCESS)
      trajectory.add(pair.stamp, odometry->getPose().matrix());
  }
}

int main(int count, char** words) {
  try {
    run(Arguments(count, words));
  } catch (const std::exception& error) {
    std::cerr << "fovis_tum: " << error.what() << '\n';
    return 3;
  }
  return 0;
}
