"""Consecutive frames of a sequence, and whatever a perturbation changed about them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.odometry.protocol import Frame
from iclnuim.odometry.run import Sequence
from iclnuim.sensor.noise_model import frame_generator

#: Stream of a frame's generator (iclnuim.sensor.noise_model has DEPTH and RGB, 0 and 1).
PERTURBED = 2
#: Frames kept: what is seen between two frames needs both.
_KEPT = 8
#: Colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres, 0 = missing.
Images = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Frames `numbers` of a sequence, in order, and what a method is told: `camera`, and how far off its first guess is.

    true_camera: the one that took the images. load(number) gives a frame's images, of any frame of the sequence; truth has the poses of all.
    seed: with frame number and stream it decides all that is random.
    """

    camera: PinholeCamera
    true_camera: PinholeCamera
    numbers: tuple[int, ...]
    stamps_s: Mapping[int, float]
    truth: Trajectory
    load: Callable[[int], Images]
    seed: int = 0
    guess_off_deg: float = 0.0

    @classmethod
    def of(cls, sequence: Sequence, truth: Trajectory, start: int, frames: int, seed: int) -> "Stretch":
        """Frames start to start + frames of a sequence whose depth is planar. Raises InputError where it has not so many."""
        if start + frames > len(sequence.pairs):
            expected = f"at least {start + frames} frames"
            raise InputError(expected, path=sequence.folder, found=len(sequence.pairs), hint="another {frames}")
        pairs, stamps_s = sequence.pairs, {k: pair.stamp_s for k, pair in enumerate(sequence.pairs)}
        load = lru_cache(_KEPT)(lambda k: sequence.images(pairs[k]))
        camera, numbers = sequence.camera.pinhole, tuple(range(start, start + frames))
        return cls(camera, camera, numbers, stamps_s, truth, load, seed)

    def generator(self, number: int, stream: int = PERTURBED) -> np.random.Generator:
        """Of one frame alone: whatever else is done, it is the same."""
        return frame_generator(self.seed, number, stream)

    def pose(self, stamp_s: float) -> SE3:
        """T_world_camera at any time within the sequence, by a screw motion between two frames; at its ends the last pose."""
        return sample(self.truth, np.clip([stamp_s], *self.truth.stamps_s[[0, -1]]))[0]

    @property
    def middle(self) -> int:
        """The number of the frame half-way."""
        return self.numbers[len(self.numbers) // 2]

    def with_images(self, change: Callable[[int, np.ndarray, np.ndarray], Images]) -> "Stretch":
        """change(number, colour, depth) -> what is seen instead; the arrays given are not its own."""
        load = self.load
        return replace(self, load=lambda number: change(number, *load(number)))

    def frames(self) -> Iterator[tuple[float, Frame]]:
        """As a Tracker takes them."""
        for number in self.numbers:
            colour, depth_z_m = self.load(number)
            stamp_s = self.stamps_s[number]
            yield stamp_s, Frame.of(colour, depth_z_m, stamp_s)
