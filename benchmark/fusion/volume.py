"""A truncated signed distance volume in blocks of 8^3 voxels; only blocks near measured depth are
allocated.

R. Newcombe et al., "KinectFusion", ISMAR 2011, section 3.3, in a window that follows the camera as
in T. Whelan et al., "Kintinuous", RSS RGB-D workshop 2012: blocks that leave the window are passed
to a callback and released.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from . import kernels
from .settings import VolumeSettings

#: TILE: side in pixels of the tiles that share one depth range in a raycast. STRIDE: pixel step at
#: which a depth image allocates blocks.
TILE, STRIDE = 8, 2


class BlockLimitError(InputError):
    """One frame needs more blocks than max_blocks."""


@dataclass(frozen=True, eq=False)
class View:
    """Raycast of the volume: depth (h, w), normals_camera (h, w, 3) towards free space, colour (h,
    w, channels).

    float32, NaN where a ray hits nothing; normals are also NaN at the border of the observed
    region.
    """

    depth_z_m: np.ndarray
    normals_camera: np.ndarray
    colour: np.ndarray


def _empty_grid(s: VolumeSettings, rows: int) -> kernels.Grid:
    """A grid without blocks.

    The system allocates zeroed pages at the first write, so many rows take no memory until they are
    used.
    """
    return kernels.Grid(
        np.zeros(3, np.int64),
        np.zeros((s.window_blocks,) * 3, np.int32),
        np.zeros((rows, 3), np.int32),
        np.zeros((rows, 512), np.float32),
        np.zeros((rows, 512), np.uint16),
        np.zeros((rows, 512 if s.channels else 1, s.channels + 1), np.uint16),
        np.zeros(rows, bool),
    )


class Volume:
    """leaving(volume, leaves) is called before rows are released; leaves: bool (rows,), true for
    these rows.
    """

    def __init__(
        self,
        settings: VolumeSettings | None = None,
        leaving: "Callable[[Volume, np.ndarray], None] | None" = None,
    ) -> None:
        self.settings = s = settings or VolumeSettings()
        rows = s.max_blocks + 1
        try:
            self.grid = _empty_grid(s, rows)
            self._free = np.arange(rows - 1, 0, -1, dtype=np.int32)
            self._stamp, self._rows = np.zeros(rows, np.int32), np.zeros(rows, np.int32)
        except MemoryError:
            raise InputError(
                "blocks that fit into memory", setting="max_blocks", found=s.max_blocks
            ) from None
        self._n_free = s.max_blocks
        self._on_leaving, self._placed = leaving, False
        self.frames = self.max_used = self._tick = 0

    @property
    def blocks(self) -> int:
        """Number of allocated blocks."""
        return self.settings.max_blocks - self._n_free

    @property
    def bytes_used(self) -> int:
        """Peak memory of voxels and index."""
        g = self.grid
        per_block = sum(a[0].nbytes for a in (g.place, g.tsdf, g.weight, g.colour)) + 12
        return self.max_used * per_block + g.slots.nbytes

    def integrate(
        self,
        depth_m: np.ndarray,
        camera: PinholeCamera,
        T_world_camera: SE3,
        image: np.ndarray | None = None,
    ) -> None:
        """Fuse planar depth (h, w); 0, NaN and negative are missing. image: (h, w, channels),
        0..255.

        Raises InputError for wrong sizes or an invalid pose, BlockLimitError if one frame needs
        more than max_blocks.
        """
        depth, T = np.asarray(depth_m, np.float32), _checked_pose(T_world_camera)
        if depth.shape != (camera.height, camera.width):
            raise InputError(
                f"depth of the camera's size {camera.width}x{camera.height}",
                found=depth.shape[::-1],
            )
        image = self._checked(image, depth.shape)
        K, s = camera.intrinsics, self.settings
        usable = (depth > 0) & (depth < s.far_m)  # false for NaN
        inverse = np.divide(
            np.float32(1), depth, out=np.zeros_like(depth), where=usable
        )  # 0: missing or too far
        self.follow(T.translation)
        n = self._allocated(inverse, K, T)
        if n is None:
            rows = self.rows()  # memory is full: the half that is farthest from the camera leaves
            far = np.linalg.norm(self.grid.place[rows] * (8 * s.voxel_m) - T.translation, axis=1)
            self._release(rows[np.argsort(far, kind="stable")[len(rows) // 2 :]])
            n = self._allocated(inverse, K, T)
        if n is None:
            hint = "larger voxels or more blocks"
            raise BlockLimitError(f"a frame within {s.max_blocks} blocks", found="more", hint=hint)
        rule = (s.voxel_m, s.truncation_m, s.behind_m, s.slanted, s.max_weight * kernels.UNIT)
        kernels.fuse(self.grid, inverse, image, K, *_parts(T.inverse()), *rule, self._rows, n)
        self.frames += 1

    def raycast(
        self, camera: PinholeCamera, T_world_camera: SE3, normals: bool = True, colour: bool = True
    ) -> View:
        """Raycast of the surface: trilinear zero crossing, normals from the gradient."""
        T, shape = _checked_pose(T_world_camera), (camera.height, camera.width)
        view = View(
            np.full(shape, np.nan, np.float32),
            np.full((*shape, 3) if normals else (0, 0, 3), np.nan, np.float32),
            np.full((*shape, self.settings.channels) if colour else (0, 0, 3), np.nan, np.float32),
        )
        near, far = self._ranges(camera, T)
        arrays = (near, far, view.depth_z_m, view.normals_camera, view.colour)
        s = self.settings
        kernels.trace(
            self.grid, camera.intrinsics, *_parts(T), s.voxel_m, s.truncation_m, TILE, *arrays
        )
        return view

    def follow(self, centre_m: np.ndarray) -> None:
        """Move the window if its centre is two blocks or more from the camera; blocks outside it
        leave.
        """
        side, block_m = self.settings.window_blocks, 8 * self.settings.voxel_m
        first = np.floor(centre_m / block_m).astype(np.int64) - side // 2
        if self._placed and np.abs(first - self.grid.first).max() < 2:
            return
        rows = self.rows()
        place = self.grid.place[rows]
        self._release(rows[((place < first) | (place >= first + side)).any(axis=1)])
        self.grid.first[:] = first
        self._placed = True

    def rows(self) -> np.ndarray:
        """Allocated rows, sorted by the position of their blocks, so that the order does not depend
        on earlier releases.
        """
        used = np.ones(len(self._stamp), bool)
        used[0] = False
        used[self._free[: self._n_free]] = False
        rows = np.flatnonzero(used)
        place = self.grid.place[rows]
        return rows[np.lexsort((place[:, 2], place[:, 1], place[:, 0]))].astype(np.int32)

    def _ranges(self, camera: PinholeCamera, T: SE3) -> tuple[np.ndarray, np.ndarray]:
        """Depth range of the blocks with a surface per tile of the image, limited to far_m."""
        shape = (-(-camera.height // TILE), -(-camera.width // TILE))
        near, far = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
        K, voxel_m = camera.intrinsics, self.settings.voxel_m
        kernels.ranges(self.grid, self.max_used, K, *_parts(T.inverse()), voxel_m, TILE, near, far)
        return near, np.minimum(far, np.float32(self.settings.far_m))

    def _allocated(self, inverse: np.ndarray, K: np.ndarray, T: SE3) -> int | None:
        """Allocate the blocks near the depth image.

        Returns the number of rows listed in self._rows, None if max_blocks is not enough.
        """
        s = self.settings
        self._tick += 1
        state = (self._stamp, self._tick, self._free, self._n_free, self._rows)
        n, self._n_free, lost = kernels.touch(
            self.grid, inverse, K, *_parts(T), s.voxel_m, s.truncation_m, STRIDE, *state
        )
        self.max_used = max(self.max_used, self.blocks)
        return None if lost else n

    def _release(self, rows: np.ndarray) -> None:
        if not len(rows):
            return
        if self._on_leaving:
            leaves = np.zeros(len(self._stamp), bool)
            leaves[rows] = True
            self._on_leaving(self, leaves)
        slots = self.grid.place[rows] & (self.settings.window_blocks - 1)
        self.grid.slots[slots[:, 0], slots[:, 1], slots[:, 2]] = 0
        self.grid.tsdf[rows], self.grid.weight[rows], self.grid.colour[rows] = 0, 0, 0
        self.grid.inside[rows] = False
        self._stamp[rows] = 0
        self._free[self._n_free : self._n_free + len(rows)] = rows
        self._n_free += len(rows)

    def _checked(self, image: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
        channels = self.settings.channels
        if image is None or channels == 0:
            return np.zeros((1, 1, channels), np.float32)
        image = np.asarray(image)
        image = image[..., None] if image.ndim == 2 else image
        if image.shape != (*shape, channels):
            raise InputError(
                f"an image of the depth's size, {channels} channels", found=image.shape
            )
        return np.ascontiguousarray(
            image, np.float32
        )  # one type, compiled once; 0..255 is exact in it


def _parts(T: SE3) -> tuple[np.ndarray, np.ndarray]:
    return np.ascontiguousarray(T.rotation), np.ascontiguousarray(T.translation)


def _checked_pose(T: SE3) -> SE3:
    R = T.rotation
    if T.shape or not np.isfinite(T.matrix).all() or not np.allclose(R @ R.T, np.eye(3), atol=1e-4):
        raise InputError("a rigid pose T_world_camera of finite numbers", found=T)
    return T
