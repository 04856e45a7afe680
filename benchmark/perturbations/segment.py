"""Consecutive frames of a sequence, with the changes made by a perturbation."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from iclnuim.benchmark.odometry.protocol import Frame
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.sensor.noise_model import frame_generator

#: Stream of a frame's generator (iclnuim.sensor.noise_model has DEPTH and RGB, 0 and 1).
PERTURBED = 2
#: Colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres, 0 = missing.
Images = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Segment:
    """Frames `numbers` of a sequence in order. camera: the camera given to the method.
    guess_off_deg: rotation error of its initial guess.

    true_camera: the camera that took the images. load(number): images of any frame of the sequence.
    truth: the poses of all frames. seed: with frame number and stream, it seeds all random numbers.
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
    def of(
        cls, sequence: Sequence, truth: Trajectory, start: int, frames: int, seed: int
    ) -> "Segment":
        """Frames start to start + frames of a sequence with planar depth.

        Raises InputError if it has fewer frames.
        """
        if start + frames > len(sequence.pairs):
            raise InputError(
                f"at least {start + frames} frames",
                path=sequence.folder,
                found=len(sequence.pairs),
                hint="another {frames}",
            )
        pairs = sequence.pairs
        camera = sequence.camera.pinhole
        return cls(
            camera=camera,
            true_camera=camera,
            numbers=tuple(range(start, start + frames)),
            stamps_s={number: pair.stamp_s for number, pair in enumerate(pairs)},
            truth=truth,
            load=lru_cache(8)(lambda number: sequence.images(pairs[number])),
            seed=seed,
        )

    def generator(self, number: int, stream: int = PERTURBED) -> np.random.Generator:
        """Random generator of one frame; it does not depend on other frames or on their order."""
        return frame_generator(self.seed, number, stream)

    def pose(self, stamp_s: float) -> SE3:
        """T_world_camera at any time, interpolated by a screw motion between two frames; beyond the
        ends of the sequence, its first or last pose.
        """
        return sample(self.truth, np.clip([stamp_s], *self.truth.stamps_s[[0, -1]]))[0]

    @property
    def middle(self) -> int:
        """The number of the frame half-way."""
        return self.numbers[len(self.numbers) // 2]

    def with_images(self, change: Callable[[int, np.ndarray, np.ndarray], Images]) -> "Segment":
        """The segment with changed images: change(number, colour, depth) returns new arrays and
        must not modify its arguments.
        """
        load = self.load
        return replace(self, load=lambda number: change(number, *load(number)))

    def with_colour(self, change: Callable[[int, np.ndarray], np.ndarray]) -> "Segment":
        """The same for change(number, colour); depth stays as it is."""
        return self.with_images(lambda number, colour, z: (change(number, colour), z))

    def with_depth(self, change: Callable[[int, np.ndarray], np.ndarray]) -> "Segment":
        """The same for change(number, depth); colour stays as it is."""
        return self.with_images(lambda number, colour, z: (colour, change(number, z)))

    def frames(self) -> Iterator[tuple[float, Frame]]:
        """(stamp in seconds, frame) for a Tracker."""
        for number in self.numbers:
            colour, depth_z_m = self.load(number)
            stamp_s = self.stamps_s[number]
            yield stamp_s, Frame.of(colour, depth_z_m, stamp_s)
