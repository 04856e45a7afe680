"""Ray casting of triangles.

This is the only module that uses Embree (embreex).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..errors import InputError, WorkError
from ..formats.scene_model import SceneModel
from ..geometry.camera import CameraOrText, PinholeCamera
from ..geometry.se3 import SE3, Poses
from ..geometry.triangles import check_mesh


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of rays of leading shape (...).

    distance (...): in lengths of the ray's direction, inf without a hit. triangle (...): int64, -1
    without a hit. uv (..., 2): barycentric weights of the triangle's second and third corner.
    normal (..., 3): unit normal of the triangle.
    """

    distance: np.ndarray
    triangle: np.ndarray
    uv: np.ndarray
    normal: np.ndarray


class Caster(Protocol):
    """What casts rays: Embree here, Blender's tree in its window (ui/surface_tree.py)."""

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Cast rays with directions (..., 3) from origins (..., 3) or one origin (3,)."""


class RayCaster:
    """Casts rays at triangles (m, 3), indices into vertices (n, 3) in metres, world. held_out (m,):
    triangles without depth that still occlude.

    Raises InputError if there are no triangles or invalid indices, WorkError if embreex is missing.
    """

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, held_out: np.ndarray | None = None
    ) -> None:
        if not len(triangles):
            raise InputError("a surface with triangles", found="none")
        check_mesh(np.asarray(vertices), np.asarray(triangles))
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError:
            raise WorkError(
                "ray casting needs the package embreex; try: pip install embreex"
            ) from None
        self._scene: Any = EmbreeScene()
        self._held_out = held_out if held_out is not None and held_out.any() else None
        TriangleMesh(self._scene, _packed(vertices), np.ascontiguousarray(triangles, np.int32))

    @classmethod
    def of_model(cls, model: SceneModel) -> "RayCaster":
        """A caster whose triangle k is that of the model."""
        return cls(model.corners_m.reshape(-1, 3), np.arange(3 * len(model)).reshape(-1, 3))

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Cast rays with directions (..., 3), of any length, from origins (..., 3) or one origin
        (3,).
        """
        shape = directions.shape[:-1]
        starts = np.broadcast_to(origins, (*shape, 3)).reshape(-1, 3)
        hit = self._scene.run(_packed(starts), _packed(directions.reshape(-1, 3)), output=True)
        triangle = hit["primID"].astype(np.int64)
        distance = np.where(triangle >= 0, hit["tfar"], np.float32(np.inf))
        uv = np.stack([hit["u"], hit["v"]], -1)
        length = np.linalg.norm(hit["Ng"], axis=-1, keepdims=True)
        normal = hit["Ng"] / np.maximum(length, np.float32(1e-30))
        return Hits(
            distance.reshape(shape),
            triangle.reshape(shape),
            uv.reshape(*shape, 2),
            normal.reshape(*shape, 3),
        )

    def depth(
        self, camera: CameraOrText, T_world_camera: Poses, offset_px: Sequence[float] = (0.0, 0.0)
    ) -> np.ndarray:
        """(h, w) planar Z in metres, 0 without a hit, of one pose or its matrix (4, 4).

        Rays have z = 1, so the distance along them is Z.
        """
        camera = PinholeCamera.of(camera)
        T_world_camera = SE3.of(T_world_camera)
        rays = camera.rays() + (offset_px[0] / camera.fx, offset_px[1] / camera.fy, 0.0)
        hits = self.cast(T_world_camera.translation, rays @ T_world_camera.rotation.T)
        met = hits.triangle >= 0
        if self._held_out is not None:
            met &= ~self._held_out[hits.triangle]
        return np.where(met, hits.distance, 0.0)


def _packed(numbers: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(numbers, np.float32)
