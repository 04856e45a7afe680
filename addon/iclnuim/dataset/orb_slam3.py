"""Settings file of ORB-SLAM3 (YAML as OpenCV reads it) for an RGB-D sequence in TUM form."""

from __future__ import annotations

from ..geometry.camera import PinholeCamera

#: Any baseline serves a depth camera: it only sets, with ThDepth, how far points count as near (3 m here).
_BASELINE_M, _NEAR_M = 0.08, 3.0


def orb_slam3_settings(camera: PinholeCamera, depth_units_per_metre: float, rate_hz: float = 30.0) -> str:
    """For `rgbd_tum VOCABULARY THIS_FILE SEQUENCE SEQUENCE/associations.txt`."""
    c = camera
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
Camera.fps: {round(rate_hz)}
# as in ORB-SLAM3's own settings for TUM sequences
Camera.RGB: 1

Stereo.ThDepth: {_NEAR_M / _BASELINE_M:.6f}
Stereo.b: {_BASELINE_M:.6f}
RGBD.DepthMapFactor: {float(depth_units_per_metre)!r}

ORBextractor.nFeatures: 1000
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
