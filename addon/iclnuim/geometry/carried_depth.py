"""The residual of each pixel of a depth image in another one."""

import numpy as np

from .camera import PinholeCamera
from .se3 import SE3


def carried_residual(
    depth_a_z_m: np.ndarray,
    depth_b_z_m: np.ndarray,
    T_b_a: SE3,
    camera: PinholeCamera,
    step_px: int = 1,
) -> np.ndarray:
    """Measured minus expected z in b, in metres, of every `step_px`-th row and column of a; NaN
    where one of them has no depth.
    """
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
