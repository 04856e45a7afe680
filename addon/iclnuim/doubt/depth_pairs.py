"""Pairs of depth images in blocks, chosen by the motion between them, and how well they agree with
poses.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry import so3
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .depth_blocks import DepthBlocks

#: load(i): planar depth (h, w) in metres of frame i, 0 = missing; None if it cannot be read.
LoadDepth = Callable[[int], np.ndarray | None]

#: Of up to this number of frames all pairs are candidates. Of more, groups of frames at equal
#: distances are chosen in parts of the sequence.
_ALL_FRAMES = 12
_PARTS = 6
_GROUP = 4
_GAPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
#: Most motion between the images of a pair, so that they overlap: the angle in radians, and the
#: distance as a share of the depth.
_MOST_RAD = 0.3
_MOST_SHARE = 0.3
#: Share of points that may leave the image; more of them count as not agreeing.
_MAY_LEAVE = 0.4
#: Largest residual of a pair, also of images that do not overlap.
LARGEST = 0.2
_MIN_POINTS = 60
#: Differences that are computed at once, so that they need little memory.
_AT_ONCE = 100_000
#: Four neighbouring blocks of a larger relative range are of several surfaces.
_ONE_NEIGHBOURHOOD = 0.1


@dataclass(frozen=True, eq=False)
class DepthStack:
    """Depth images in blocks (see DepthBlocks) of one size: inverse_per_m (f, rows, columns), and
    points_m (f, n, 3), NaN behind those of an image with fewer than others.
    """

    camera: PinholeCamera
    size_px: int
    inverse_per_m: np.ndarray
    points_m: np.ndarray

    @classmethod
    def of(cls, images: Sequence[DepthBlocks]) -> "DepthStack":
        points_m = np.full((len(images), max(len(one.points_m) for one in images), 3), np.nan)
        for row, one in zip(points_m, images, strict=True):
            row[: len(one.points_m)] = one.points_m
        inverse = np.stack([one.inverse_per_m for one in images])
        return cls(images[0].camera, images[0].size_px, inverse, points_m)

    def thinned(self, step: int) -> "DepthStack":
        """The same with every `step`-th point."""
        return replace(self, points_m=self.points_m[:, ::step])

    def seen_by(self, camera: PinholeCamera) -> "DepthStack":
        """The same if another camera, of the same size, took the images."""
        own = self.camera
        x, y, z = np.moveaxis(self.points_m, -1, 0)
        u = own.fx * x / z + own.cx
        v = own.fy * y / z + own.cy
        moved = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
        return replace(self, camera=camera, points_m=moved)

    def along_rays(self) -> "DepthStack":
        """The same if the depth was the distance along the ray of a pixel."""
        rows, columns = self.inverse_per_m.shape[1:]
        x = ((np.arange(columns) + 0.5) * self.size_px - 0.5 - self.camera.cx) / self.camera.fx
        y = ((np.arange(rows) + 0.5) * self.size_px - 0.5 - self.camera.cy) / self.camera.fy
        lengths = np.sqrt(1 + x**2 + y[:, None] ** 2)
        of_points = np.linalg.norm(self.points_m, axis=-1, keepdims=True) / self.points_m[..., 2:]
        inverse_per_m = self.inverse_per_m * lengths
        return replace(self, inverse_per_m=inverse_per_m, points_m=self.points_m / of_points)

    def differences(self, first: np.ndarray, second: np.ndarray, T: SE3) -> np.ndarray:
        """(p, n) relative differences in depth between the points of the first images (p,), moved
        by T_second_first (p,), and the second images (p,): z - z' divided by their mean, from -2 to
        2. NaN where an image has no single surface, infinite for points outside of it.
        """
        points = self.points_m[first] @ np.swapaxes(T.rotation, -1, -2) + T.translation[:, None]
        size = self.size_px
        c = self.camera
        z = points[..., 2]
        with np.errstate(all="ignore"):
            u = (c.fx * points[..., 0] / z + c.cx - (size - 1) / 2) / size
            v = (c.fy * points[..., 1] / z + c.cy - (size - 1) / 2) / size
        rows, columns = self.inverse_per_m.shape[1:]
        inside = (z > 0) & (u >= 0) & (v >= 0) & (u < columns - 1) & (v < rows - 1)
        found = np.where(np.isnan(z), np.nan, np.inf)
        images = np.broadcast_to(second[:, None], z.shape)[inside]
        measured = self._interpolated(images, u[inside], v[inside])
        expected = 1 / z[inside]
        found[inside] = 2 * (measured - expected) / (measured + expected)
        return found

    def _interpolated(self, images: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(m,) bilinear interpolation at columns u and rows v of images; NaN between different
        surfaces.
        """
        column, row = u.astype(int), v.astype(int)
        share_x, share_y = u - column, v - row
        rows, columns = self.inverse_per_m.shape[1:]
        at = (images * rows + row) * columns + column
        corners = self.inverse_per_m.reshape(-1)[at + [[0], [1], [columns], [columns + 1]]]
        upper = corners[0] + share_x * (corners[1] - corners[0])
        lower = corners[2] + share_x * (corners[3] - corners[2])
        middle = upper + share_y * (lower - upper)
        spread = corners.max(axis=0) - corners.min(axis=0)
        return np.where(spread <= _ONE_NEIGHBOURHOOD * middle, middle, np.nan)


@dataclass(frozen=True, eq=False)
class DepthPairs:
    """first, second (p,): the frames of the pairs; images (p, 2): where theirs are in the stack.
    noise: median relative noise of a pixel, 0 if unknown.
    """

    first: np.ndarray
    second: np.ndarray
    images: np.ndarray
    stack: DepthStack
    noise: float

    @classmethod
    def of(cls, load: LoadDepth, T_world_camera: SE3, camera: PinholeCamera) -> "DepthPairs | None":
        """Pairs with much motion, and with motion that varies, according to the poses (n,); at
        most 36 of 24 frames. None if there are none.
        """
        depth_m = _usual_depth_m(load, len(T_world_camera), camera)
        first, second = _chosen(T_world_camera, depth_m)
        blocks = {}
        for frame in np.unique([first, second]).tolist():
            depth_z_m = load(frame)
            if depth_z_m is not None and depth_z_m.shape == (camera.height, camera.width):
                found = DepthBlocks.of(depth_z_m, camera)
                if len(found.points_m) >= _MIN_POINTS:
                    blocks[frame] = found
        return cls.between(first, second, blocks)

    @classmethod
    def between(
        cls, first: np.ndarray, second: np.ndarray, blocks: dict[int, DepthBlocks]
    ) -> "DepthPairs | None":
        """The pairs of frames (p,) whose depth is there."""
        frames = list(blocks)
        there = np.isin(first, frames) & np.isin(second, frames)
        if not there.any():
            return None
        first, second = first[there], second[there]
        images = np.searchsorted(frames, np.stack([first, second], -1))
        known = [one.noise for one in blocks.values() if np.isfinite(one.noise)]
        noise = float(np.median(known)) if known else 0.0
        return cls(first, second, images, DepthStack.of(list(blocks.values())), noise)

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, chosen: np.ndarray | slice) -> "DepthPairs":
        """Some of the pairs."""
        first, second, images = self.first[chosen], self.second[chosen], self.images[chosen]
        return replace(self, first=first, second=second, images=images)

    def seen(self, change: Callable[[DepthStack], DepthStack]) -> "DepthPairs":
        """The same pairs of changed images."""
        return replace(self, stack=change(self.stack))

    @property
    def depth_m(self) -> float:
        """Median depth of the images in metres."""
        return float(np.median(np.nanmedian(self.stack.points_m[..., 2], axis=1)))

    def relative(self, T_world_camera: SE3) -> SE3:
        """(p,) T_second_first of the pairs by the poses (n,)."""
        return T_world_camera[self.second].inverse() @ T_world_camera[self.first]

    def differences(self, T_second_first: SE3) -> np.ndarray:
        """(p, n) relative differences in depth of the points of the pairs; see DepthStack."""
        return self.stack.differences(self.images[:, 0], self.images[:, 1], T_second_first)

    def differences_of_all(self, motions: Sequence[SE3]) -> Iterator[np.ndarray]:
        """The differences (p, n) with each of the motions (p,) of the pairs."""
        count = max(1, _AT_ONCE // (len(self) * self.stack.points_m.shape[1]))
        for start in range(0, len(motions), count):
            part = motions[start : start + count]
            R = np.concatenate([one.rotation for one in part])
            t = np.concatenate([one.translation for one in part])
            first, second = np.tile(self.images.T, len(part))
            yield from np.split(self.stack.differences(first, second, SE3(R, t)), len(part))

    def residuals(self, T_second_first: SE3) -> np.ndarray:
        """(p,) median relative difference in depth of each pair, moved by (p,) motions; NaN for
        motions that are.
        """
        return self.medians(self.differences(T_second_first))

    def medians(self, differences: np.ndarray) -> np.ndarray:
        """(..., p) median sizes of differences (..., p, n), at most `LARGEST`; of infinite ones, those
        beyond `_MAY_LEAVE` of the points count. NaN if too little was measured.
        """
        points = np.isfinite(self.stack.points_m[..., 2]).sum(axis=1)[self.images[:, 0]]
        sizes = np.sort(np.abs(differences), axis=-1)
        finite = np.isfinite(sizes).sum(axis=-1)
        counted = np.isinf(sizes).sum(axis=-1) - (_MAY_LEAVE * points).astype(int)
        total = finite + np.maximum(counted, 0)
        places = np.stack([(total - 1) // 2, total // 2], -1).clip(0, sizes.shape[-1] - 1)
        middle = np.take_along_axis(sizes, places, axis=-1).clip(max=LARGEST).mean(axis=-1)
        few = finite < _MIN_POINTS / 2
        return np.where(few, np.where(counted > 0, LARGEST, np.nan), middle)


def depth_residuals(load: LoadDepth, readings: Sequence[SE3], camera: PinholeCamera) -> list[float]:
    """The relative difference in depth between n images with each reading of their poses (n,):
    the mean over pairs of the medians. NaN if no pair can be read.
    """
    pairs = DepthPairs.of(load, readings[0], camera)
    if pairs is None:
        return [float("nan")] * len(readings)
    every = np.array([pairs.residuals(pairs.relative(T)) for T in readings])
    measured = every[:, np.isfinite(every).all(0)]
    if not measured.size:
        return [float("nan")] * len(readings)
    return measured.mean(1).tolist()


def _usual_depth_m(load: LoadDepth, frames: int, camera: PinholeCamera) -> float:
    """Median depth of a frame that can be read; 1 m if there is none."""
    for frame in range(0, frames, max(1, frames // 4)):
        depth_z_m = load(frame)
        if depth_z_m is not None and (depth_z_m > 0).any():
            return float(np.median(depth_z_m[depth_z_m > 0]))
    return 1.0


def _chosen(T: SE3, depth_m: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second frames (p,) of the pairs."""
    if len(T) <= _ALL_FRAMES:
        first, second = np.triu_indices(len(T), 1)
        near = (_motion(T, first, second, depth_m) <= 1) | (second == first + 1)
        return first[near], second[near]
    frames = [_group(T, part, depth_m) for part in _parts(len(T))]
    inside = np.triu_indices(_GROUP, 1)
    return (
        np.concatenate([group[inside[0]] for group in frames]),
        np.concatenate([group[inside[1]] for group in frames]),
    )


def _parts(frames: int) -> list[np.ndarray]:
    """The numbers of the frames, in parts of the sequence."""
    return np.array_split(np.arange(frames), min(_PARTS, frames // _GROUP))


def _group(T: SE3, part: np.ndarray, depth_m: float) -> np.ndarray:
    """(_GROUP,) frames at equal distances in time, as far from each other as they overlap, where
    the motion is large and varies most.
    """
    best = part[:_GROUP]
    most = -np.inf
    for gap in _GAPS:
        reach = (_GROUP - 1) * gap
        starts = part[part + reach + 1 < len(T)]
        if not len(starts):
            break
        moved = _motion(T, starts, starts + reach, depth_m)
        varied = _variation(T, starts, starts + reach, depth_m)
        information = np.where(moved <= 1, np.sqrt(moved * varied), -moved)
        start = int(np.argmax(information))
        if information[start] > most:
            best = starts[start] + gap * np.arange(_GROUP)
            most = float(information[start])
    return best


def _motion(T: SE3, first: np.ndarray, second: np.ndarray, depth_m: float) -> np.ndarray:
    """(p,) motion from first to second, 1 where images may just overlap."""
    between = T[second].inverse() @ T[first]
    angles = so3.angle(between.rotation) / _MOST_RAD
    distances = np.linalg.norm(between.translation, axis=-1) / (_MOST_SHARE * depth_m)
    return np.maximum(angles, distances)


def _variation(T: SE3, first: np.ndarray, second: np.ndarray, depth_m: float) -> np.ndarray:
    """(p,) motion by which that from first to second differs from the same one frame later."""
    now = T[second].inverse() @ T[first]
    later = T[second + 1].inverse() @ T[first + 1]
    angles = so3.angle(now.rotation.swapaxes(-1, -2) @ later.rotation) / _MOST_RAD
    distances = np.linalg.norm(later.translation - now.translation, axis=-1)
    return np.maximum(angles, distances / (_MOST_SHARE * depth_m))
