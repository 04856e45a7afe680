"""Interpolation and normals of depth images, computed in bands of rows. Depth 0 means missing.

Normals are computed in the form that needs the fewest operations. With w = 1/Z, A = -fx Z dw/du and
B = -fy Z dw/dv, the vector N = (-A, -B, 1 + A x + B y) is normal to the surface seen along the ray
r = (x, y, 1), and N . r = 1. Therefore the cosine of the angle between normal and ray is 1 / (|N|
|r|). This is exact on planes, whose w is linear in u and v.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera

#: Rows of a band. Arrays of this size stay in the processor's cache; whole images took three times
#: as long.
_ROWS = 48


def bands(height: int) -> Iterator[slice]:
    """Slices that cover the rows 0..height-1 in order."""
    return (slice(top, min(top + _ROWS, height)) for top in range(0, height, _ROWS))


def as_depth(depth_z_m: np.ndarray) -> np.ndarray:
    """(h, w) planar depth in metres as float32.

    Invalid values (infinite, NaN, negative) become 0.
    """
    depth_z_m = np.asarray(depth_z_m, np.float32)
    if depth_z_m.ndim != 2 or min(depth_z_m.shape) < 2:
        raise InputError("a depth image of at least 2 x 2 pixels", found=depth_z_m.shape)
    return np.where((depth_z_m > 0) & (depth_z_m < np.inf), depth_z_m, np.float32(0))


def sample_within_surface(
    depth_z_m: np.ndarray, u: np.ndarray, v: np.ndarray, edge_share: float
) -> np.ndarray:
    """Bilinear depth at (u, v). Positions outside are clamped to the outermost pixel centres.

    Only pixels on the same surface as the nearest pixel are used: pixels that are missing, or
    nearer or farther than it by more than `edge_share`, get weight 0. So holes and surfaces behind
    an edge are not mixed in. The result is missing where the nearest pixel is missing.
    """
    height, width = depth_z_m.shape
    result = np.empty_like(depth_z_m)
    for rows in bands(height):
        place = np.clip(u[rows], 0, width - 1), np.clip(v[rows], 0, height - 1)
        corners, weights_u, weights_v = _corners(depth_z_m, *place)
        result[rows] = _blend(corners, weights_u, weights_v)
        lowest = np.minimum(np.minimum(*corners[:2]), np.minimum(*corners[2:]))
        highest = np.maximum(np.maximum(*corners[:2]), np.maximum(*corners[2:]))
        mixed = np.flatnonzero(highest > lowest * np.float32(1 + edge_share))
        if mixed.size:
            fu = weights_u.ravel()[mixed]
            fv = weights_v.ravel()[mixed]
            weights = np.stack([(1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv])
            depths = np.stack([c.ravel()[mixed] for c in corners])
            result[rows].ravel()[mixed] = _mean_of_nearest_surface(depths, weights, edge_share)
    return result


def sample_with_zeros(depth_z_m: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Plain bilinear depth at (u, v).

    Missing pixels and positions outside the image are interpolated as 0.
    """
    height, width = depth_z_m.shape
    framed = np.zeros((height + 3, width + 3), np.float32)
    framed[1:-2, 1:-2] = depth_z_m
    result = np.empty_like(depth_z_m)
    for rows in bands(height):
        framed_u = np.clip(u[rows] + 1, 0, width + 1)
        framed_v = np.clip(v[rows] + 1, 0, height + 1)
        result[rows] = _blend(*_corners(framed, framed_u, framed_v))
    return result


def _corners(
    image: np.ndarray, u: np.ndarray, v: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """The four pixels around each position (upper left, upper right, lower left, lower right), and
    the weights of right and lower ones.
    """
    height, width = image.shape
    column = np.minimum(u.astype(np.int32), np.int32(width - 2))
    row = np.minimum(v.astype(np.int32), np.int32(height - 2))
    place = (row * np.int32(width) + column).astype(np.intp)
    flat = image.ravel()
    # mode "clip" avoids numpy's check of every index; none is outside
    corners = [flat[offset:].take(place, mode="clip") for offset in (0, 1, width, width + 1)]
    return corners, u - column.astype(np.float32), v - row.astype(np.float32)


def _blend(corners: list[np.ndarray], weights_u: np.ndarray, weights_v: np.ndarray) -> np.ndarray:
    above = corners[0] + (corners[1] - corners[0]) * weights_u
    below = corners[2] + (corners[3] - corners[2]) * weights_u
    return above + (below - above) * weights_v


def _mean_of_nearest_surface(
    depth_z_m: np.ndarray, weights: np.ndarray, edge_share: float
) -> np.ndarray:
    """(4, n) depths and weights -> (n,) weighted means over the pixels on the same surface as the
    one of largest weight.
    """
    nearest = np.take_along_axis(depth_z_m, np.argmax(weights, 0)[None], 0)
    limit = np.float32(1 + edge_share)
    is_near = (depth_z_m <= nearest * limit) & (nearest <= depth_z_m * limit)
    weights = weights * ((depth_z_m > 0) & is_near)
    total = (weights * depth_z_m).sum(0)
    nothing = np.zeros(nearest.size, np.float32)
    return np.divide(total, weights.sum(0), out=nothing, where=nearest[0] > 0)


@dataclass(frozen=True)
class Normals:
    """Components of N, (h, w) each; N is not a unit vector.

    `secant` = 1 / cosine of the angle to the camera ray.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    secant: np.ndarray

    def __getitem__(self, rows: slice) -> "Normals":
        """The normals of some rows, as views."""
        return Normals(self.x[rows], self.y[rows], self.z[rows], self.secant[rows])

    def angle_rad(self) -> np.ndarray:
        """The angle between normal and camera ray (h, w): 0 where the surface faces the camera,
        pi/2 where there is no normal.
        """
        return np.arccos(np.minimum(1 / self.secant, np.float32(1)))


def ray_slopes(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """x (1, w) and y (h, 1) of the rays (x, y, 1), float32."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    return x.astype(np.float32)[None], y.astype(np.float32)[:, None]


def surface_normals(
    depth_z_m: np.ndarray, camera: PinholeCamera, backward: bool = False
) -> Normals:
    """Normals from the neighbour on the side where 1/Z differs less; at an edge this is the
    neighbour on the pixel's own surface.

    backward: always from the left and upper neighbours; there is no normal where one of them is
    missing or outside.
    """
    height, width = depth_z_m.shape
    choose = _before if backward else _smaller
    # 1/Z is infinite where depth is missing or outside the image: differences are infinite or NaN
    # there, and there is no normal
    inverse = np.full((height + 2, width + 2), np.inf, np.float32)
    normals = Normals(*(np.empty_like(depth_z_m) for _ in range(4)))
    x, y = ray_slopes(camera)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        np.divide(1, depth_z_m, out=inverse[1:-1, 1:-1])
        for rows in bands(height):
            near = inverse[rows.start : rows.stop + 2]
            du = np.diff(near[1:-1], axis=1)
            dv = np.diff(near[:, 1:-1], axis=0)
            a = choose(du[:, :-1], du[:, 1:]) * depth_z_m[rows] * np.float32(-camera.fx)
            b = choose(dv[:-1], dv[1:]) * depth_z_m[rows] * np.float32(-camera.fy)
            n = normals[rows]
            np.negative(a, out=n.x)
            np.negative(b, out=n.y)
            n.z[:] = 1 + a * x + b * y[rows]
            secant = np.sqrt((a * a + b * b + n.z * n.z) * (1 + x * x + y[rows] * y[rows]))
            np.fmin(secant, np.float32(np.inf), out=n.secant)  # NaN becomes infinite
    return normals


def _before(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return before


def _smaller(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """np.where(|after| < |before|, after, before) for float32 in a third of its time, without
    branches: on a plane the choice is random.
    """
    before = np.ascontiguousarray(before).view(np.int32)
    after = np.ascontiguousarray(after).view(np.int32)
    take_after = -(np.abs(after.view(np.float32)) < np.abs(before.view(np.float32))).astype(
        np.int32
    )
    return (before ^ ((after ^ before) & take_after)).view(np.float32)
