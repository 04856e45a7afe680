"""Pairs of poses of a ground truth and an estimate, as the explanations of a bad estimate compare
them: the error of all positions after an alignment, and the error of the motions between the poses
of each pair.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..evaluation.align import principal_extents, umeyama
from ..geometry import so3
from ..geometry.se3 import SE3
from .change import Change, applied
from .fit import Limits

#: Errors below this, in metres and radians, are rounding; those of lengths above 0.1 mm, the
#: resolution of files, are worth an explanation.
_ROUNDING = 1e-6
_WORTH_M = 1e-4
#: What an explanation leaves is at most this share of the ground truth's extent, or of its
#: motions: a failed estimate can always be shrunk to a point.
FITS_EXTENT = 0.35
_FITS_MOTION = 0.7
#: With a larger error of the turns (30 degrees) the estimate is another motion.
_OTHER_TURN_RAD = 0.5
#: More pairs than these take longer and tell nothing new.
_MAX_PAIRS = 2000


@dataclass(frozen=True)
class Comparison:
    """How poses are compared: over pairs `delta` frames apart; after the best scale, if the user
    asked for that; without rotations, if a file has none.
    """

    delta: int = 10
    with_scale: bool = False
    positions_only: bool = False


class Errors(NamedTuple):
    """RMS of position errors after the best alignment, of translations and of rotation angles of
    the motions between the poses of each pair.
    """

    position_m: float
    motion_m: float
    turn_rad: float


@dataclass(frozen=True, eq=False)
class ComparedPoses:
    """Associated poses of both trajectories: the m first poses of m pairs, then their m later ones.

    how: how errors are computed.
    """

    reference: SE3
    estimate: SE3
    how: "Comparison"
    _first: dict[Any, Change | None] = field(default_factory=dict)

    @classmethod
    def of(cls, reference: SE3, estimate: SE3, how: "Comparison", delta: int) -> "ComparedPoses":
        """Pairs of poses `delta` apart, of associated poses (n,) each, n > delta."""
        pairs = len(reference) - delta
        start = np.arange(0, pairs, -(-pairs // _MAX_PAIRS))
        rows = np.concatenate([start, start + delta])
        return cls(reference[rows], estimate[rows], how)

    def __len__(self) -> int:
        return len(self.reference) // 2

    def changed(self, reference: SE3, estimate: SE3) -> "ComparedPoses":
        return ComparedPoses(reference, estimate, self.how)

    def after(self, changes: Sequence[Change]) -> "ComparedPoses":
        return self.changed(*applied(changes, self.reference, self.estimate))

    def fitted(self, chain: Sequence[Any]) -> tuple[Change, ...] | None:
        """The changes of hypotheses, each fitted after those before it; None if one has none."""
        changes: list[Change] = []
        poses = self
        for hypothesis in chain:
            if poses is not self:
                change = hypothesis.fit(poses)
            elif hypothesis in self._first:
                change = self._first[hypothesis]
            else:
                change = self._first[hypothesis] = hypothesis.fit(self)
            if change is None:
                return None
            changes.append(change)
            poses = poses.after([change])
        return tuple(changes)

    def thinned(self, pairs: int) -> "ComparedPoses":
        """About so many of the pairs."""
        return self._pairs(np.arange(0, len(self), -(-len(self) // pairs)))

    @cached_property
    def halves(self) -> tuple["ComparedPoses", "ComparedPoses"]:
        """The pairs of the first and of the second half of the distance that the ground truth
        travels.
        """
        middle = middle_of_way(self.reference.translation[: len(self)])
        return self._pairs(np.arange(middle)), self._pairs(np.arange(middle, len(self)))

    def _pairs(self, pairs: np.ndarray) -> "ComparedPoses":
        rows = np.concatenate([pairs, pairs + len(self)])
        return self.changed(self.reference[rows], self.estimate[rows])

    def scale(self) -> float:
        """The factor of the estimate's positions that fits the ground truth's best."""
        x = self.estimate.translation
        if principal_extents(x)[0] == 0.0:
            return 1.0
        return umeyama(x, self.reference.translation, with_scale=True)[1]

    def motions(self) -> tuple[SE3, SE3]:
        """Motions (m,) of the ground truth and of the estimate between the poses of each pair."""
        return _motions(self.reference), _motions(self.estimate)

    @property
    def limits(self) -> Limits:
        extent_m, motion_m = self.sizes_m()
        return Limits(
            rounding=np.full(3, _ROUNDING),
            worth=np.array([_WORTH_M, _WORTH_M, np.inf]),
            largest=np.array([FITS_EXTENT * extent_m, _FITS_MOTION * motion_m, 0.0]),
            bearable=np.array([np.inf, np.inf, _OTHER_TURN_RAD]),
        )

    def sizes_m(self) -> tuple[float, float]:
        """Extent of the ground truth, and RMS of its motions."""
        extent_m = float(np.linalg.norm(principal_extents(self.reference.translation)))
        return extent_m, rms(_motions(self.reference).translation)

    @cached_property
    def errors(self) -> Errors:
        scale = self.scale() if self.how.with_scale else 1.0
        x = scale * self.estimate.translation
        y = self.reference.translation
        T, _ = umeyama(x, y)
        if self.how.positions_only:
            steps_m = _steps(y) - _steps(T.apply(x))
            return Errors(rms(y - T.apply(x)), rms(steps_m), 0.0)
        true, estimated = self.motions()
        turns = np.swapaxes(true.rotation, -1, -2) @ estimated.rotation
        return Errors(
            position_m=rms(y - T.apply(x)),
            motion_m=rms(scale * estimated.translation - true.translation),
            turn_rad=rms(so3.angle(turns)[:, None]),
        )


def middle_of_way(positions_m: np.ndarray) -> int:
    """The index in the middle of the distance that positions (n, 3) travel, in the middle half of
    all.
    """
    steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    travelled_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    middle = int(np.searchsorted(travelled_m, travelled_m[-1] / 2))
    quarter = len(positions_m) // 4
    return min(max(middle, quarter), len(positions_m) - quarter)


def rms(vectors: np.ndarray) -> float:
    """Root of the mean squared length of vectors (n, d)."""
    return float(np.sqrt(np.mean(np.sum(vectors * vectors, axis=-1))))


def _steps(positions_m: np.ndarray) -> np.ndarray:
    half = len(positions_m) // 2
    return positions_m[half:] - positions_m[:half]


def _motions(poses: SE3) -> SE3:
    half = len(poses) // 2
    return poses[:half].inverse() @ poses[half:]
