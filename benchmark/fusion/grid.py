"""The voxels of a volume in memory, and how compiled code reads them.

Blocks of 8^3 voxels are stored in a cyclic index. Voxel (i, j, k) has its centre at (i, j, k)
voxel_m in the world; its block is (i >> 3, j >> 3, k >> 3). The index is a cube of n^3 slots, n a
power of two; block b is in slot b modulo n. Only blocks inside the window that starts at `first`
are stored, so that no two share a slot. Row 0 means "no block".
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled import compiled

#: The weight that a frame adds on its surface and in front of it. Slanted views and voxels behind a
#: surface add less, in whole steps.
UNIT = 16.0


class Grid(NamedTuple):
    """first (3,) int64: lowest block of the window; slots (n, n, n) int32 rows; place (rows, 3)
    int32 block of a row; tsdf (rows, 512) float32 metres; weight (rows, 512) uint16; colour (rows,
    512, channels + 1) uint16: mean times 256, and the count behind it; inside (rows,) bool: whether
    a voxel of the block is behind a surface.
    """

    first: np.ndarray
    slots: np.ndarray
    place: np.ndarray
    tsdf: np.ndarray
    weight: np.ndarray
    colour: np.ndarray
    inside: np.ndarray


class CameraPose(NamedTuple):
    """K (4,): fx, fy, cx, cy; R (3, 3) and t (3,): T_world_camera, or T_camera_world where it says
    so.
    """

    K: np.ndarray
    R: np.ndarray
    t: np.ndarray


class Rule(NamedTuple):
    """The settings of a volume that compiled code reads: lengths in metres; max_weight in UNIT."""

    voxel: float
    trunc: float
    behind: float
    slanted: int
    max_weight: float


@compiled(inline="always")
def row_of(grid: Grid, a: int, b: int, c: int) -> int:
    """Row of block (a, b, c); 0 if there is none."""
    n = grid.slots.shape[0]
    x = a - grid.first[0]
    y = b - grid.first[1]
    z = c - grid.first[2]
    if x < 0 or y < 0 or z < 0 or x >= n or y >= n or z >= n:
        return 0
    return grid.slots[a & (n - 1), b & (n - 1), c & (n - 1)]


@compiled()
def read(grid: Grid, x: float, y: float, z: float) -> float:
    """Trilinear distance at (x, y, z) in voxels; NaN if one of the eight voxels is unobserved."""
    i = int(math.floor(x))
    j = int(math.floor(y))
    k = int(math.floor(z))
    if (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        return _within(grid, (i, j, k), (x - i, y - j, z - k))
    total = 0.0
    for corner in range(8):
        a = i + (corner >> 2)
        b = j + (corner >> 1 & 1)
        c = k + (corner & 1)
        row = row_of(grid, a >> 3, b >> 3, c >> 3)
        at = (a & 7) * 64 + (b & 7) * 8 + (c & 7)
        if row == 0 or grid.weight[row, at] == 0:
            return np.nan
        total += _share(corner, x - i, y - j, z - k) * grid.tsdf[row, at]
    return total


@compiled(inline="always")
def _share(corner: int, p: float, q: float, s: float) -> float:
    """Trilinear weight of a corner of the cube at (p, q, s)."""
    along_x = p if corner >> 2 else 1 - p
    along_y = q if corner >> 1 & 1 else 1 - q
    along_z = s if corner & 1 else 1 - s
    return along_x * along_y * along_z


@compiled(inline="always")
def _within(grid: Grid, lowest: tuple[int, int, int], offset: tuple[float, float, float]) -> float:
    """read() if all eight voxels are in one block."""
    i, j, k = lowest
    p, q, s = offset
    row = row_of(grid, i >> 3, j >> 3, k >> 3)
    if row == 0:
        return np.nan
    at = (i & 7) * 64 + (j & 7) * 8 + (k & 7)
    f = grid.tsdf[row]
    w = grid.weight[row]
    for step in (0, 1, 8, 9, 64, 65, 72, 73):
        if w[at + step] == 0:
            return np.nan
    low = (1 - q) * ((1 - s) * f[at] + s * f[at + 1]) + q * ((1 - s) * f[at + 8] + s * f[at + 9])
    high = (1 - q) * ((1 - s) * f[at + 64] + s * f[at + 65]) + q * (
        (1 - s) * f[at + 72] + s * f[at + 73]
    )
    return (1 - p) * low + p * high


@compiled()
def read_colour(grid: Grid, x: float, y: float, z: float, out: np.ndarray) -> None:
    """Write to out (channels,) the trilinear colour of those of the eight voxels that have one;
    unchanged if none has.
    """
    i = int(math.floor(x))
    j = int(math.floor(y))
    k = int(math.floor(z))
    channels = grid.colour.shape[2] - 1
    share = 0.0
    for corner in range(8):
        a = i + (corner >> 2)
        b = j + (corner >> 1 & 1)
        c = k + (corner & 1)
        row = row_of(grid, a >> 3, b >> 3, c >> 3)
        at = (a & 7) * 64 + (b & 7) * 8 + (c & 7)
        if row == 0 or grid.colour[row, at, channels] == 0:
            continue
        part = _share(corner, x - i, y - j, z - k)
        if part > 0:
            for n in range(channels):
                before = out[n] if share > 0 else 0.0
                out[n] = (before * share + grid.colour[row, at, n] / 256 * part) / (share + part)
            share += part


@compiled()
def gradient(grid: Grid, x: float, y: float, z: float, out: np.ndarray) -> None:
    """Write to out (3,) the unit gradient by central differences over one voxel to each side; NaN
    at the border of the observed region.
    """
    out[0] = read(grid, x + 1, y, z) - read(grid, x - 1, y, z)
    out[1] = read(grid, x, y + 1, z) - read(grid, x, y - 1, z)
    out[2] = read(grid, x, y, z + 1) - read(grid, x, y, z - 1)
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for a in range(3):
        out[a] = out[a] / size if size > 0 else np.nan
