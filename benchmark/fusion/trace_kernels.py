"""The compiled loops of a raycast: along each ray to the trilinear zero crossing.

Each pixel is written by one thread only, so results do not depend on the number of threads.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from ..compiled import compiled
from .grid import CameraPose, Grid, Rule, gradient, read, read_colour, row_of

#: Side in pixels of the tiles that share one depth range.
TILE = 8


class RaycastView(NamedTuple):
    """Raycast of the volume: depth (h, w), normals_camera (h, w, 3) towards free space, colour (h,
    w, channels).

    float32, NaN where a ray hits nothing; normals are also NaN at the border of the observed
    region.
    """

    depth_z_m: np.ndarray
    normals_camera: np.ndarray
    colour: np.ndarray


@compiled(inline="always")
def _beside(x: float, z: float, f: float, c: float, size: float, radius: float) -> bool:
    """Whether a sphere at (x, z) is outside one of the two planes through opposite borders of the
    image.
    """
    low, high = c + 0.5, size - 0.5 - c
    below = f * x + low * z < -radius * math.hypot(f, low)
    return below or high * z - f * x < -radius * math.hypot(f, high)


@compiled()
def ranges(grid: Grid, highest: int, camera: CameraPose, voxel: float, reach: np.ndarray) -> None:
    """Range of planar depth of those blocks of rows 1..highest that are partly behind a surface,
    per tile of the image.

    reach (2, h, w): least and largest depth, filled with infinity and 0 by the caller. camera:
    T_camera_world. A block is approximated by its bounding sphere.
    """
    fx, fy, cx, cy = camera.K[0], camera.K[1], camera.K[2], camera.K[3]
    R = camera.R
    t = camera.t
    size = 8.0 * voxel
    radius = 0.5 * math.sqrt(3.0) * size
    tiles_down, tiles_across = reach.shape[1:]
    height, width = tiles_down * TILE, tiles_across * TILE
    for row in range(1, highest + 1):
        if not grid.inside[row]:
            continue
        a, b, c = grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]
        px = a * size + 3.5 * voxel
        py = b * size + 3.5 * voxel
        pz = c * size + 3.5 * voxel
        z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
        if z < -radius or row_of(grid, a, b, c) != row:
            continue
        x = R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]
        y = R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]
        if _beside(x, z, fx, cx, width, radius) or _beside(y, z, fy, cy, height, radius):
            continue
        nearest = z - radius
        if nearest < 0.1:
            _widen(reach, (0, tiles_across), (0, tiles_down), (0.0, z + radius))
        else:
            columns = _tiles(fx * x, fx * radius, cx, z, nearest)
            rows = _tiles(fy * y, fy * radius, cy, z, nearest)
            _widen(reach, columns, rows, (nearest, z + radius))


@compiled()
def _tiles(u: float, du: float, c: float, z: float, nearest: float) -> tuple[int, int]:
    """First and last tile of a sphere of radius du at u, both at depth 1, that is at z to nearest;
    c: principal point.
    """
    low = (min((u - du) / z, (u - du) / nearest) + c) // TILE
    high = (max((u + du) / z, (u + du) / nearest) + c) // TILE
    return int(max(0.0, low)), int(high)


@compiled()
def _widen(
    reach: np.ndarray,
    columns: tuple[int, int],
    rows: tuple[int, int],
    depths: tuple[float, float],
) -> None:
    """Widen the ranges of the tiles so that they contain the depths."""
    for i in range(rows[0], min(rows[1], reach.shape[1] - 1) + 1):
        for j in range(columns[0], min(columns[1], reach.shape[2] - 1) + 1):
            reach[0, i, j] = min(reach[0, i, j], depths[0])
            reach[1, i, j] = max(reach[1, i, j], depths[1])


@compiled(inline="always")
def _leave(p: float, inverse: float) -> float:
    """Distance along a ray to the border of the block of a coordinate p (voxels, shifted by half);
    inverse: 1 / its direction.
    """
    border = 8.0 * math.floor(p * 0.125)
    if inverse > 0.0:
        border += 8.0
    return (border - p) * inverse


@compiled(inline="always")
def _inverse(d: float) -> float:
    """1 / d, but finite."""
    return 1.0 / (d if abs(d) > 1e-12 else 1e-12)


@compiled(inline="always")
def _read_along(grid: Grid, o: np.ndarray, d: np.ndarray, z: float) -> float:
    return read(grid, o[0] + d[0] * z, o[1] + d[1] * z, o[2] + d[2] * z)


@compiled()
def _refined(
    grid: Grid, o: np.ndarray, d: np.ndarray, front: float, behind: float, step: float
) -> float:
    """Planar z of the trilinear zero crossing, from positive to negative, near front..behind; NaN
    without one.

    At front and behind the nearest voxel is positive and negative, so the crossing can be up to a
    step outside this interval.
    """
    before = _read_along(grid, o, d, front)
    if not before > 0.0:
        front -= step
        before = _read_along(grid, o, d, front)
    after = _read_along(grid, o, d, behind)
    if after > 0.0:
        front = behind
        before = after
        behind += step
        after = _read_along(grid, o, d, behind)
    if not (before > 0.0 and after <= 0.0):
        return np.nan
    for _ in range(4):
        middle = front + (behind - front) * before / (before - after)
        found = _read_along(grid, o, d, middle)
        if abs(found) < 1e-6:
            return middle
        if found > 0.0:
            front = middle
            before = found
        elif found < 0.0:
            behind = middle
            after = found
        else:
            return np.nan
    return front + (behind - front) * before / (before - after)


@compiled()
def _first_crossing(
    grid: Grid, o: np.ndarray, d: np.ndarray, start: float, far: float, voxel: float
) -> float:
    """Planar z where the ray o + d z (voxels) enters a surface from the front; NaN without one.

    Missing blocks are skipped. In free space the step is 0.8 of the distance stored in the nearest
    voxel.
    """
    unit = 1.0 / math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    sure = 0.8 / voxel
    z = start
    front = -1.0
    while z < far:
        x = o[0] + 0.5 + d[0] * z
        y = o[1] + 0.5 + d[1] * z
        w = o[2] + 0.5 + d[2] * z
        i = int(math.floor(x))
        j = int(math.floor(y))
        k = int(math.floor(w))
        row = row_of(grid, i >> 3, j >> 3, k >> 3)
        if row == 0:
            front = -1.0
            leave_x = _leave(x, _inverse(d[0]))
            leave_y = _leave(y, _inverse(d[1]))
            leave_w = _leave(w, _inverse(d[2]))
            z += min(leave_x, leave_y, leave_w) + 1e-3
            continue
        at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
        f = grid.tsdf[row, at]
        step = 1.0
        if f > 0.0:  # 0 in voxels that are not observed
            front = z
            step = max(1.0, sure * f)
        elif front >= 0.0 and grid.weight[row, at] > 0:
            hit = _refined(grid, o, d, front, z, unit)
            if not math.isnan(hit):
                return hit
            front = -1.0
        z += step * unit
    return np.nan


@compiled()
def _trace_row(
    grid: Grid, camera: CameraPose, rule: Rule, reach: np.ndarray, view: RaycastView, v: int
) -> None:
    """`trace` of one row of pixels.

    In a function: in a parallel loop numba drops assignments to the arrays of a tuple.
    """
    fx, fy, cx, cy = camera.K[0], camera.K[1], camera.K[2], camera.K[3]
    R = camera.R
    o = camera.t / rule.voxel
    d = np.empty(3)
    g = np.empty(3)
    for u in range(view.depth_z_m.shape[1]):
        x = (u - cx) / fx
        y = (v - cy) / fy
        for a in range(3):
            d[a] = (R[a, 0] * x + R[a, 1] * y + R[a, 2]) / rule.voxel
        near = reach[0, v // TILE, u // TILE]
        far = reach[1, v // TILE, u // TILE]
        start = max(near - rule.trunc, 4.0 * rule.voxel)
        z = _first_crossing(grid, o, d, start, far, rule.voxel)
        if math.isnan(z):
            continue
        view.depth_z_m[v, u] = z
        px = o[0] + d[0] * z
        py = o[1] + d[1] * z
        pz = o[2] + d[2] * z
        if view.normals_camera.size:
            gradient(grid, px, py, pz, g)
            for a in range(3):
                normal = R[0, a] * g[0] + R[1, a] * g[1] + R[2, a] * g[2]
                view.normals_camera[v, u, a] = normal
        if view.colour.size:
            read_colour(grid, px, py, pz, view.colour[v, u])


@compiled(parallel=True)
def trace(grid: Grid, camera: CameraPose, rule: Rule, reach: np.ndarray, view: RaycastView) -> None:
    """First crossing from front to back along each pixel's ray; without one the outputs are
    unchanged.

    camera: T_world_camera; reach: of each tile, from `ranges`. A ray starts `trunc` in front of the
    nearest depth: no step is longer, so that it enters a surface from free space. Normals and
    colour are not computed if they are empty.
    """
    for v in prange(view.depth_z_m.shape[0]):
        _trace_row(grid, camera, rule, reach, view, v)
