"""Blocks of 8^3 voxels in a cyclic index: where a voxel lies in memory, compiled.

Voxel (i, j, k) has its centre at (i, j, k) voxel_m in the world; its block is (i >> 3, j >> 3, k >> 3). The index is a
cube of n^3 slots, n a power of two; block b lies in slot b modulo n, and only blocks within the window that starts at
`first` are held, so that no two share a slot. Row 0 stands for "no block".
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit


class Grid(NamedTuple):
    """first (3,) int64: lowest block of the window; slots (n, n, n) int32 rows; place (rows, 3) int32 block of a row;
    tsdf (rows, 512) float32 metres; weight (rows, 512) uint16; colour (rows, 512, channels + 1) uint16: mean times 256,
    and the count behind it.
    """

    first: np.ndarray
    slots: np.ndarray
    place: np.ndarray
    tsdf: np.ndarray
    weight: np.ndarray
    colour: np.ndarray


@njit(cache=True, inline="always")
def row_of(grid, a, b, c):
    """Row of block (a, b, c); 0 where there is none."""
    n = grid.slots.shape[0]
    x, y, z = a - grid.first[0], b - grid.first[1], c - grid.first[2]
    if x < 0 or y < 0 or z < 0 or x >= n or y >= n or z >= n:
        return 0
    return grid.slots[a & (n - 1), b & (n - 1), c & (n - 1)]


@njit(cache=True)
def read(grid, x, y, z):
    """Trilinear distance at (x, y, z) in voxels; NaN where one of the eight is unseen."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    p, q, s = x - i, y - j, z - k
    if (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        return _within(grid, i, j, k, p, q, s)
    total = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, corner >> 1 & 1, corner & 1
        row = row_of(grid, (i + a) >> 3, (j + b) >> 3, (k + c) >> 3)
        at = ((i + a) & 7) * 64 + ((j + b) & 7) * 8 + ((k + c) & 7)
        if row == 0 or grid.weight[row, at] == 0:
            return np.nan
        share = (p if a else 1 - p) * (q if b else 1 - q) * (s if c else 1 - s)
        total += share * grid.tsdf[row, at]
    return total


@njit(cache=True, inline="always")
def _within(grid, i, j, k, p, q, s):
    """The same where all eight lie in one block."""
    row = row_of(grid, i >> 3, j >> 3, k >> 3)
    if row == 0:
        return np.nan
    at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
    f, w = grid.tsdf[row], grid.weight[row]
    for step in (0, 1, 8, 9, 64, 65, 72, 73):
        if w[at + step] == 0:
            return np.nan
    low = (1 - q) * ((1 - s) * f[at] + s * f[at + 1]) + q * ((1 - s) * f[at + 8] + s * f[at + 9])
    high = (1 - q) * ((1 - s) * f[at + 64] + s * f[at + 65]) + q * ((1 - s) * f[at + 72] + s * f[at + 73])
    return (1 - p) * low + p * high


@njit(cache=True)
def read_colour(grid, x, y, z, out):
    """Trilinear colour (channels,) of those of the eight voxels that have one; left as it is where none has."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    p, q, s = x - i, y - j, z - k
    channels = grid.colour.shape[2] - 1
    share = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, corner >> 1 & 1, corner & 1
        row = row_of(grid, (i + a) >> 3, (j + b) >> 3, (k + c) >> 3)
        at = ((i + a) & 7) * 64 + ((j + b) & 7) * 8 + ((k + c) & 7)
        if row == 0 or grid.colour[row, at, channels] == 0:
            continue
        part = (p if a else 1 - p) * (q if b else 1 - q) * (s if c else 1 - s)
        if part > 0:
            for n in range(channels):
                before = out[n] if share > 0 else 0.0
                out[n] = (before * share + grid.colour[row, at, n] / 256 * part) / (share + part)
            share += part


@njit(cache=True)
def gradient(grid, x, y, z, out):
    """Unit gradient by central differences over one voxel to each side; NaN at the border of what was seen."""
    out[0] = read(grid, x + 1, y, z) - read(grid, x - 1, y, z)
    out[1] = read(grid, x, y + 1, z) - read(grid, x, y - 1, z)
    out[2] = read(grid, x, y, z + 1) - read(grid, x, y, z - 1)
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for a in range(3):
        out[a] = out[a] / size if size > 0 else np.nan
