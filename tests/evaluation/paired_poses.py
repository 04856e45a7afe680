"""Poses that belong to each other by their index, through the errors of trajectories."""

from typing import NamedTuple

import numpy as np
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.relative_error import relative_error
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory


class Pairs(NamedTuple):
    reference: SE3
    estimate: SE3
    stamps_s: np.ndarray

    @classmethod
    def of_poses(cls, reference, estimate, rate_hz=30.0):
        return cls(reference, estimate, np.arange(len(reference)) / rate_hz)

    def trajectories(self):
        return Trajectory(self.stamps_s, self.reference), Trajectory(self.stamps_s, self.estimate)


def absolute_error_of_pairs(pairs, alignment=None):
    return absolute_error(
        *pairs.trajectories(), AbsoluteErrorSettings(alignment=alignment or AlignmentSettings())
    )


def relative_error_of_pairs(pairs, settings):
    return relative_error(*pairs.trajectories(), settings)
