"""A truncated signed distance volume in blocks of 8^3 voxels: only what depth touches takes memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera

from . import kernels


@dataclass(frozen=True)
class VolumeSettings:
    """Metres; the truncation is the paper's (VI-C), the voxel that of its 4.5 m in 512. Colour 0..255."""

    voxel_m: float = 4.5 / 512
    truncation_m: float = 0.045
    extent_m: float = 18.0
    max_weight: float = 255.0
    max_blocks: int = 60_000
    far_m: float = 8.0


@dataclass(frozen=True)
class View:
    """What the volume shows to a camera: (h, w), (h, w, 3) three times; world frame; NaN where nothing is hit."""

    depth_m: np.ndarray
    points_world: np.ndarray
    normals_world: np.ndarray
    rgb: np.ndarray


class Volume:
    """Centred on the first camera; what lies outside the extent is left out."""

    def __init__(self, settings: VolumeSettings | None = None):
        self.settings = settings or VolumeSettings()
        side = int(np.ceil(self.settings.extent_m / (8 * self.settings.voxel_m)))
        self._index = np.full((side,) * 3, -1, np.int32)
        self._stamp = np.zeros((side,) * 3, np.int32)
        n = self.settings.max_blocks
        # Zeroed pages are handed out when first written, so the bound costs nothing until it is used.
        self._tsdf, self._weight = np.zeros((n, 512), np.float32), np.zeros((n, 512), np.float32)
        self._colour = np.zeros((n, 512, 3), np.float32)
        self._rows = np.zeros((n, 3), np.int32)
        self._origin: np.ndarray | None = None
        self.blocks = self.frames = 0

    def integrate(self, depth_m, camera: PinholeCamera, T_world_camera, rgb=None) -> None:
        """Fuse planar depth (h, w); 0, NaN and negative are missing. InputError: sizes, pose, or the memory bound is met."""
        depth, T = np.ascontiguousarray(depth_m, np.float32), _pose(T_world_camera)
        if depth.shape != (camera.height, camera.width):
            raise InputError(f"depth of {camera.width}x{camera.height} as the camera has it", found=depth.shape[::-1])
        if rgb is not None and np.shape(rgb) != (*depth.shape, 3):
            raise InputError("colour of the depth's size, three channels", found=np.shape(rgb))
        depth = np.where(np.isfinite(depth) & (depth > 0) & (depth < self.settings.far_m), depth, np.float32(0))
        if self._origin is None:
            self._origin = T[:3, 3] - self._index.shape[0] * 4 * self.settings.voxel_m
        self.frames += 1
        s, K = self.settings, _intrinsics(camera)
        n, self.blocks, lost = kernels.touch(depth, K, T[:3, :3].copy(), T[:3, 3].copy(), self._origin, s.voxel_m,
                                             s.truncation_m, self._index, self._stamp, self.frames, self._rows, self.blocks)
        inverse = np.linalg.inv(T)
        colour = np.zeros((1, 1, 3), np.uint8) if rgb is None else np.ascontiguousarray(rgb)
        kernels.fuse(depth, colour, rgb is not None, K, inverse[:3, :3].copy(), inverse[:3, 3].copy(), self._origin,
                     s.voxel_m, s.truncation_m, s.max_weight, self._rows, n, self._index, self._tsdf, self._weight, self._colour)
        if lost:
            raise InputError(f"a scene within {s.max_blocks} blocks", found="more", hint="larger voxels or a larger max_blocks")

    def raycast(self, camera: PinholeCamera, T_world_camera) -> View:
        """The surface as the camera would see it: trilinear zero crossing, normals from the gradient, towards free space."""
        T, shape = _pose(T_world_camera), (camera.height, camera.width)
        depth, normals, rgb = np.full(shape, np.nan), np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
        if self._origin is not None:
            kernels.trace(_intrinsics(camera), T[:3, :3].copy(), T[:3, 3].copy(), self._origin, self.settings.voxel_m,
                          self.settings.far_m, self._index, self._tsdf, self._weight, self._colour, depth, normals, rgb)
        v, u = np.mgrid[: camera.height, : camera.width]
        rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(shape)], axis=-1)
        return View(depth, (rays * depth[..., None]) @ T[:3, :3].T + T[:3, 3], normals, rgb)


def _intrinsics(camera: PinholeCamera) -> np.ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])


def _pose(T_world_camera) -> np.ndarray:
    T = np.asarray(T_world_camera, float)
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-4):
        raise InputError("a rigid 4x4 pose T_world_camera of finite numbers", found=T.shape)
    return T
