"""Rays and distances of the open scene by Blender's own tree: an extension has neither Embree nor
libigl.
"""

import numpy as np
from mathutils.bvhtree import BVHTree

from ..raycast.caster import Hits


class SurfaceTree:
    """A tree of triangles (m, 3), indices into vertices (n, 3) in metres, in single precision."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._tree = BVHTree.FromPolygons(vertices.tolist(), triangles.tolist(), all_triangles=True)

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """The first hits of rays with directions (..., 3) from origins (..., 3) or (3,). Their `uv`
        are 0: Blender has none.
        """
        shape = directions.shape[:-1]
        starts = np.broadcast_to(origins, (*shape, 3)).reshape(-1, 3)
        distance = np.full(len(starts), np.inf)
        triangle = np.full(len(starts), -1)
        normal = np.zeros((len(starts), 3))
        rays = zip(starts.tolist(), directions.reshape(-1, 3).tolist(), strict=True)
        for k, (start, along) in enumerate(rays):
            _, found, index, away_m = self._tree.ray_cast(start, along)
            if index is not None:
                distance[k], triangle[k], normal[k] = away_m, index, found
        distance = distance.reshape(shape) / np.linalg.norm(directions, axis=-1)
        return Hits(
            distance, triangle.reshape(shape), np.zeros((*shape, 2)), normal.reshape(*shape, 3)
        )

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) distances in metres of points (n, 3)."""
        return np.array([self._tree.find_nearest(point)[3] for point in points_m.tolist()])
