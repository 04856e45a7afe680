"""A truncated signed distance volume in blocks of 8^3 voxels; only blocks near measured depth are
allocated.

R. Newcombe et al., "KinectFusion", ISMAR 2011, section 3.3, in a window that follows the camera as
in T. Whelan et al., "Kintinuous", RSS RGB-D workshop 2012: blocks that leave the window are passed
to a callback and released.
"""

from collections.abc import Callable

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from .fuse_kernels import Pool, fuse, touch
from .grid import UNIT, CameraPose, Grid, Rule
from .settings import VolumeSettings
from .trace_kernels import TILE, RaycastView, ranges, trace


class BlockLimitError(InputError):
    """One frame needs more blocks than max_blocks."""


def _empty_grid(s: VolumeSettings, rows: int) -> Grid:
    """A grid without blocks.

    The system allocates zeroed pages at the first write, so many rows take no memory until they are
    used.
    """
    coloured = 512 if s.channels else 1
    return Grid(
        first=np.zeros(3, np.int64),
        slots=np.zeros((s.window_blocks,) * 3, np.int32),
        place=np.zeros((rows, 3), np.int32),
        tsdf=np.zeros((rows, 512), np.float32),
        weight=np.zeros((rows, 512), np.uint16),
        colour=np.zeros((rows, coloured, s.channels + 1), np.uint16),
        inside=np.zeros(rows, bool),
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
            self._pool = Pool(
                free=np.arange(rows - 1, 0, -1, dtype=np.int32),
                listed=np.zeros(rows, np.int32),
                seen=np.zeros(rows, np.int32),
                state=np.array([s.max_blocks, 0, 0]),
            )
        except MemoryError:
            raise InputError(
                "blocks that fit into memory", setting="max_blocks", found=s.max_blocks
            ) from None
        self._rule = Rule(
            voxel=s.voxel_m,
            trunc=s.truncation_m,
            behind=s.behind_m,
            slanted=s.slanted,
            max_weight=s.max_weight * UNIT,
        )
        self._ahead_m = s.ahead * s.window_blocks * 8 * s.voxel_m / 2
        self._on_leaving = leaving
        self._placed = False
        self.frames = 0
        self.max_used = 0

    @property
    def blocks(self) -> int:
        """Number of allocated blocks."""
        return self.settings.max_blocks - int(self._pool.state[0])

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
        depth = np.asarray(depth_m, np.float32)
        T = _checked_pose(T_world_camera)
        if depth.shape != (camera.height, camera.width):
            raise InputError(
                f"depth of the camera's size {camera.width}x{camera.height}",
                found=depth.shape[::-1],
            )
        image = self._checked(image, depth.shape)
        usable = (depth > 0) & (depth < self.settings.far_m)  # false for NaN
        inverse = np.zeros_like(depth)  # 0: missing or too far
        np.divide(np.float32(1), depth, out=inverse, where=usable)
        self.follow(T.translation + self._ahead_m * T.rotation[:, 2])
        lost = self._allocate(inverse, camera, T)
        if lost:
            self._release(self._farther_half(T.translation))
            lost = self._allocate(inverse, camera, T)
        if lost:
            raise BlockLimitError(
                f"a frame within {self.settings.max_blocks} blocks",
                found="more",
                hint="larger voxels or more blocks",
            )
        rows = self._pool.listed[: self._pool.state[1]]
        fuse(self.grid, inverse, image, _camera_pose(camera, T.inverse()), self._rule, rows)
        self.frames += 1

    def raycast(
        self, camera: PinholeCamera, T_world_camera: SE3, normals: bool = True, colour: bool = True
    ) -> RaycastView:
        """Raycast of the surface: trilinear zero crossing, normals from the gradient."""
        T = _checked_pose(T_world_camera)
        shape = (camera.height, camera.width)
        channels = self.settings.channels
        view = RaycastView(
            np.full(shape, np.nan, np.float32),
            np.full((*shape, 3) if normals else (0, 0, 3), np.nan, np.float32),
            np.full((*shape, channels) if colour else (0, 0, 3), np.nan, np.float32),
        )
        trace(self.grid, _camera_pose(camera, T), self._rule, self._reach(camera, T), view)
        return view

    def follow(self, centre_m: np.ndarray) -> None:
        """Move the window if its centre is two blocks or more from centre_m; blocks outside it
        leave.
        """
        side = self.settings.window_blocks
        first = np.floor(centre_m / (8 * self.settings.voxel_m)).astype(np.int64) - side // 2
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
        used = np.ones(len(self._pool.seen), bool)
        used[0] = False
        used[self._pool.free[: self._pool.state[0]]] = False
        rows = np.flatnonzero(used)
        place = self.grid.place[rows]
        return rows[np.lexsort((place[:, 2], place[:, 1], place[:, 0]))].astype(np.int32)

    def _reach(self, camera: PinholeCamera, T: SE3) -> np.ndarray:
        """(2, h, w): depth range of the blocks with a surface per tile of the image, limited to
        far_m.
        """
        reach = np.zeros((2, -(-camera.height // TILE), -(-camera.width // TILE)), np.float32)
        reach[0] = np.inf
        pose = _camera_pose(camera, T.inverse())
        ranges(self.grid, self.max_used, pose, self.settings.voxel_m, reach)
        reach[1] = np.minimum(reach[1], np.float32(self.settings.far_m))
        return reach

    def _allocate(self, inverse: np.ndarray, camera: PinholeCamera, T: SE3) -> int:
        """List and allocate the blocks near the depth image. Returns the number of those for which
        max_blocks is not enough.
        """
        lost = touch(self.grid, inverse, _camera_pose(camera, T), self._rule, self._pool)
        self.max_used = max(self.max_used, self.blocks)
        return lost

    def _farther_half(self, centre_m: np.ndarray) -> np.ndarray:
        """The half of the allocated rows that is farthest from a place."""
        rows = self.rows()
        places_m = self.grid.place[rows] * (8 * self.settings.voxel_m)
        order = np.argsort(np.linalg.norm(places_m - centre_m, axis=1), kind="stable")
        return rows[order[len(rows) // 2 :]]

    def _release(self, rows: np.ndarray) -> None:
        if not len(rows):
            return
        if self._on_leaving:
            leaves = np.zeros(len(self._pool.seen), bool)
            leaves[rows] = True
            self._on_leaving(self, leaves)
        slots = self.grid.place[rows] & (self.settings.window_blocks - 1)
        self.grid.slots[slots[:, 0], slots[:, 1], slots[:, 2]] = 0
        for values in (self.grid.tsdf, self.grid.weight, self.grid.colour, self.grid.inside):
            values[rows] = 0
        self._pool.seen[rows] = 0
        free = self._pool.state[0]
        self._pool.free[free : free + len(rows)] = rows
        self._pool.state[0] += len(rows)

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
        # one type, compiled once; 0..255 is exact in it
        return np.ascontiguousarray(image, np.float32)


def _camera_pose(camera: PinholeCamera, T: SE3) -> CameraPose:
    rotation = np.ascontiguousarray(T.rotation)
    return CameraPose(camera.intrinsics, rotation, np.ascontiguousarray(T.translation))


def _checked_pose(T: SE3) -> SE3:
    R = T.rotation
    if T.shape or not np.isfinite(T.matrix).all() or not np.allclose(R @ R.T, np.eye(3), atol=1e-4):
        raise InputError("a rigid pose T_world_camera of finite numbers", found=T)
    return T
