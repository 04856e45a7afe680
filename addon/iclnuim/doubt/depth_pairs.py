"""Pairs of depth images, chosen by the motion between them, and how well they agree with poses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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


@dataclass(frozen=True, eq=False)
class DepthPairs:
    """first, second (p,): numbers of the frames of the pairs, whose depth is in `blocks`."""

    first: np.ndarray
    second: np.ndarray
    blocks: dict[int, DepthBlocks]

    @classmethod
    def of(cls, load: LoadDepth, T_world_camera: SE3, camera: PinholeCamera) -> "DepthPairs":
        """Pairs with much motion, and with motion that varies, according to the poses (n,); at
        most 36 of 24 frames.
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
        there = np.isin(first, list(blocks)) & np.isin(second, list(blocks))
        return cls(first[there], second[there], blocks)

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, chosen: np.ndarray | slice) -> "DepthPairs":
        """Some of the pairs."""
        return replace(self, first=self.first[chosen], second=self.second[chosen])

    def thinned(self, step: int) -> "DepthPairs":
        """The same pairs, with every `step`-th of their points."""
        return replace(self, blocks={i: one.thinned(step) for i, one in self.blocks.items()})

    @property
    def noise(self) -> float:
        """Median relative noise of a pixel; 0 if unknown."""
        known = [one.noise for one in self.blocks.values() if np.isfinite(one.noise)]
        return float(np.median(known)) if known else 0.0

    @property
    def depth_m(self) -> float:
        """Median depth of the images in metres."""
        return float(np.median([np.median(one.points_m[:, 2]) for one in self.blocks.values()]))

    @cached_property
    def along_rays(self) -> "DepthPairs":
        """The same pairs if their depth is the distance along the ray."""
        return replace(self, blocks={i: one.along_rays() for i, one in self.blocks.items()})

    def seen_by(self, camera: PinholeCamera) -> "DepthPairs":
        """The same pairs if their images are of another camera."""
        return replace(self, blocks={i: one.seen_by(camera) for i, one in self.blocks.items()})

    def relative(self, T_world_camera: SE3) -> SE3:
        """(p,) T_second_first of the pairs by the poses (n,)."""
        return T_world_camera[self.second].inverse() @ T_world_camera[self.first]

    def residuals(self, T_second_first: SE3) -> np.ndarray:
        """(p,) median relative difference in depth of each pair, moved by (p,) motions; NaN for
        motions that are.
        """
        found = np.full(len(self), np.nan)
        for pair in np.flatnonzero(np.isfinite(T_second_first.translation).all(-1)):
            a = int(self.first[pair])
            b = int(self.second[pair])
            every = self.blocks[b].residuals(T_second_first[pair], self.blocks[a].points_m)
            found[pair] = _median(every)
        return found


def depth_residuals(load: LoadDepth, readings: Sequence[SE3], camera: PinholeCamera) -> list[float]:
    """The relative difference in depth between n images with each reading of their poses (n,):
    the mean over pairs of the medians. NaN if no pair can be read.
    """
    pairs = DepthPairs.of(load, readings[0], camera)
    if not len(pairs):
        return [float("nan")] * len(readings)
    every = np.array([pairs.residuals(pairs.relative(T)) for T in readings])
    measured = every[:, np.isfinite(every).all(0)]
    if not measured.size:
        return [float("nan")] * len(readings)
    return measured.mean(1).tolist()


def _median(residuals: np.ndarray) -> float:
    """The median of residuals; of infinite ones, those beyond `_MAY_LEAVE` count. NaN if too little
    was measured.
    """
    finite = residuals[np.isfinite(residuals)]
    left = int(np.isinf(residuals).sum())
    counted = max(0, left - int(_MAY_LEAVE * len(residuals)))
    if len(finite) < _MIN_POINTS / 2:
        return LARGEST if counted else float("nan")
    return float(np.median(np.append(finite.clip(max=LARGEST), np.full(counted, LARGEST))))


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
