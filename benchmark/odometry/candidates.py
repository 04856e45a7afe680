"""Ways to align two frames, and the rule that picks one of their results."""

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

from iclnuim.geometry.se3 import SE3

from .protocol import OdometryResult, OdometryStatus
from .solver import Pass, SolverLimits, solve
from .terms.depth import DepthTerm
from .terms.photometric import PhotometricTerm
from .terms.plane import PlaneTerm

One = TypeVar("One")
#: Where the images do not fit at the prediction, planes alone are trusted if this many times as
#: many points match. At the same motion the counts differ by less than 0.1 %.
MORE_INLIERS = 1.01


class Estimate(NamedTuple):
    """The result of a candidate; image: its finest photometric term, as last linearised; surface:
    its coarsest geometric one.
    """

    result: OdometryResult
    image: PhotometricTerm | None = None
    surface: PlaneTerm | None = None

    @property
    def failed(self) -> bool:
        return self.result.status is OdometryStatus.FAILED

    @property
    def T(self) -> SE3:
        return self.result.T_reference_camera

    @property
    def inliers(self) -> float:
        """Share of the points that match. Planes alone count only where they determine the motion,
        and have to match more.
        """
        if self.image:
            return self.result.inliers
        return (
            self.result.inliers / MORE_INLIERS if self.result.status is OdometryStatus.OK else 0.0
        )


class AlignmentCandidate(NamedTuple):
    """Where an alignment starts, the terms of its passes, and its limits with the prior. depth: the
    term that checks the result.
    """

    start: SE3
    passes: list[Pass]
    limits: SolverLimits
    image: PhotometricTerm | None = None
    surface: PlaneTerm | None = None
    depth: DepthTerm | None = None

    def estimate(self) -> Estimate:
        result = solve(self.passes, self.start, self.limits)
        if self.depth:
            result = self.depth.checked(result)
        return Estimate(result, self.image, self.surface)


def pick(
    first: One, others: Iterable[One], score: Callable[[One], float], margin: float = 1.0
) -> One:
    """The first one, or the best one of those that score more than `margin` times as much."""
    best = first
    limit = margin * score(first)
    for other in others:
        value = score(other)
        if value > limit:
            best = other
            limit = value
    return best
