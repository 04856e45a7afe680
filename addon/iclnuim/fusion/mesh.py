"""Triangle meshes: what is taken out of a volume, as it goes or at the end."""

from dataclasses import dataclass

import numpy as np

from . import marching
from .fusing import UNIT
from .volume import Volume


@dataclass(frozen=True, eq=False)
class Mesh:
    """points (n, 3) in metres, triangles (m, 3) counter-clockwise from free space, colours (n, 3) uint8 or (n, 0)."""

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray

    @classmethod
    def joined(cls, parts: "list[Mesh]") -> "Mesh":
        """One mesh; vertices of different parts are not merged."""
        if not parts:
            return cls(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8))
        starts = np.cumsum([0, *(len(part.points) for part in parts)])
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=False)]),
            np.concatenate([part.colours for part in parts]),
        )


def extract(volume: Volume, leaves: np.ndarray | None = None, min_weight: float = 0.25) -> Mesh:
    """Marching cubes over all blocks, or over the cubes that have a corner in the rows where `leaves` (rows,) is true.

    So what is meshed when it leaves and what is meshed later meet without a gap and without an overlap. Only cubes whose
    corners were all seen `min_weight` times; views count less where they are slanted, and behind the surface.
    """
    grid, rows = volume.grid, volume.rows()
    if leaves is None:
        leaves = np.ones(len(grid.place), bool)
    else:
        rows = rows[_near(grid.place, rows, leaves)]
    if not len(rows):
        return Mesh.joined([])
    low = grid.place[rows].min(axis=0).astype(np.int64)
    common = (max(1.0, min_weight * UNIT), leaves, marching.EDGES, marching.COUNT, low)
    totals = np.zeros(len(rows), np.int64)
    marching.count_triangles(grid, rows, *common, totals)
    start = np.concatenate([[0], np.cumsum(totals)])
    keys = np.empty((start[-1], 3), np.int64)
    marching.list_triangles(grid, rows, *common, start, keys)
    unique, corners = np.unique(keys, return_inverse=True)
    points = np.empty((len(unique), 3), np.float32)
    colours = np.zeros((len(unique), volume.settings.channels), np.uint8)
    marching.place_vertices(grid, unique, low, volume.settings.voxel_m, points, colours)
    if colours.shape[1] == 1:
        colours = np.repeat(colours, 3, axis=1)
    return Mesh(points, corners.reshape(-1, 3).astype(np.int32), colours)


def _near(place: np.ndarray, rows: np.ndarray, leaves: np.ndarray) -> np.ndarray:
    """Of rows: which own a cube with a corner in a block that leaves, being that block or one below it."""
    side = marching.SIDE
    offset = place[rows].min(axis=0) - 1

    def key(blocks: np.ndarray) -> np.ndarray:
        x, y, z = (blocks - offset).astype(np.int64).T
        return (x * side + y) * side + z

    going = place[rows[leaves[rows]]]
    below = [going - (n >> 2, n >> 1 & 1, n & 1) for n in range(8)]
    return np.isin(key(place[rows]), key(np.concatenate(below)))
