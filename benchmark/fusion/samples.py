"""Points sampled uniformly by area on a surface, with a seed; their density does not depend on how
finely a mesh or a cloud is divided.
"""

import numpy as np
from iclnuim.errors import InputError

#: A cloud has one sample per cell of this side, so that parts that were scanned more often do not
#: count more.
CELL_M = 0.005
#: Number of triangles whose areas are computed at once.
_AT_ONCE = 1_000_000
#: Steps of the low-discrepancy sequence in a square: 1/g and 1/g^2 of the plastic number g (Roberts
#: 2018, R2).
_R2 = np.array([0.7548776662466927, 0.5698402909980532])


def sampled(points: np.ndarray, triangles: np.ndarray, count: int, seed: int) -> np.ndarray:
    """(count, 3) points, uniform by area on triangles (m, 3): stratified, one in each 1/count of
    the area in the order of the triangles.

    Raises InputError if no triangle has an area.
    """
    rng = np.random.default_rng(seed)
    until_m2 = np.cumsum(areas_m2(points, triangles))
    if not until_m2[-1] > 0:
        raise InputError("triangles with an area", found=f"{len(triangles)} without")
    at_m2 = (np.arange(count) + rng.random()) * (until_m2[-1] / count)
    rows = np.searchsorted(until_m2, at_m2, side="right").clip(max=len(triangles) - 1)
    corners = points[triangles[rows]]
    uv = (rng.random(2) + np.arange(count)[:, None] * _R2) % 1
    beyond = uv.sum(axis=1, keepdims=True) > 1  # the other half of the square, rotated onto
    u, v = np.where(beyond, 1 - uv, uv).T[..., None]
    return (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]


def thinned(points: np.ndarray, count: int, seed: int) -> np.ndarray:
    """At most `count` of the points (n, 3) of a cloud: the first of each cell of CELL_M."""
    cells = np.floor((points - points.min(0)) / CELL_M).astype(np.int64)
    sides = cells.max(0) + 1
    keys = (cells[:, 0] * sides[1] + cells[:, 1]) * sides[2] + cells[:, 2]
    first = np.unique(keys, return_index=True)[1]
    if len(first) > count:
        start = np.random.default_rng(seed).random()
        first = first[((np.arange(count) + start) * (len(first) / count)).astype(int)]
    return points[first]


def within_reach(
    corners: np.ndarray, places: np.ndarray, reach_m: float, longest_m: float = 1.0
) -> np.ndarray:
    """(k, 3, 3): the parts of triangles (m, 3, 3) that can be within reach_m of places (n, 3); long
    ones are halved until no edge exceeds longest_m.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(places)
    found = [np.zeros((0, 3, 3))]
    while len(corners):
        middle = corners.mean(1)
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
        corners = corners[tree.query(middle)[0] <= reach_m + radius]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        small = edges.max(1, initial=0) <= longest_m
        found.append(corners[small])
        order = (edges[~small].argmax(1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[~small], order[..., None], 1), 1, 0)
        half = (a + b) / 2
        corners = np.stack([a, half, c, half, b, c], 1).reshape(-1, 3, 3)
    return np.concatenate(found)


def areas_m2(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(m,) areas of triangles (m, 3)."""
    found = np.empty(len(triangles))
    for start in range(0, len(triangles), _AT_ONCE):
        a, b, c = np.moveaxis(points[triangles[start : start + _AT_ONCE]], 1, 0)
        found[start : start + _AT_ONCE] = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return found
