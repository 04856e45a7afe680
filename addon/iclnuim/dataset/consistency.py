"""Do poses and depth belong together? Depth of one frame, carried into another by the poses, must meet its depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import axes
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: Residuals beyond this are other surfaces, not errors of the pose.
_SAME_SURFACE_M = 0.3
_STEP_PX = 6


@dataclass(frozen=True)
class PoseFit:
    """Median distance along z between carried and measured depth, metres: poses as read, and mirrored in y."""

    as_read_m: float
    mirrored_m: float
    pairs: int


def pose_fit(depths_z_m: list[np.ndarray], poses: SE3, camera: PinholeCamera) -> PoseFit:
    """Of each frame against the next of those given, (n,) depth images and poses; NaN where nothing overlaps."""
    fits = []
    for T in (poses, axes.mirrored_y(poses)):
        found = [
            carried_residual(depths_z_m[i], depths_z_m[i + 1], T[i + 1].inverse() @ T[i], camera, _STEP_PX).ravel()
            for i in range(len(depths_z_m) - 1)
        ]
        every = np.abs(np.concatenate(found)) if found else np.zeros(0)
        every = every[every < _SAME_SURFACE_M]  # NaN is not
        fits.append(float(np.median(every)) if every.size > 100 else float("nan"))
    return PoseFit(fits[0], fits[1], len(depths_z_m) - 1)


def carried_residual(
    depth_a_z_m: np.ndarray, depth_b_z_m: np.ndarray, T_b_a: SE3, camera: PinholeCamera, step_px: int = 1
) -> np.ndarray:
    """Measured minus expected z in b of every `step_px`-th row and column of a, metres; NaN where it cannot be told."""
    points = camera.unproject(depth_a_z_m)[::step_px, ::step_px]
    shape = points.shape[:2]
    points = T_b_a.apply(points.reshape(-1, 3))
    pixels = np.rint(np.nan_to_num(camera.project(points), nan=-1.0).clip(-1, 1e6)).astype(int)
    inside = (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    inside &= depth_a_z_m[::step_px, ::step_px].ravel() > 0
    residual = np.full(len(points), np.nan)
    measured = depth_b_z_m[pixels[inside, 1], pixels[inside, 0]]
    residual[inside] = np.where(measured > 0, measured - points[inside, 2], np.nan)
    return residual.reshape(shape)
