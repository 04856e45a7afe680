"""How far a point is from the nearest surface of a scene, and what is seen from it: Embree, by way of open3d."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import WorkError


class SurfaceDistance:
    """Of triangles: vertices (n, 3) in metres and indices (m, 3). Raises WorkError where open3d is missing."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        try:
            import open3d
        except ImportError:
            raise WorkError("clearance needs the package open3d; try: pip install open3d-cpu") from None
        self._tensor: Any = open3d.core.Tensor
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._tensor(vertices.astype(np.float32)), self._tensor(triangles.astype(np.uint32)))

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) metres for points (n, 3)."""
        if not len(points_m):
            return np.zeros(0)
        return self._scene.compute_distance(self._tensor(points_m.astype(np.float32))).numpy().astype(float)

    def look(self, points_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n, d) along unit directions (d, 3), inf where nothing is met, and whether a back was met (n, d)."""
        shape = (len(points_m), len(directions), 3)
        rays = np.concatenate(
            [np.broadcast_to(points_m[:, None], shape), np.broadcast_to(directions[None], shape)], axis=-1
        )
        hit = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
        slant = (hit["primitive_normals"].numpy() * directions).sum(-1)
        distance = hit["t_hit"].numpy().astype(float)
        return distance, np.isfinite(distance) & (slant > 0)
