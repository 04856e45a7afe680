"""Settings files of SLAM systems for a sequence: its camera, frame rate and depth units. All other
values are those of each system's own files for TUM sequences.

A new settings file is a function and a line in SLAM_SETTINGS.
"""

from collections.abc import Callable

from ..geometry.camera import PinholeCamera
from ..sensor.imu import ImuStream
from ..sensor.imu_noise import estimator_figures

#: As in ORB-SLAM's files for TUM sequences: focal length times baseline (px m) in images of 640
#: columns, and the baselines up to which points are near. The baseline of a depth camera is
#: arbitrary: both only set this distance (3.3 m for the benchmark's camera). Beyond it, a keyframe
#: takes only its 100 nearest points, many of which are errors of noisy depth at edges.
_FOCAL_BASELINE = 40.0
_NEAR_BASELINES = 40.0
_ORB = """ORBextractor.nFeatures: 1000
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7

Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""


def orb_slam3(c: PinholeCamera, rate_hz: float, units: float) -> str:
    """YAML in OpenCV's format, for `rgbd_tum VOCABULARY THIS_FILE SEQUENCE
    SEQUENCE/associations.txt`.
    """
    return f"""%YAML:1.0
# ORB-SLAM3, RGB-D: rgbd_tum VOCABULARY orb_slam3.yaml SEQUENCE SEQUENCE/associations.txt
File.version: "1.0"

Camera.type: "PinHole"
Camera1.fx: {float(c.fx)!r}
Camera1.fy: {float(c.fy)!r}
Camera1.cx: {float(c.cx)!r}
Camera1.cy: {float(c.cy)!r}
Camera1.k1: 0.0
Camera1.k2: 0.0
Camera1.p1: 0.0
Camera1.p2: 0.0
Camera.width: {c.width}
Camera.height: {c.height}
Camera.fps: {_whole(rate_hz)}
# as in ORB-SLAM3's own settings for TUM sequences
Camera.RGB: 1

Stereo.ThDepth: {_NEAR_BASELINES!r}
Stereo.b: {_focal_baseline(c) / c.fx:.6f}
RGBD.DepthMapFactor: {float(units)!r}

{_ORB}"""


def orb_slam3_imu(imu: ImuStream) -> str:
    """The lines of the IMU for the end of ORB-SLAM3's YAML. Its noise is never 0 there."""
    figures = estimator_figures(imu)
    numbers = [repr(round(value, 9) + 0.0) for value in imu.T_imu_camera.matrix.ravel().tolist()]
    rows = ",\n          ".join(", ".join(numbers[k : k + 4]) for k in range(0, 16, 4))
    return f"""
# modes with an IMU; the readings are in imu.csv: nanoseconds, rotation rate, specific force
IMU.T_b_c1: !!opencv-matrix
   rows: 4
   cols: 4
   dt: f
   data: [{rows}]
IMU.NoiseGyro: {figures["gyroscope_noise_density"]:.9e}
IMU.NoiseAcc: {figures["accelerometer_noise_density"]:.9e}
IMU.GyroWalk: {figures["gyroscope_random_walk"]:.9e}
IMU.AccWalk: {figures["accelerometer_random_walk"]:.9e}
IMU.Frequency: {float(imu.rate_hz)!r}
"""


def orb_slam2(c: PinholeCamera, rate_hz: float, units: float) -> str:
    """YAML in OpenCV's format; ORB-SLAM3 reads this older format too."""
    return f"""%YAML:1.0
# ORB-SLAM2, RGB-D: rgbd_tum VOCABULARY orb_slam2.yaml SEQUENCE SEQUENCE/associations.txt
Camera.fx: {float(c.fx)!r}
Camera.fy: {float(c.fy)!r}
Camera.cx: {float(c.cx)!r}
Camera.cy: {float(c.cy)!r}
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: {c.width}
Camera.height: {c.height}
Camera.fps: {float(_whole(rate_hz))}
Camera.bf: {_focal_baseline(c):.6f}
Camera.RGB: 1
ThDepth: {_NEAR_BASELINES!r}
DepthMapFactor: {float(units)!r}

{_ORB}"""


def stella_vslam(c: PinholeCamera, rate_hz: float, units: float) -> str:
    """YAML for `run_tum_rgbd_slam -v VOCABULARY -c THIS_FILE -d SEQUENCE`."""
    return f"""\
# stella_vslam, RGB-D: run_tum_rgbd_slam -v VOCABULARY -c stella_vslam.yaml -d SEQUENCE
Camera:
  name: "RGB-D"
  setup: "RGBD"
  model: "perspective"
  fx: {float(c.fx)!r}
  fy: {float(c.fy)!r}
  cx: {float(c.cx)!r}
  cy: {float(c.cy)!r}
  k1: 0.0
  k2: 0.0
  p1: 0.0
  p2: 0.0
  k3: 0.0
  fps: {float(_whole(rate_hz))}
  cols: {c.width}
  rows: {c.height}
  focal_x_baseline: {_focal_baseline(c):.6f}
  depth_threshold: {_NEAR_BASELINES!r}
  color_order: "RGB"

Preprocessing:
  depthmap_factor: {float(units)!r}

Feature:
  name: "ORB"
  scale_factor: 1.2
  num_levels: 8
  ini_fast_threshold: 20
  min_fast_threshold: 7
"""


def camera_info(c: PinholeCamera, rate_hz: float, units: float) -> str:
    """The camera_info YAML of ROS, with RTAB-Map's local_transform (from x forward, z up to the
    camera's axes). It has no rate or units.
    """
    fx, fy, cx, cy = (float(v) for v in (c.fx, c.fy, c.cx, c.cy))
    return f"""%YAML:1.0
---
camera_name: rtabmap_calib
image_width: {c.width}
image_height: {c.height}
camera_matrix:
   rows: 3
   cols: 3
   data: [ {fx!r}, 0.0, {cx!r}, 0.0, {fy!r}, {cy!r}, 0.0, 0.0, 1.0 ]
distortion_model: plumb_bob
distortion_coefficients:
   rows: 1
   cols: 5
   data: [ 0.0, 0.0, 0.0, 0.0, 0.0 ]
rectification_matrix:
   rows: 3
   cols: 3
   data: [ 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0 ]
projection_matrix:
   rows: 3
   cols: 4
   data: [ {fx!r}, 0.0, {cx!r}, 0.0, 0.0, {fy!r}, {cy!r}, 0.0, 0.0, 0.0, 1.0, 0.0 ]
local_transform:
   rows: 3
   cols: 4
   data: [ 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0 ]
"""


def _focal_baseline(c: PinholeCamera) -> float:
    return _FOCAL_BASELINE * c.width / 640


def _whole(rate_hz: float) -> int:
    return max(1, round(rate_hz))


#: name -> function of (camera, frames per second, depth units per metre) that returns the file's
#: text
SLAM_SETTINGS: dict[str, Callable[[PinholeCamera, float, float], str]] = {
    "orb_slam3": orb_slam3,
    "orb_slam2": orb_slam2,
    "stella_vslam": stella_vslam,
    "camera_info": camera_info,
}

#: name -> function of the readings of an IMU that returns the lines for the end of the file
IMU_SETTINGS: dict[str, Callable[[ImuStream], str]] = {"orb_slam3": orb_slam3_imu}
