"""Depth against an independent judge: Embree (through open3d) casts the same rays at the same triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: A pixel lies on an edge where depth seen this far beside its centre does not continue the plane seen at the centre...
EDGE_OFFSET_PX = 0.1
#: ... to this share of its depth.
EDGE_TOLERANCE = 1e-4


@dataclass(frozen=True)
class DepthErrors:
    """|Z - Z of the rays| in metres over the pixels that are not on an edge; `edge_share` and `lost_share` are shares of all pixels.

    `lost` pixels see a surface in one of the two only.
    """

    pixels: int
    median_m: float
    p999_m: float
    max_m: float
    within_01mm_share: float
    edge_share: float
    lost_share: float


class RayCaster:
    """Casts planar-depth rays of a pinhole camera at triangles (vertices in metres, world)."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        import open3d

        self._tensor = open3d.core.Tensor
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._tensor(vertices.astype(np.float32)), self._tensor(triangles.astype(np.uint32)))

    def depth(
        self, camera: PinholeCamera, T_world_camera: SE3, offset_px: tuple[float, float] = (0.0, 0.0)
    ) -> np.ndarray:
        """(h, w) planar Z in metres, 0 where a ray meets nothing. Rays have z = 1, so the ray parameter is Z itself."""
        rays = camera.rays() + (offset_px[0] / camera.fx, offset_px[1] / camera.fy, 0.0)
        directions = rays @ T_world_camera.rotation.T
        origins = np.broadcast_to(T_world_camera.translation, directions.shape)
        packed = np.concatenate([origins, directions], -1).astype(np.float32)
        hits = self._scene.cast_rays(self._tensor(packed))["t_hit"].numpy()
        return np.where(np.isfinite(hits), hits, 0.0)


def edges(caster: RayCaster, camera: PinholeCamera, T_world_camera: SE3, centre: np.ndarray) -> np.ndarray:
    """(h, w) bool. On a plane 1/Z is linear in the image: its second difference over a tenth of a pixel vanishes."""
    found = np.zeros(centre.shape, bool)
    for axis in ((EDGE_OFFSET_PX, 0.0), (0.0, EDGE_OFFSET_PX)):
        sides = [caster.depth(camera, T_world_camera, (sign * axis[0], sign * axis[1])) for sign in (1, -1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.abs(centre / sides[0] + centre / sides[1] - 2.0)
        found |= ~(bend < EDGE_TOLERANCE)
    return found & ((centre > 0) | ~_nothing_around(caster, camera, T_world_camera))


def _nothing_around(caster: RayCaster, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
    offsets = ((EDGE_OFFSET_PX, 0.0), (-EDGE_OFFSET_PX, 0.0), (0.0, EDGE_OFFSET_PX), (0.0, -EDGE_OFFSET_PX))
    return np.all([caster.depth(camera, T_world_camera, o) == 0 for o in offsets], axis=0)


def compare(depth_z_m: np.ndarray, caster: RayCaster, camera: PinholeCamera, T_world_camera: SE3) -> np.ndarray:
    """(h, w) signed error in metres; NaN on edges, +-inf where one of the two sees nothing."""
    truth = caster.depth(camera, T_world_camera)
    error = depth_z_m.astype(float) - truth
    error[(depth_z_m > 0) != (truth > 0)] = np.inf
    error[edges(caster, camera, T_world_camera, truth)] = np.nan
    return error


def summary(errors: list[np.ndarray]) -> DepthErrors:
    """Statistics over the images of `compare`."""
    every = np.concatenate([e.ravel() for e in errors])
    inner = np.abs(every[~np.isnan(every)])
    finite = inner[np.isfinite(inner)]
    p50, p999 = np.percentile(finite, (50, 99.9)) if len(finite) else (np.nan, np.nan)
    return DepthErrors(
        pixels=len(every),
        median_m=float(p50),
        p999_m=float(p999),
        max_m=float(finite.max(initial=0.0)),
        within_01mm_share=float((inner <= 1e-4).mean()) if len(inner) else float("nan"),
        edge_share=float(np.isnan(every).mean()),
        lost_share=float(np.isinf(every).mean()),
    )
