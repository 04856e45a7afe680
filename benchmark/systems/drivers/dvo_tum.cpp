// DVO's dense tracking with its default configuration, frame to frame, on a staged sequence. Build dvo_core of
// github.com/tum-vision/dvo_slam as a library in DVO (its sources need Sophus and TBB, but no ROS), then:
// g++ -O2 -msse4 dvo_tum.cpp -o dvo_tum -IDVO/include -ISOPHUS -I/usr/include/eigen3 -I/usr/include/opencv4 -LDVO/lib -ldvo_core -lopencv_core -lopencv_imgproc -lopencv_imgcodecs -ltbb
// After a frame without a motion, the next frame is tracked against the last frame that had one.
#include <dvo/core/surface_pyramid.h>
#include <dvo/dense_tracking.h>

#include <iostream>
#include <memory>

#include "sequence.hpp"

static void run(const Arguments& given) {
  Sequence sequence(given);
  Trajectory trajectory(given.out);
  const dvo::DenseTracker::Config config = dvo::DenseTracker::getDefaultConfig();
  dvo::DenseTracker tracker(config);
  std::unique_ptr<dvo::core::RgbdCameraPyramid> camera;
  dvo::core::RgbdImagePyramidPtr reference;
  Eigen::Affine3d pose = Eigen::Affine3d::Identity(), motion = pose;
  for (Pair pair; sequence.next(pair);) {
    if (!camera) {
      const auto K = dvo::core::IntrinsicMatrix::create(given.fx, given.fy, given.cx, given.cy);
      camera.reset(new dvo::core::RgbdCameraPyramid(pair.grey.cols, pair.grey.rows, K));
      camera->build(config.getNumLevels());
    }
    cv::Mat grey, metres;
    pair.grey.convertTo(grey, CV_32F);
    dvo::core::SurfacePyramid::convertRawDepthImageSse(pair.depth, metres, 1.0 / given.units);
    const dvo::core::RgbdImagePyramidPtr current = camera->create(grey, metres);
    if (reference) {
      dvo::DenseTracker::Result result;
      result.setIdentity();
      if (config.UseInitialEstimate) result.Transformation = motion;
      if (!tracker.match(*reference, *current, result) || result.isNaN()) continue;
      motion = result.Transformation;
      pose = pose * motion;
    }
    reference = current;
    trajectory.add(pair.stamp, pose.matrix());
  }
}

int main(int count, char** words) {
  try {
    run(Arguments(count, words));
  } catch (const std::exception& error) {
    std::cerr << "dvo_tum: " << error.what() << '\n';
    return 3;
  }
  return 0;
}
