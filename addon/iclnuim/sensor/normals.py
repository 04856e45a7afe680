"""Normals of a depth image, in the form that costs least.

With w = 1/Z, A = -fx Z dw/du and B = -fy Z dw/dv, the vector N = (-A, -B, 1 + A x + B y) is normal to the surface seen
along the ray r = (x, y, 1), and N . r = 1; so the cosine of the angle between normal and ray is 1 / (|N| |r|). Exact on
planes, whose w is linear in u and v.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from .sampling import bands


@dataclass(frozen=True)
class Normals:
    """Components of N, (h, w) each, not of length one; `secant` = 1 / cosine of the angle to the camera ray."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    secant: np.ndarray

    def __getitem__(self, rows: slice) -> "Normals":
        """Some rows, as views."""
        return Normals(self.x[rows], self.y[rows], self.z[rows], self.secant[rows])

    def angle_rad(self) -> np.ndarray:
        """(h, w), 0 where the surface faces the camera, pi/2 where it has no normal."""
        return np.arccos(np.minimum(1 / self.secant, np.float32(1)))


def ray_slopes(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """x (1, w) and y (h, 1) of the rays (x, y, 1), float32."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    return x.astype(np.float32)[None], y.astype(np.float32)[:, None]


def backward_normals(depth_z_m: np.ndarray, camera: PinholeCamera) -> Normals:
    """From each pixel's left and upper neighbour; where one of the three is missing or outside there is none."""
    return _normals(depth_z_m, camera, lambda before, after: before)


def surface_normals(depth_z_m: np.ndarray, camera: PinholeCamera) -> Normals:
    """From the neighbours on either side, whichever differs less: at an edge that of the pixel's own surface."""
    return _normals(depth_z_m, camera, _smaller)


def _normals(
    depth_z_m: np.ndarray, camera: PinholeCamera, choose: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Normals:
    """`choose` picks of the steps of 1/Z from the pixel before and to the pixel after."""
    height, width = depth_z_m.shape
    # 1/Z is infinite where missing or outside: every difference with it is infinite or NaN and gives no normal
    inverse = np.full((height + 2, width + 2), np.inf, np.float32)
    normals = Normals(*(np.empty_like(depth_z_m) for _ in range(4)))
    x, y = ray_slopes(camera)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        np.divide(1, depth_z_m, out=inverse[1:-1, 1:-1])
        for rows in bands(height):
            near = inverse[rows.start : rows.stop + 2]
            du, dv = np.diff(near[1:-1], axis=1), np.diff(near[:, 1:-1], axis=0)
            a = choose(du[:, :-1], du[:, 1:]) * depth_z_m[rows] * np.float32(-camera.fx)
            b = choose(dv[:-1], dv[1:]) * depth_z_m[rows] * np.float32(-camera.fy)
            _fill(normals[rows], a, b, x, y[rows])
    return normals


def _smaller(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """np.where(|after| < |before|, after, before) of float32 in a third of its time: on a plane the choice is chance."""
    before, after = (np.ascontiguousarray(step).view(np.int32) for step in (before, after))
    take_after = -(np.abs(after.view(np.float32)) < np.abs(before.view(np.float32))).astype(np.int32)
    return (before ^ ((after ^ before) & take_after)).view(np.float32)


def _fill(normals: Normals, a: np.ndarray, b: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    np.negative(a, out=normals.x)
    np.negative(b, out=normals.y)
    normals.z[:] = 1 + a * x + b * y
    secant = np.sqrt((a * a + b * b + normals.z * normals.z) * (1 + x * x + y * y))
    np.fmin(secant, np.float32(np.inf), out=normals.secant)  # NaN becomes infinite
