"""Which triangles a camera saw along a trajectory: rays through pixels, and rays to the centroids of triangles that no pixel met."""

from collections.abc import Callable

import numpy as np

from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .caster import RayCaster

#: A centroid is seen where the ray to it gets this far, as a share of its length.
_ARRIVED = 1 - 1e-4
FRONT, BACK = 0, 1


class Visibility:
    """Which triangles of a model were seen from the poses added so far: `seen` (m, 2), front and back of each."""

    def __init__(self, model: SceneModel) -> None:
        self._caster = RayCaster.of_model(model)
        self._centroid = model.corners_m.mean(1)
        a, b, c = np.moveaxis(model.corners_m, 1, 0)
        self._normal = np.cross(b - a, c - a)
        self.seen = np.zeros((len(model), 2), bool)

    def add(self, camera: PinholeCamera, T_world_camera: SE3) -> None:
        """One pose: what pixel centres see, then triangles whose centroid is in the image with nothing in front of it."""
        rays = camera.rays().reshape(-1, 3) @ T_world_camera.rotation.T
        triangle = self._caster.cast(T_world_camera.translation, rays).triangle
        self._mark(triangle[triangle >= 0], rays[triangle >= 0])
        rows = self._in_image(camera, T_world_camera)
        rays = self._centroid[rows] - T_world_camera.translation
        hits = self._caster.cast(T_world_camera.translation, rays)
        reached = (hits.triangle == rows) | (hits.distance > _ARRIVED)
        self._mark(rows[reached], rays[reached])

    def along(
        self, camera: PinholeCamera, T_world_camera: SE3, on_pose: Callable[[], object] = lambda: None
    ) -> np.ndarray:
        """Add all poses (n,); returns the mask (m, 2) so far."""
        for k in range(len(T_world_camera)):
            self.add(camera, T_world_camera[k])
            on_pose()
        return self.seen

    def _in_image(self, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
        """(k,) triangles whose visible side was not seen yet and whose centroid projects into the image."""
        towards = np.einsum("ij,ij->i", self._centroid - T_world_camera.translation, self._normal) < 0
        rows = np.flatnonzero(~np.where(towards, self.seen[:, FRONT], self.seen[:, BACK]))
        points = T_world_camera.inverse().apply(self._centroid[rows])
        in_front = points[:, 2] > 1e-3
        rows, points = rows[in_front], points[in_front]
        u, v = camera.project(points).T
        inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
        return rows[inside]

    def _mark(self, rows: np.ndarray, rays: np.ndarray) -> None:
        side = np.where(np.einsum("ij,ij->i", rays, self._normal[rows]) < 0, FRONT, BACK)
        self.seen[rows, side] = True
