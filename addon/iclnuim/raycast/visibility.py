"""What cameras saw of a surface: triangles, or points on it."""

from collections.abc import Callable

import numpy as np

from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .caster import RayCaster

#: A centroid is visible if the ray to it reaches this share of its length.
_ARRIVED = 1 - 1e-4
#: The same for a point on the surface in double precision: Embree uses single precision. At 3 m a
#: point 0.1 mm behind a surface is visible.
_REACHED = 1 - 3e-5
#: Columns of Visibility.seen.
FRONT, BACK = 0, 1


class Visibility:
    """Visibility of the triangles of a model from all poses added so far: `seen` (m, 2), front and
    back of each.

    It is computed by rays through pixels, and by rays to the centroids of triangles that no pixel
    hit.
    """

    def __init__(self, model: SceneModel) -> None:
        self._caster = RayCaster.of_model(model)
        self._centroid = model.corners_m.mean(1)
        a, b, c = np.moveaxis(model.corners_m, 1, 0)
        self._normal = np.cross(b - a, c - a)
        self.seen = np.zeros((len(model), 2), bool)

    def along(
        self, camera: PinholeCamera, T_world_camera: SE3, on_pose: Callable[[], object]
    ) -> None:
        """Add poses (n,): the triangles at pixel centres, then those whose centroid is in the image
        and not occluded.
        """
        for k in range(len(T_world_camera)):
            T = T_world_camera[k]
            rays = camera.rays().reshape(-1, 3) @ T.rotation.T
            triangle = self._caster.cast(T.translation, rays).triangle
            self._mark(triangle[triangle >= 0], rays[triangle >= 0])
            rows = self._in_image(camera, T)
            rays = self._centroid[rows] - T.translation
            hits = self._caster.cast(T.translation, rays)
            reached = (hits.triangle == rows) | (hits.distance > _ARRIVED)
            self._mark(rows[reached], rays[reached])
            on_pose()

    def _in_image(self, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
        """(k,) triangles whose side towards the camera was not seen yet, and whose centroid
        projects into the image.
        """
        rays = self._centroid - T_world_camera.translation
        towards = np.einsum("ij,ij->i", rays, self._normal) < 0
        rows = np.flatnonzero(~np.where(towards, self.seen[:, FRONT], self.seen[:, BACK]))
        return rows[_in_image(self._centroid[rows], camera, T_world_camera)]

    def _mark(self, rows: np.ndarray, rays: np.ndarray) -> None:
        side = np.where(np.einsum("ij,ij->i", rays, self._normal[rows]) < 0, FRONT, BACK)
        self.seen[rows, side] = True


def seen_points(
    caster: RayCaster,
    points_m: np.ndarray,
    camera: PinholeCamera,
    T_world_camera: SE3,
    far_m: float = np.inf,
    on_pose: Callable[[], object] | None = None,
    sides: np.ndarray | None = None,
) -> np.ndarray:
    """(n,) bool: the points (n, 3) on the surface that at least one pose (k,) saw: inside its
    image, in front of it, at a depth of at most far_m, and not occluded. With normals `sides` (n,
    3): seen from that side of the surface.
    """
    seen = np.zeros(len(points_m), bool)
    for k in range(len(T_world_camera)):
        rows = np.flatnonzero(~seen)
        rows = rows[_in_image(points_m[rows], camera, T_world_camera[k], far_m)]
        rays = points_m[rows] - T_world_camera[k].translation
        if sides is not None:
            before = (rays * sides[rows]).sum(1) < 0
            rows = rows[before]
            rays = rays[before]
        seen[rows] = caster.cast(T_world_camera[k].translation, rays).distance > _REACHED
        if on_pose:
            on_pose()
    return seen


def _in_image(
    points_m: np.ndarray, camera: PinholeCamera, T_world_camera: SE3, far_m: float = np.inf
) -> np.ndarray:
    """(n,) bool: in front of the camera, at a depth of at most far_m, and inside the image; points
    (n, 3) in the world.
    """
    points = T_world_camera.inverse().apply(points_m)
    inside = (points[:, 2] > 1e-3) & (points[:, 2] <= far_m)
    u, v = camera.project(points[inside]).T
    inside[inside] = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    return inside
