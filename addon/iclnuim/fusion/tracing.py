"""Looking at the volume, compiled: rays from front to back to the trilinear zero crossing.

Each pixel is written by one thread only, so the number of threads cannot change a bit. K is (fx, fy, cx, cy).
"""

import math

import numpy as np
from numba import njit, prange

from .grid import gradient, read, read_colour, row_of


@njit(cache=True, inline="always")
def _beside(x, z, f, c, size, radius):
    """Whether a ball at (x, z) lies outside one of the two planes through the image's borders."""
    low, high = c + 0.5, size - 0.5 - c
    return f * x + low * z < -radius * math.hypot(f, low) or high * z - f * x < -radius * math.hypot(f, high)


@njit(cache=True)
def ranges(grid, highest, K, R, t, voxel, tile, near, far):
    """Planar depths between which the blocks of rows 1..highest lie, tile by tile of the image: from `near` to `far`.

    near, far (h, w): filled with infinity and 0 by the caller. R, t are T_camera_world. A block counts as its ball.
    """
    size = 8.0 * voxel
    radius = 0.5 * math.sqrt(3.0) * size
    height, width = near.shape[0] * tile, near.shape[1] * tile
    for row in range(1, highest + 1):
        px = grid.place[row, 0] * size + 3.5 * voxel
        py = grid.place[row, 1] * size + 3.5 * voxel
        pz = grid.place[row, 2] * size + 3.5 * voxel
        z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
        if z < -radius or row_of(grid, grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]) != row:
            continue
        x = R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]
        y = R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]
        if _beside(x, z, K[0], K[2], width, radius) or _beside(y, z, K[1], K[3], height, radius):
            continue
        nearest = z - radius
        if nearest < 0.1:
            u0, u1, v0, v1 = 0, near.shape[1] - 1, 0, near.shape[0] - 1
            nearest = 0.0
        else:
            u, v = K[0] * x, K[1] * y
            du, dv = K[0] * radius, K[1] * radius
            u0 = int(max(0.0, (min((u - du) / z, (u - du) / nearest) + K[2]) // tile))
            v0 = int(max(0.0, (min((v - dv) / z, (v - dv) / nearest) + K[3]) // tile))
            u1 = int(min(near.shape[1] - 1.0, (max((u + du) / z, (u + du) / nearest) + K[2]) // tile))
            v1 = int(min(near.shape[0] - 1.0, (max((v + dv) / z, (v + dv) / nearest) + K[3]) // tile))
        for i in range(v0, v1 + 1):
            for j in range(u0, u1 + 1):
                near[i, j] = min(near[i, j], nearest)
                far[i, j] = max(far[i, j], z + radius)


@njit(cache=True, inline="always")
def _leave_block(x, y, z, dx, dy, dz):
    """How far along d a point (voxels, shifted by half) has to go to leave its block; a little more."""
    best = 1e9
    for p, d in ((x, dx), (y, dy), (z, dz)):
        low = 8.0 * math.floor(p / 8.0)
        if d > 1e-12:
            best = min(best, (low + 8.0 - p) / d)
        elif d < -1e-12:
            best = min(best, (low - p) / d)
    return best + 1e-3


@njit(cache=True)
def _refined(grid, o, d, front, behind, step):
    """Planar z of the trilinear zero near front..behind, from positive to negative; NaN without one.

    The two are where the nearest voxel is positive and negative, so the crossing may lie a step outside.
    """
    before = read(grid, o[0] + d[0] * front, o[1] + d[1] * front, o[2] + d[2] * front)
    if not before > 0.0:
        front -= step
        before = read(grid, o[0] + d[0] * front, o[1] + d[1] * front, o[2] + d[2] * front)
    after = read(grid, o[0] + d[0] * behind, o[1] + d[1] * behind, o[2] + d[2] * behind)
    if after > 0.0:
        front, before = behind, after
        behind += step
        after = read(grid, o[0] + d[0] * behind, o[1] + d[1] * behind, o[2] + d[2] * behind)
    if not (before > 0.0 and after <= 0.0):
        return np.nan
    for _ in range(4):
        middle = front + (behind - front) * before / (before - after)
        m = read(grid, o[0] + d[0] * middle, o[1] + d[1] * middle, o[2] + d[2] * middle)
        if abs(m) < 1e-6:
            return middle
        if m > 0.0:
            front, before = middle, m
        elif m < 0.0:
            behind, after = middle, m
        else:
            return np.nan
    return front + (behind - front) * before / (before - after)


@njit(cache=True)
def _first_crossing(grid, o, d, start, far, voxel):
    """Planar z where the ray o + d z (voxels) enters a surface from the front; NaN without one.

    Unseen blocks are jumped over, free space is crossed in steps of the distance read at the nearest voxel.
    """
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    z, front = start, -1.0
    while z < far:
        x, y, w = o[0] + d[0] * z + 0.5, o[1] + d[1] * z + 0.5, o[2] + d[2] * z + 0.5
        i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(w))
        row = row_of(grid, i >> 3, j >> 3, k >> 3)
        if row == 0:
            front = -1.0
            z += _leave_block(x, y, w, d[0], d[1], d[2])
            continue
        at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
        step = 1.0
        if grid.weight[row, at] > 0:
            f = grid.tsdf[row, at]
            if f > 0.0:
                front, step = z, max(1.0, 0.8 * f / voxel)
            elif front >= 0.0:
                hit = _refined(grid, o, d, front, z, 1.0 / length)
                if not math.isnan(hit):
                    return hit
                front = -1.0
        z += step / length
    return np.nan


@njit(cache=True, parallel=True)
def trace(grid, K, R, t, voxel, tile, near, far, depth, normals, colour):
    """First crossing from front to back along each pixel's ray; outputs are left as they are without one.

    R, t are T_world_camera; near, far: of each tile, by `ranges`. normals (h, w, 3) in the camera's frame; normals and
    colour (h, w, channels) may be empty, and are then not asked for.
    """
    for v in prange(depth.shape[0]):
        o, d, q, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        for u in range(depth.shape[1]):
            x, y = (u - K[2]) / K[0], (v - K[3]) / K[1]
            for a in range(3):
                o[a] = t[a] / voxel
                d[a] = (R[a, 0] * x + R[a, 1] * y + R[a, 2]) / voxel
            first, last = max(near[v // tile, u // tile], 4.0 * voxel), far[v // tile, u // tile]
            z = _first_crossing(grid, o, d, first, last, voxel)
            if math.isnan(z):
                continue
            depth[v, u] = z
            for a in range(3):
                q[a] = o[a] + d[a] * z
            if normals.size:
                gradient(grid, q[0], q[1], q[2], g)
                for a in range(3):
                    normals[v, u, a] = R[0, a] * g[0] + R[1, a] * g[1] + R[2, a] * g[2]
            if colour.size:
                read_colour(grid, q[0], q[1], q[2], colour[v, u])
