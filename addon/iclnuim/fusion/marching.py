"""Marching cubes over blocks, compiled: triangles by the keys of the edges that they touch, then vertices by key.

A cube belongs to the block of its lowest corner. The key of an edge is ((i n + j) n + k) 3 + axis, with (i, j, k) the
voxel that it leaves, counted from a corner below all blocks, and n = 2^19; so a vertex that several cubes share has one key.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .cube_cases import table
from .grid import row_of

COUNT, EDGES = table()
SIDE = 1 << 19


@njit(cache=True)
def _cubes(grid, row, least, leaves, edges, count, low, keys):
    """The triangles of a block's cubes; written to keys (n, 3) if it has any rows. Returns how many.

    A cube counts where all its corners were seen `least` times, and one of them lies in a row that leaves.
    """
    a0, b0, c0 = grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]
    near = np.empty(8, np.int64)
    for n in range(8):
        near[n] = row_of(grid, a0 + (n >> 2), b0 + (n >> 1 & 1), c0 + (n & 1))
    found = 0
    for at in range(512):
        i, j, k = at >> 6, at >> 3 & 7, at & 7
        case, whole, mine = 0, True, False
        for n in range(8):
            x, y, z = i + (n >> 2), j + (n >> 1 & 1), k + (n & 1)
            other = near[(x >> 3) * 4 + (y >> 3) * 2 + (z >> 3)]
            place = (x & 7) * 64 + (y & 7) * 8 + (z & 7)
            if other == 0 or grid.weight[other, place] < least:
                whole = False
                break
            mine = mine or leaves[other]
            case |= (1 << n) if grid.tsdf[other, place] <= 0.0 else 0
        if not (whole and mine):
            continue
        if keys.shape[0]:
            for m in range(count[case]):
                for e in range(3):
                    edge = edges[case, m, e]
                    n = edge // 3
                    x = (a0 - low[0]) * 8 + i + (n >> 2)
                    y = (b0 - low[1]) * 8 + j + (n >> 1 & 1)
                    z = (c0 - low[2]) * 8 + k + (n & 1)
                    keys[found + m, e] = ((x * SIDE + y) * SIDE + z) * 3 + edge % 3
        found += count[case]
    return found


@njit(cache=True, parallel=True)
def count_triangles(grid, rows, least, leaves, edges, count, low, totals):
    """totals (rows,): of each block."""
    none = np.empty((0, 3), np.int64)
    for r in prange(rows.shape[0]):
        totals[r] = _cubes(grid, rows[r], least, leaves, edges, count, low, none)


@njit(cache=True, parallel=True)
def list_triangles(grid, rows, least, leaves, edges, count, low, start, keys):
    """keys (n, 3): those of block r from start[r] to start[r + 1]."""
    for r in prange(rows.shape[0]):
        if start[r] < start[r + 1]:
            _cubes(grid, rows[r], least, leaves, edges, count, low, keys[start[r] : start[r + 1]])


@njit(cache=True, parallel=True)
def place_vertices(grid, keys, low, voxel, points, colours):
    """Where the distance is zero along each edge, and the colour there (mean of the ends that have one)."""
    channels = grid.colour.shape[2] - 1
    for v in prange(keys.shape[0]):
        axis, rest = keys[v] % 3, keys[v] // 3
        p = np.empty(3, np.int64)
        p[0] = rest // (SIDE * SIDE) + low[0] * 8
        p[1], p[2] = rest // SIDE % SIDE + low[1] * 8, rest % SIDE + low[2] * 8
        q = p.copy()
        q[axis] += 1
        one = row_of(grid, p[0] >> 3, p[1] >> 3, p[2] >> 3)
        two = row_of(grid, q[0] >> 3, q[1] >> 3, q[2] >> 3)
        i = (p[0] & 7) * 64 + (p[1] & 7) * 8 + (p[2] & 7)
        j = (q[0] & 7) * 64 + (q[1] & 7) * 8 + (q[2] & 7)
        f, g = grid.tsdf[one, i], grid.tsdf[two, j]
        share = f / (f - g)
        for a in range(3):
            points[v, a] = p[a] * voxel
        points[v, axis] += share * voxel
        if channels:
            w = (1 - share) if grid.colour[one, i, channels] else 0.0
            x = share if grid.colour[two, j, channels] else 0.0
            for c in range(channels):
                mixed = w * grid.colour[one, i, c] + x * grid.colour[two, j, c]
                colours[v, c] = np.uint8(min(mixed / (256 * (w + x)) + 0.5, 255.0)) if w + x > 0 else 0
