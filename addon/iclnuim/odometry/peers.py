"""Other people's odometers behind our protocol: OpenCV's (contrib) and Open3D's, as their packages ship them."""

from __future__ import annotations

import time
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import WorkError
from ..geometry.camera import PinholeCamera
from .protocol import Frame, Result, failure

OPENCV = {"rgbd": "RgbdOdometry", "icp": "ICPOdometry", "rgbd-icp": "RgbdICPOdometry"}
OPEN3D = {"plane": "PointToPlane", "intensity": "Intensity"}
NAMES = tuple(f"peer:opencv-{n}" for n in OPENCV) + tuple(f"peer:open3d-{n}" for n in OPEN3D)


class OpencvPeer:
    """cv2.rgbd with its defaults; a frame's pyramids are kept for the two pairs that it is in. No guess is used."""

    reference = "frame"

    def __init__(self, name: str) -> None:
        import cv2

        if not hasattr(cv2, "rgbd"):
            raise WorkError(f"{name} needs cv2.rgbd; try: pip install 'opencv-contrib-python-headless==4.11.*'")
        self.name, self.cv2, self.odometry, self.camera = name, cv2, None, None
        self.kind = OPENCV[name.removeprefix("peer:opencv-")]

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        if camera != self.camera:
            self.odometry, self.camera = getattr(self.cv2.rgbd, self.kind).create(camera.K.astype(np.float32)), camera
        depth = np.where(frame.depth_z_m > 0, frame.depth_z_m, np.float32(np.nan))
        mask = (frame.depth_z_m > 0).astype(np.uint8) * 255
        return self.cv2.rgbd.OdometryFrame.create(np.clip(frame.grey + 0.5, 0, 255).astype(np.uint8), depth, mask)

    def align(self, reference: Any, current: Any, guess: np.ndarray) -> Result:
        started = time.perf_counter()
        found, T = self.odometry.compute2(current, reference)
        if not found or T is None:
            return failure("peer: no motion found")
        return Result(np.asarray(T, float), True, seconds=time.perf_counter() - started)


class Open3dPeer:
    """The multi-scale RGB-D odometer of Open3D's tensor pipelines, with its defaults. No guess is used."""

    reference = "frame"

    def __init__(self, name: str) -> None:
        try:
            import open3d
        except ImportError:
            raise WorkError(f"{name} needs open3d; try: pip install open3d-cpu") from None
        self.name, self.o3d = name, open3d
        self.odometry: ModuleType = open3d.t.pipelines.odometry
        self.method = getattr(self.odometry.Method, OPEN3D[name.removeprefix("peer:open3d-")])

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        image = self.o3d.t.geometry.Image
        grey = np.repeat(np.clip(frame.grey + 0.5, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        self.K = self.o3d.core.Tensor(camera.K)
        return self.o3d.t.geometry.RGBDImage(image(grey), image(np.ascontiguousarray(frame.depth_z_m[..., None])))

    def align(self, reference: Any, current: Any, guess: np.ndarray) -> Result:
        started = time.perf_counter()
        try:
            found = self.odometry.rgbd_odometry_multi_scale(
                current, reference, self.K, self.o3d.core.Tensor(np.eye(4)), 1.0, 13.0, method=self.method
            )
        except RuntimeError as error:
            return failure(f"peer: {error}".splitlines()[0])
        T = found.transformation.numpy()
        return Result(T, True, residual=found.inlier_rmse, inliers=found.fitness, seconds=time.perf_counter() - started)
