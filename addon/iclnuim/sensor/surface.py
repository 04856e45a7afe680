"""Normals of a depth image, in the form that costs least.

With w = 1/Z, A = -fx Z dw/du and B = -fy Z dw/dv, the vector N = (-A, -B, 1 + A x + B y) is normal to the surface seen
along the ray r = (x, y, 1), and N . r = 1; so the cosine of the angle between normal and ray is 1 / (|N| |r|). Exact on
planes, whose w is linear in u and v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera


@dataclass(frozen=True)
class Normals:
    """Components of N, (h, w) each, not of length one; `secant` = 1 / cosine of the angle to the camera ray."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    secant: np.ndarray

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
    inverse = _inverse(depth_z_m)
    du, dv = np.full_like(inverse, np.inf), np.full_like(inverse, np.inf)
    with np.errstate(invalid="ignore"):
        du[:, 1:] = inverse[:, 1:] - inverse[:, :-1]
        dv[1:] = inverse[1:] - inverse[:-1]
    return _normals(depth_z_m, du, dv, camera)


def surface_normals(depth_z_m: np.ndarray, camera: PinholeCamera) -> Normals:
    """From the neighbours on either side, whichever differs less: at an edge that of the pixel's own surface."""
    inverse = _inverse(depth_z_m)
    return _normals(depth_z_m, _smaller_step(inverse), _smaller_step(inverse.T).T, camera)


def _inverse(depth_z_m: np.ndarray) -> np.ndarray:
    """1/Z, infinite where missing, so that every difference with it is infinite or NaN and gives no normal."""
    with np.errstate(divide="ignore"):
        return 1 / depth_z_m


def _smaller_step(inverse: np.ndarray) -> np.ndarray:
    steps = np.full((inverse.shape[0], inverse.shape[1] + 1), np.inf, np.float32)
    with np.errstate(invalid="ignore"):
        np.subtract(inverse[:, 1:], inverse[:, :-1], out=steps[:, 1:-1])
        left, right = steps[:, :-1], steps[:, 1:]
        return np.where(np.abs(right) < np.abs(left), right, left)


def _normals(depth_z_m: np.ndarray, du: np.ndarray, dv: np.ndarray, camera: PinholeCamera) -> Normals:
    x, y = ray_slopes(camera)
    with np.errstate(invalid="ignore", over="ignore"):
        a = du * depth_z_m * np.float32(-camera.fx)
        b = dv * depth_z_m * np.float32(-camera.fy)
        z = 1 + a * x + b * y
        secant = np.sqrt((a * a + b * b + z * z) * (1 + x * x + y * y))
    secant[~(secant < np.inf)] = np.inf
    return Normals(-a, -b, z, secant)
