"""Rays against triangles, and distances to them: Embree, by way of open3d. Nothing else here or in fusion asks it for rays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, WorkError
from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays of leading shape (...) meet first.

    distance (...): in lengths of the ray's direction, inf where nothing is met. triangle (...): int64, -1 where nothing is met.
    uv (..., 2): barycentric weights of the triangle's second and third corner. normal (..., 3): of the triangle, of length one.
    """

    distance: np.ndarray
    triangle: np.ndarray
    uv: np.ndarray
    normal: np.ndarray


class RayCaster:
    """Of triangles (m, 3), indices into vertices (n, 3) in metres, world.

    Raises InputError for no triangles, WorkError where open3d is missing.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        open3d: Any
        try:
            import open3d
        except ImportError:
            raise WorkError("ray casting needs the package open3d; try: pip install open3d-cpu") from None
        self._tensor, self._scene = open3d.core.Tensor, open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._packed(vertices), self._tensor(np.ascontiguousarray(triangles, np.uint32)))

    @classmethod
    def of_model(cls, model: SceneModel) -> "RayCaster":
        """Triangle k is the model's."""
        return cls(model.corners_m.reshape(-1, 3), np.arange(3 * len(model)).reshape(-1, 3))

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Rays of directions (..., 3), of any length, from origins (..., 3) or one origin (3,)."""
        hit = self._scene.cast_rays(
            self._packed(np.concatenate([np.broadcast_to(origins, directions.shape), directions], -1))
        )
        distance = hit["t_hit"].numpy()
        triangle = np.where(np.isfinite(distance), hit["primitive_ids"].numpy().astype(np.int64), -1)
        return Hits(distance, triangle, hit["primitive_uvs"].numpy(), hit["primitive_normals"].numpy())

    def closest(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) nearest points of the surface to points (n, 3), and the unit normals (n, 3) of their triangles; float32."""
        found = self._scene.compute_closest_points(self._packed(points_m))
        return found["points"].numpy(), found["primitive_normals"].numpy()

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) metres from points (n, 3) to the surface."""
        if not len(points_m):
            return np.zeros(0)
        return self._scene.compute_distance(self._packed(points_m)).numpy().astype(float)

    def depth(
        self, camera: PinholeCamera, T_world_camera: SE3, offset_px: tuple[float, float] = (0.0, 0.0)
    ) -> np.ndarray:
        """(h, w) planar Z in metres, 0 where a ray meets nothing. Rays have z = 1, so the distance along them is Z itself."""
        rays = camera.rays() + (offset_px[0] / camera.fx, offset_px[1] / camera.fy, 0.0)
        distance = self.cast(T_world_camera.translation, rays @ T_world_camera.rotation.T).distance
        return np.where(np.isfinite(distance), distance, 0.0)

    def _packed(self, numbers: np.ndarray) -> Any:
        return self._tensor(np.ascontiguousarray(numbers, np.float32))
