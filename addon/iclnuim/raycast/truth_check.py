"""Instances and normals of frames against an independent judge: Embree casts the same rays, normals are interpolated over what they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..dataset.ground_truth import INSTANCE, NORMAL
from ..formats.scene_model import SceneModel
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: Where depth differs by more than this, pixel and ray met different surfaces: an outline.
_SAME_PLACE_M = 1e-4
#: What normals are promised to.
PROMISED_DEG = 0.1


@dataclass(frozen=True)
class TruthErrors:
    """Over pixels off outlines: shares of equal instances and of normals within PROMISED_DEG; angles in degrees. outline_share: of all pixels."""

    equal_instance_share: float
    normal_median_deg: float
    normal_p999_deg: float
    normal_within_share: float
    outline_share: float


class TruthJudge:
    """Rays at a scene model."""

    def __init__(self, model: SceneModel) -> None:
        import open3d

        self._model = model
        self._scene = open3d.t.geometry.RaycastingScene()
        order = np.arange(3 * len(model), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(model.corners_m.reshape(-1, 3).astype(np.float32), order)

    def look(self, camera: PinholeCamera, T_world_camera: SE3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(h, w) planar Z in metres, 0 where nothing is met; (h, w) instance; (h, w, 3) unit normal, cv camera's frame, of the side that is seen."""
        rays = camera.rays() @ T_world_camera.rotation.T
        packed = np.concatenate([np.broadcast_to(T_world_camera.translation, rays.shape), rays], -1).astype(np.float32)
        hit = self._scene.cast_rays(packed)
        depth_z_m = hit["t_hit"].numpy()
        seen = np.isfinite(depth_z_m)
        triangle = np.where(seen, hit["primitive_ids"].numpy().astype(np.int64), 0)
        u, v = np.moveaxis(hit["primitive_uvs"].numpy().astype(float), -1, 0)
        normal = np.einsum("hwk,hwkc->hwc", np.stack([1 - u - v, u, v], -1), self._model.normals[triangle])
        a, b, c = np.moveaxis(self._model.corners_m[triangle], -2, 0)
        behind = np.einsum("hwc,hwc->hw", np.cross(b - a, c - a), rays) > 0
        normal = np.where(behind[..., None], -normal, normal) @ T_world_camera.rotation
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        return np.where(seen, depth_z_m, 0), np.where(seen, self._model.instance[triangle], 0), normal

    def compare(
        self, frame: dict[str, np.ndarray], camera: PinholeCamera, T_world_camera: SE3
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Off outlines, of a frame's channels: (n,) whether instances are equal, (n,) degrees between normals; and the share of outlines."""
        depth_z_m, instance, normal = self.look(camera, T_world_camera)
        same = (depth_z_m > 0) & (np.abs(frame["Z"] - depth_z_m) < _SAME_PLACE_M)
        found = np.stack([frame[name] for name in NORMAL], -1).astype(float)
        chord = np.linalg.norm(found - normal, axis=-1)[same]
        return (frame[INSTANCE] == instance)[same], np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1))), 1 - same.mean()


def summary(found: list[tuple[np.ndarray, np.ndarray, float]]) -> TruthErrors:
    """Over all frames that `compare` was asked about."""
    equal, degrees = (np.concatenate([f[k] for f in found]) for k in (0, 1))
    if not len(equal):
        return TruthErrors(0.0, 180.0, 180.0, 0.0, 1.0)
    return TruthErrors(
        float(equal.mean()),
        float(np.median(degrees)),
        float(np.percentile(degrees, 99.9)),
        float((degrees < PROMISED_DEG).mean()),
        float(np.mean([f[2] for f in found])),
    )
