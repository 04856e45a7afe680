"""A ground truth and an estimate on a time axis: which poses are compared, in all and in each half
of the way, each with the axis that fits the other half.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..evaluation.associate import AssociationSettings, associate
from ..geometry.trajectory import Trajectory
from .change import Change
from .compared_poses import ComparedPoses, Comparison, middle_of_way
from .time_axis import (
    POSITIONS,
    SCALED_POSITIONS,
    Curve,
    OtherTime,
    TimeAxis,
    moved_onto_stamps,
    refined,
    rounded,
)

#: Pairs of poses in each half.
_MIN_PAIRS = 5
_LEAST = (2 * _MIN_PAIRS, _MIN_PAIRS, _MIN_PAIRS)


@dataclass(frozen=True, eq=False)
class View:
    """Poses as compared at these stamps: in all, in the first and in the second half, and as they
    are given (None where those cannot be compared). time: the change of the stamps, if there is
    one.
    """

    given: tuple[ComparedPoses | None, ...]
    found: tuple[ComparedPoses, ...]
    time: Change | None = None

    @property
    def whole(self) -> ComparedPoses:
        return self.found[0]


@dataclass(frozen=True, eq=False)
class Clock:
    """Another time axis of an estimate, whose stamps are `stamped`; curve: with which it fits."""

    kind: str
    free: int
    stamped: Trajectory
    axis: TimeAxis
    curve: Curve = POSITIONS


@dataclass(frozen=True, eq=False)
class Compared:
    """Two trajectories, and how they are compared."""

    reference: Trajectory
    estimate: Trajectory
    settings: AssociationSettings
    how: Comparison

    def poses(self, estimate: Trajectory, least: int = 2 * _MIN_PAIRS) -> ComparedPoses | None:
        """Associated poses; None if they make fewer than `least` pairs."""
        reference = self.reference
        pairs = associate(reference.stamps_s, estimate.stamps_s, self.settings)
        delta = min(self.how.delta, max(1, len(pairs) // 4))
        if len(pairs) - delta < least:
            return None
        first = reference.T_world_camera[pairs.first]
        second = estimate.T_world_camera[pairs.second]
        return ComparedPoses.of(first, second, self.how, delta)

    def as_given(self) -> View | None:
        poses = self.poses(self.estimate)
        if poses is None:
            return None
        every = (poses, *poses.halves)
        return View(every, every)

    def at(
        self, clock: Clock, seen: Callable[[Trajectory], Trajectory] | None = None
    ) -> View | None:
        """The view at another time; seen: the estimate's poses as the axis is refined with them."""
        reference = self.reference
        plain = replace(self, settings=replace(self.settings, offset_s=0.0))
        stamped = clock.stamped
        axis = clock.axis
        curve = clock.curve
        if seen is None:
            seen = _as_read
        else:
            curve = self.positions
            axis = refined(reference, seen(stamped), axis, clock.free, curve)
            axis = rounded(reference, seen(stamped), axis, curve)
        axis = moved_onto_stamps(reference.stamps_s, stamped.stamps_s, axis, self.settings)
        whole = axis.applied(stamped)
        rows = np.unique(associate(reference.stamps_s, whole.stamps_s, plain.settings).second)
        middle = middle_of_way(self.estimate.positions_m[rows])
        halves = rows[:middle], rows[middle:]
        parts = [whole[rows]]
        for half, other in (halves, halves[::-1]):
            crossed = refined(reference, seen(stamped[other]), axis, clock.free, curve)
            crossed = moved_onto_stamps(
                reference.stamps_s, stamped[half].stamps_s, crossed, self.settings
            )
            parts.append(crossed.applied(stamped[half]))
        found = []
        given = []
        for part, same, least in zip(parts, (rows, *halves), _LEAST, strict=True):
            poses = plain.poses(part, least)
            if poses is None:
                return None
            found.append(poses)
            given.append(self.poses(self.estimate[same], least))
        time = OtherTime(axis, whole.stamps_s)
        change = Change(clock.kind, time=time, free=clock.free, parameters=axis.to_dict())
        return View(tuple(given), tuple(found), change)

    @property
    def positions(self) -> Curve:
        """Positions as the alignment that was asked for compares them."""
        return SCALED_POSITIONS if self.how.with_scale else POSITIONS


def _as_read(trajectory: Trajectory) -> Trajectory:
    return trajectory
