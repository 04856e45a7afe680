"""Adapters to third-party odometers: OpenCV's (contrib) and Open3D's, with the default settings of
their packages.
"""

from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from .protocol import Frame, OdometryResult, failure


class Baseline:
    """The guess is not used: an alignment starts from `start`, by default no motion."""

    reference = "frame"
    start = SE3.identity()


class OpencvOdometer(Baseline):
    """cv2.rgbd.

    The pyramids of a frame are computed once and used for both pairs that contain it.
    """

    def __init__(self, name: str, method: str) -> None:
        import cv2

        self.name, self._rgbd = name, cv2.rgbd  # only opencv-contrib has this module
        self.reads_depth_alone = method == "ICPOdometry"
        self._create: Any = getattr(self._rgbd, method).create
        self._odometry: Any = None
        self._camera: PinholeCamera | None = None

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        if camera != self._camera:
            self._odometry, self._camera = self._create(camera.K.astype(np.float32)), camera
        depth = np.where(frame.depth_z_m > 0, frame.depth_z_m, np.float32(np.nan))
        mask = (frame.depth_z_m > 0).astype(np.uint8) * 255
        return self._rgbd.OdometryFrame.create(_bytes(frame.grey), depth, mask)

    def align(self, reference: Any, current: Any, guess: SE3) -> OdometryResult:
        found, T = self._odometry.compute2(current, reference, initRt=self.start.matrix)
        if not found or T is None:
            return failure("baseline: no motion found")
        return _result(T)


class Open3dOdometer(Baseline):
    """The multi-scale RGB-D odometry of Open3D's tensor pipelines."""

    def __init__(self, name: str, method: str) -> None:
        import open3d

        self.name = name
        self.reads_depth_alone = method == "PointToPlane"
        self._o3d: Any = open3d
        self._method = getattr(open3d.t.pipelines.odometry.Method, method)

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Any:
        image = self._o3d.t.geometry.Image
        grey = np.repeat(_bytes(frame.grey)[..., None], 3, axis=2)
        self._K = self._o3d.core.Tensor(camera.K)
        return self._o3d.t.geometry.RGBDImage(
            image(grey), image(np.ascontiguousarray(frame.depth_z_m[..., None]))
        )

    def align(self, reference: Any, current: Any, guess: SE3) -> OdometryResult:
        solver, start = (
            self._o3d.t.pipelines.odometry.rgbd_odometry_multi_scale,
            self._o3d.core.Tensor(self.start.matrix),
        )
        try:
            found = solver(current, reference, self._K, start, 1.0, 13.0, method=self._method)
        except RuntimeError as error:
            return failure(f"baseline: {error}".splitlines()[0])
        return _result(
            found.transformation.numpy(), residual=found.inlier_rmse, inliers=found.fitness
        )


def _result(T: np.ndarray, residual: float = float("nan"), inliers: float = 0.0) -> OdometryResult:
    """Result from a (4, 4) matrix.

    A matrix that is not a rigid motion is a failure: a solver that diverged reports it in no other
    way.
    """
    try:
        return OdometryResult(SE3.from_matrix(T), residual=residual, inliers=inliers)
    except InputError:
        return failure("baseline: the estimated matrix is not a rigid motion")


def _bytes(grey: np.ndarray) -> np.ndarray:
    return np.clip(grey + 0.5, 0, 255).astype(np.uint8)
