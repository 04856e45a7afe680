"""Distances from points to triangles, exact in double precision (libigl's tree of boxes), of meshes of any size within bounded memory."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, WorkError

#: Triangles in one tree, which then takes 0.4 GB; larger meshes are cut into slabs, one after the other.
SLAB_TRIANGLES = 2_000_000


@dataclass(frozen=True, eq=False)
class Nearest:
    """Of n points: distance_m (n,), the nearest triangle (n,) int64, and the nearest point on it (n, 3), all float64."""

    distance_m: np.ndarray
    triangle: np.ndarray
    point_m: np.ndarray


class TriangleDistance:
    """To triangles (m, 3), indices into vertices (n, 3) in metres; `slab` of them in a tree.

    Raises InputError for no triangles, WorkError where libigl is missing.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, slab: int = SLAB_TRIANGLES) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        try:
            import igl
        except ImportError:
            raise WorkError("distances to a surface need the package libigl; try: pip install libigl") from None
        self._new_tree: Any = igl.AABB
        self.vertices, self.triangles = np.ascontiguousarray(vertices, float), np.ascontiguousarray(triangles, np.int64)
        self._tree = self._planted(self.triangles) if len(triangles) <= slab else None
        self._slab = slab

    def nearest(self, points_m: np.ndarray) -> Nearest:
        """Of points (n, 3)."""
        points_m = np.ascontiguousarray(points_m, float)
        found = Nearest(np.full(len(points_m), np.inf), np.zeros(len(points_m), np.int64), np.zeros(points_m.shape))
        if not len(points_m):
            return found
        if self._tree is not None:
            return self._asked(self._tree, self.triangles, points_m)
        for rows in slabs(self.vertices, self.triangles, self._slab):
            part = self.triangles[rows]
            corners = self.vertices[part]
            low, high = corners.min((0, 1)), corners.max((0, 1))
            del corners
            # what lies farther from the slab's box than from an earlier slab's triangles need not be asked about
            ask = np.flatnonzero(_distance_to_box(points_m, low, high) < found.distance_m)
            if not len(ask):
                continue
            here = self._asked(self._planted(part), part, points_m[ask])
            closer = here.distance_m < found.distance_m[ask]
            found.distance_m[ask[closer]] = here.distance_m[closer]
            found.triangle[ask[closer]] = rows[here.triangle[closer]]
            found.point_m[ask[closer]] = here.point_m[closer]
        return found

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) metres from points (n, 3)."""
        return self.nearest(points_m).distance_m

    def normals(self, triangle: np.ndarray) -> np.ndarray:
        """(n, 3) unit normals of triangles (n,), zero where one has no area."""
        a, b, c = np.moveaxis(self.vertices[self.triangles[triangle]], 1, 0)
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)

    def _planted(self, triangles: np.ndarray) -> Any:
        tree = self._new_tree()
        tree.init(self.vertices, triangles)
        return tree

    def _asked(self, tree: Any, triangles: np.ndarray, points_m: np.ndarray) -> Nearest:
        squared, triangle, point_m = tree.squared_distance(self.vertices, triangles, points_m)
        return Nearest(np.sqrt(squared), triangle, point_m)


def slabs(vertices: np.ndarray, triangles: np.ndarray, most: int = SLAB_TRIANGLES) -> Iterator[np.ndarray]:
    """Rows of triangles (m, 3), at most `most` at a time, cut across the mesh's longest side so that each lies in a slab."""
    if len(triangles) <= most:
        yield np.arange(len(triangles))
        return
    axis = int(np.ptp(vertices, axis=0).argmax())
    order = np.argsort(vertices[triangles[:, 0], axis].astype(np.float32), kind="stable")
    for start in range(0, len(order), most):
        yield order[start : start + most]


def _distance_to_box(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - points.clip(low, high), axis=1)
