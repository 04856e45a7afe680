"""Which part of a surface a camera saw on its way, by Embree: rays through pixels, and rays to the middle of what no pixel met."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: A triangle's middle is seen where the ray to it gets this far, in shares of the way.
_ARRIVED = 1 - 1e-4
FRONT, BACK = 0, 1


class Onlooker:
    """Counts up what is seen of a model; `seen` (m, 2) says it of each triangle's front and back."""

    def __init__(self, model: SceneModel) -> None:
        import open3d

        self._scene = open3d.t.geometry.RaycastingScene()
        order = np.arange(3 * len(model), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(model.corners_m.reshape(-1, 3).astype(np.float32), order)
        self._middle = model.corners_m.mean(1)
        a, b, c = np.moveaxis(model.corners_m, 1, 0)
        self._normal = np.cross(b - a, c - a)
        self.seen = np.zeros((len(model), 2), bool)

    def look(self, camera: PinholeCamera, T_world_camera: SE3) -> None:
        """From one pose: what pixel centres see, then what has its middle in the picture and nothing before it."""
        rays = camera.rays().reshape(-1, 3) @ T_world_camera.rotation.T
        met, _ = self._cast(T_world_camera.translation, rays)
        self._note(met[met >= 0], rays[met >= 0])
        rows = self._in_picture(camera, T_world_camera)
        ways = self._middle[rows] - T_world_camera.translation
        met, reached = self._cast(T_world_camera.translation, ways)
        open_way = (met == rows) | (reached > _ARRIVED)
        self._note(rows[open_way], ways[open_way])

    def along(
        self, camera: PinholeCamera, T_world_camera: SE3, on_pose: Callable[[], object] = lambda: None
    ) -> np.ndarray:
        """From all poses (n,); the mask (m, 2) so far."""
        for k in range(len(T_world_camera.translation)):
            self.look(camera, T_world_camera[k])
            on_pose()
        return self.seen

    def _in_picture(self, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
        """(k,) triangles, their shown side not seen yet, whose middle projects into the picture."""
        towards = np.einsum("ij,ij->i", self._middle - T_world_camera.translation, self._normal) < 0
        rows = np.flatnonzero(~np.where(towards, self.seen[:, FRONT], self.seen[:, BACK]))
        points = T_world_camera.inverse().apply(self._middle[rows])
        before = points[:, 2] > 1e-3
        rows, points = rows[before], points[before]
        u, v = camera.project(points).T
        inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
        return rows[inside]

    def _cast(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangle met by each ray (-1: none), and how far along the ray."""
        packed = np.concatenate([np.broadcast_to(origin, rays.shape), rays], -1).astype(np.float32)
        hit = self._scene.cast_rays(packed)
        met = hit["primitive_ids"].numpy().astype(np.int64)
        return np.where(met < len(self.seen), met, -1), hit["t_hit"].numpy()

    def _note(self, rows: np.ndarray, rays: np.ndarray) -> None:
        side = np.where(np.einsum("ij,ij->i", rays, self._normal[rows]) < 0, FRONT, BACK)
        self.seen[rows, side] = True
