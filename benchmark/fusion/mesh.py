"""The triangle mesh of a volume.

Marching cubes (W. Lorensen, H. Cline, SIGGRAPH 1987) over blocks, compiled: first triangles by the
keys of their edges, then vertices by key. The 256 cases are computed. On each face one line
separates every run of inside corners, so two cubes that share a face always agree, and the surface
has no holes at ambiguous faces.

Corner n of a cube is at (n >> 2, n >> 1 & 1, n & 1); edge 3 n + axis starts at corner n towards
+axis. A cube belongs to the block of its lowest corner. The key of an edge is ((i n + j) n + k) 3 +
axis, where (i, j, k) is its start voxel, relative to a corner below all blocks, and n = 2^19. A
vertex shared by several cubes therefore has one key.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from iclnuim.shown import Brief
from numba import prange

from ..compiled import compiled
from .grid import UNIT, Grid, row_of
from .volume import Volume

SIDE = 1 << 19
#: Corners around each face, counter-clockwise as seen from outside.
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def edge(one: int, two: int) -> int:
    """The edge between two neighbouring corners."""
    return 3 * min(one, two) + {4: 0, 2: 1, 1: 2}[one ^ two]


def loops(case: int) -> list[list[int]]:
    """Closed loops of intersected edges that separate the inside corners (bits of `case`) from the
    others.
    """
    following = {}
    for face in FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        for i in range(4):
            if inside[i] or not inside[(i + 1) % 4]:
                continue
            run = next(n for n in range(1, 4) if not inside[(i + 1 + n) % 4])
            entered = edge(face[i], face[(i + 1) % 4])
            following[entered] = edge(face[(i + run) % 4], face[(i + run + 1) % 4])
    found = []
    while following:
        loop = [next(iter(following))]
        while following[loop[-1]] != loop[0]:
            loop.append(following.pop(loop[-1]))
        del following[loop[-1]]
        found.append(loop)
    return found


def case_table() -> tuple[np.ndarray, np.ndarray]:
    """(count (256,), edges (256, max, 3)) int8: number of triangles of each case, and the edges of
    their vertices.

    Loops are triangulated as fans; normals point away from the inside.
    """
    cases: list[list[tuple[int, int, int]]] = []
    for case in range(256):
        cases.append([])
        for loop in loops(case):
            for i in range(1, len(loop) - 1):
                cases[-1].append((loop[0], loop[i], loop[i + 1]))
    count = np.array([len(c) for c in cases], np.int8)
    edges = np.zeros((256, count.max(), 3), np.int8)
    for case, found in enumerate(cases):
        edges[case, : len(found)] = np.array(found, np.int8).reshape(-1, 3)
    return count, edges


COUNT, EDGES = case_table()


class Cubes(NamedTuple):
    """The blocks `rows` whose cubes are meshed, if all corners of a cube have at least min_weight,
    and one of them is in a row where `leaves` is true. low (3,): a block below all blocks.
    """

    rows: np.ndarray
    min_weight: float
    leaves: np.ndarray
    low: np.ndarray


@compiled()
def _triangles(grid: Grid, cubes: Cubes, row: int, keys: np.ndarray) -> int:
    """The triangles of a block's cubes, written to keys (n, 3) unless that is empty. Returns their
    number.
    """
    a, b, c = grid.place[row, 0], grid.place[row, 1], grid.place[row, 2]
    near = np.empty(8, np.int64)
    any_leaves = False
    for n in range(8):
        near[n] = row_of(grid, a + (n >> 2), b + (n >> 1 & 1), c + (n & 1))
        any_leaves = any_leaves or cubes.leaves[near[n]]
    if not any_leaves:
        return 0
    low = cubes.low
    found = 0
    for at in range(512):
        i, j, k = at >> 6, at >> 3 & 7, at & 7
        case = _case(grid, cubes, near, i, j, k)
        if keys.shape[0]:
            corner = ((a - low[0]) * 8 + i, (b - low[1]) * 8 + j, (c - low[2]) * 8 + k)
            for m in range(COUNT[case]):
                for e in range(3):
                    keys[found + m, e] = _key(corner, EDGES[case, m, e])
        found += COUNT[case]
    return found


@compiled(inline="always")
def _case(grid: Grid, cubes: Cubes, near: np.ndarray, i: int, j: int, k: int) -> int:
    """The case of the cube at voxel (i, j, k) of a block; 0, which has no triangles, if it is not
    used. near (8,): rows of the block and of its neighbours above.
    """
    case = 0
    mine = False
    for n in range(8):
        x = i + (n >> 2)
        y = j + (n >> 1 & 1)
        z = k + (n & 1)
        row = near[(x >> 3) * 4 + (y >> 3) * 2 + (z >> 3)]
        place = (x & 7) * 64 + (y & 7) * 8 + (z & 7)
        if row == 0 or grid.weight[row, place] < cubes.min_weight:
            return 0
        mine = mine or cubes.leaves[row]
        if grid.tsdf[row, place] <= 0.0:
            case |= 1 << n
    return case if mine else 0


@compiled(inline="always")
def _key(corner: tuple[int, int, int], edge: int) -> int:
    n = edge // 3
    x = corner[0] + (n >> 2)
    y = corner[1] + (n >> 1 & 1)
    z = corner[2] + (n & 1)
    return ((x * SIDE + y) * SIDE + z) * 3 + edge % 3


@compiled(parallel=True)
def list_triangles(
    grid: Grid, cubes: Cubes, start: np.ndarray, keys: np.ndarray, totals: np.ndarray
) -> None:
    """Write the number of triangles of each block r to totals (rows,), and the triangles to keys
    (n, 3) from start[r] to start[r + 1], unless that is empty.
    """
    for r in prange(cubes.rows.shape[0]):
        part = keys[start[r] : start[r + 1]]
        totals[r] = _triangles(grid, cubes, cubes.rows[r], part)


@compiled(parallel=True)
def place_vertices(
    grid: Grid,
    keys: np.ndarray,
    low: np.ndarray,
    voxel: float,
    points: np.ndarray,
    colours: np.ndarray,
) -> None:
    """Write the zero crossing of the distance on each edge to points, and its colour (mean of the
    ends that have one) to colours.
    """
    channels = grid.colour.shape[2] - 1
    for v in prange(keys.shape[0]):
        axis = keys[v] % 3
        rest = keys[v] // 3
        p = np.empty(3, np.int64)
        p[0] = rest // (SIDE * SIDE) + low[0] * 8
        p[1] = rest // SIDE % SIDE + low[1] * 8
        p[2] = rest % SIDE + low[2] * 8
        q = p.copy()
        q[axis] += 1
        one = row_of(grid, p[0] >> 3, p[1] >> 3, p[2] >> 3)
        two = row_of(grid, q[0] >> 3, q[1] >> 3, q[2] >> 3)
        i = (p[0] & 7) * 64 + (p[1] & 7) * 8 + (p[2] & 7)
        j = (q[0] & 7) * 64 + (q[1] & 7) * 8 + (q[2] & 7)
        f = grid.tsdf[one, i]
        share = f / (f - grid.tsdf[two, j])
        for a in range(3):
            points[v, a] = p[a] * voxel
        points[v, axis] += share * voxel
        if channels:
            w = (1 - share) if grid.colour[one, i, channels] else 0.0
            x = share if grid.colour[two, j, channels] else 0.0
            if w + x > 0:
                for c in range(channels):
                    mixed = w * grid.colour[one, i, c] + x * grid.colour[two, j, c]
                    colours[v, c] = np.uint8(min(mixed / (256 * (w + x)) + 0.5, 255.0))


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Brief):
    """points (n, 3) in metres, triangles (m, 3) counter-clockwise from free space, colours (n, 3)
    uint8 or (n, 0).
    """

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray

    @classmethod
    def joined(cls, parts: "list[Mesh]") -> "Mesh":
        """One mesh; vertices of different parts are not merged."""
        empty = cls(
            np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8)
        )
        parts = parts or [empty]
        starts = np.cumsum([0, *(len(part.points) for part in parts)])
        triangles = [part.triangles + start for part, start in zip(parts, starts, strict=False)]
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate(triangles),
            np.concatenate([part.colours for part in parts]),
        )


def extract(volume: Volume, leaves: np.ndarray | None = None, min_weight: float = 0.25) -> Mesh:
    """Marching cubes over all blocks, or over the cubes with a corner in the rows where `leaves`
    (rows,) is true.

    Parts that are meshed when they leave and parts that are meshed later therefore join without
    gaps and overlaps. A cube is used if all its corners have at least `min_weight` frames; slanted
    views, and voxels behind the surface, have smaller weights.
    """
    grid = volume.grid
    rows = volume.rows()
    if not len(rows):
        return Mesh.joined([])
    if leaves is None:
        leaves = np.ones(len(grid.place), bool)
    low = grid.place[rows].min(axis=0).astype(np.int64)
    cubes = Cubes(rows, max(1.0, min_weight * UNIT), leaves, low)
    totals = np.zeros(len(rows), np.int64)
    no_keys = np.empty((0, 3), np.int64)
    list_triangles(grid, cubes, np.zeros(len(rows) + 1, np.int64), no_keys, totals)
    cubes = cubes._replace(rows=rows[totals > 0])
    totals = totals[totals > 0]
    start = np.concatenate([[0], np.cumsum(totals)])
    keys = np.empty((start[-1], 3), np.int64)
    list_triangles(grid, cubes, start, keys, totals)
    unique, corners = np.unique(keys, return_inverse=True)
    points = np.empty((len(unique), 3), np.float32)
    colours = np.zeros((len(unique), volume.settings.channels), np.uint8)
    place_vertices(grid, unique, low, volume.settings.voxel_m, points, colours)
    if colours.shape[1] == 1:
        colours = np.repeat(colours, 3, axis=1)
    return Mesh(points, corners.reshape(-1, 3).astype(np.int32), colours)
