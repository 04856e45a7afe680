"""Distances from points to triangles, exact in double precision (libigl's AABB tree), for meshes of
any size with bounded memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, WorkError
from ..geometry.triangles import check_mesh

#: Maximum number of triangles in a tree, which then takes 0.4 GB; larger meshes are processed in
#: slabs, one after the other.
SLAB_TRIANGLES = 2_000_000


@dataclass(frozen=True, eq=False)
class Nearest:
    """For n points: distance_m (n,), the nearest triangle (n,) int64, and the nearest point on it,
    point_m (n, 3); both float64.
    """

    distance_m: np.ndarray
    triangle: np.ndarray
    point_m: np.ndarray


class TriangleDistance:
    """Distances to triangles (m, 3), indices into vertices (n, 3) in metres; at most `slab` of them
    in a tree.

    Raises InputError if there are no triangles or their indices are wrong, WorkError if libigl is
    missing.
    """

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, slab: int = SLAB_TRIANGLES
    ) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        try:
            import igl
        except ImportError:
            raise WorkError(
                "distances to a surface need the package libigl; try: pip install libigl"
            ) from None
        self._new_tree: Any = igl.AABB
        self.vertices = np.ascontiguousarray(vertices, float)
        check_mesh(self.vertices, np.asarray(triangles))
        self.triangles = np.ascontiguousarray(triangles, np.int64)
        self._tree = self._build_tree(self.triangles) if len(triangles) <= slab else None
        self._slab = slab

    def nearest(self, points_m: np.ndarray) -> Nearest:
        """The nearest triangles of points (n, 3)."""
        points_m = np.ascontiguousarray(points_m, float)
        found = Nearest(
            np.full(len(points_m), np.inf),
            np.zeros(len(points_m), np.int64),
            np.zeros(points_m.shape),
        )
        if not len(points_m):
            return found
        if self._tree is not None:
            return self._query(self._tree, self.triangles, points_m)
        for rows in slabs(self.vertices, self.triangles, self._slab):
            part = self.triangles[rows]
            corners = self.vertices[part]
            to_box_m = _distance_to_box(points_m, corners.min((0, 1)), corners.max((0, 1)))
            del corners
            # skip points that are farther from the slab's box than from the triangles of an earlier
            # slab
            candidates = np.flatnonzero(to_box_m < found.distance_m)
            if not len(candidates):
                continue
            part_nearest = self._query(self._build_tree(part), part, points_m[candidates])
            closer = part_nearest.distance_m < found.distance_m[candidates]
            found.distance_m[candidates[closer]] = part_nearest.distance_m[closer]
            found.triangle[candidates[closer]] = rows[part_nearest.triangle[closer]]
            found.point_m[candidates[closer]] = part_nearest.point_m[closer]
        return found

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) distances in metres of points (n, 3)."""
        return self.nearest(points_m).distance_m

    def normals(self, triangle: np.ndarray) -> np.ndarray:
        """(n, 3) unit normals of triangles (n,), zero for a triangle without area."""
        a, b, c = np.moveaxis(self.vertices[self.triangles[triangle]], 1, 0)
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)

    def _build_tree(self, triangles: np.ndarray) -> Any:
        tree = self._new_tree()
        tree.init(self.vertices, triangles)
        return tree

    def _query(self, tree: Any, triangles: np.ndarray, points_m: np.ndarray) -> Nearest:
        squared, triangle, point_m = tree.squared_distance(self.vertices, triangles, points_m)
        return Nearest(np.sqrt(squared), triangle, point_m)


def slabs(
    vertices: np.ndarray, triangles: np.ndarray, max_triangles: int = SLAB_TRIANGLES
) -> Iterator[np.ndarray]:
    """Rows of triangles (m, 3), at most `max_triangles` at a time; each part is a slab
    perpendicular to the longest side of the mesh.
    """
    if len(triangles) <= max_triangles:
        yield np.arange(len(triangles))
        return
    axis = int(np.ptp(vertices, axis=0).argmax())
    order = np.argsort(vertices[triangles[:, 0], axis].astype(np.float32), kind="stable")
    for start in range(0, len(order), max_triangles):
        yield order[start : start + max_triangles]


def _distance_to_box(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - points.clip(low, high), axis=1)
