"""The competition of explanations: what an explanation must do to be named, whatever it is held
against.

All explanations compete by the errors that they leave. Each one is fitted on one half of the
evidence and judged on the other. The best one is named if it halves an error and makes none
worse, in both halves, and if no part of it does nearly as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .change import Change

#: An explanation leaves at most this share of an error ...
WORTH_SHARE = 0.5
#: ... and at most this share in each half.
HALF_SHARE = 0.9
#: Each fitted parameter has to reduce the product of the errors by this share.
PRICE = 0.2
#: Costs that differ by less may differ by noise.
_NEARLY = 1.0
#: Two mistakes at once leave at most these shares of what one may leave of lengths, and of an
#: error of turns with which nothing is explained.
_HALF = 0.5
_LITTLE = 0.2
#: Kinds that are parts of others.
_PARTS = {"body": {"rotation", "arm"}, "rate": {"offset"}}
#: Kinds that concern all errors of lengths.
_OF_ALL = {"scale", "offset", "rate", "rows"}


@dataclass(frozen=True, eq=False)
class Limits:
    """(k,) each, of k kinds of errors. rounding: smaller errors are none. worth: a larger error is
    worth an explanation; largest: what an explanation may leave of it. bearable: with a larger
    error nothing is explained.
    """

    rounding: np.ndarray
    worth: np.ndarray
    largest: np.ndarray
    bearable: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """Errors as given and as explained (3, k): in all, and in each half, where the explanation has
    the parameters that fit the other half.
    """

    given: np.ndarray
    found: np.ndarray
    limits: Limits

    def cost(self, parameters: int) -> float:
        """Mean logarithm of the product of the errors of each half, and the price of the fitted
        parameters.
        """
        product = np.log(np.maximum(self.found[1:], self.limits.rounding)).sum() / 2
        return float(product) + PRICE * parameters

    def explains(self, concerns_all: bool = False) -> bool:
        """Whether it halves an error and makes none of the others clearly worse; or makes all
        others of lengths clearly smaller, if it concerns them all.
        """
        left = self._left(self.given)[0]
        is_length = np.isfinite(self.limits.worth)
        most = np.where(is_length & concerns_all, HALF_SHARE, 1 / HALF_SHARE)
        if (self.found[0] > self.limits.bearable).any() or (left > most).any():
            return False
        fits = self.found[0] <= np.minimum(WORTH_SHARE * self.given[0], self.limits.largest)
        holds = (self.found[1:] <= HALF_SHARE * self.given[1:]).all(0)
        return bool((fits & holds & (self.given[0] > self.limits.worth)).any())

    def halves_errors_of(self, other: "Fit") -> bool:
        """Whether it leaves at most half of an error that another explanation leaves."""
        least = np.maximum(other.found[0], self.limits.rounding)
        return bool((self.found[0] <= WORTH_SHARE * least).any())

    @property
    def is_close(self) -> bool:
        """Whether it leaves clearly less than an explanation may."""
        is_length = np.isfinite(self.limits.worth)
        most = np.where(is_length, _HALF * self.limits.largest, _LITTLE * self.limits.bearable)
        return bool((self.found[0] <= most).all())

    def _left(self, of: np.ndarray) -> np.ndarray:
        """The share of errors that is left."""
        return (self.found + self.limits.rounding) / (of + self.limits.rounding)


@dataclass(frozen=True, eq=False)
class Candidate:
    """Changes, in the order in which they are applied, and how the changed poses fit."""

    changes: tuple[Change, ...]
    fit: Fit

    @property
    def kinds(self) -> list[str]:
        return [change.kind for change in self.changes]

    @property
    def free(self) -> int:
        """The number of fitted parameters."""
        return sum(change.free for change in self.changes)

    @property
    def cost(self) -> float:
        return self.fit.cost(self.free)

    def explains(self) -> bool:
        return self.fit.explains(concerns_all=set(self.kinds) <= _OF_ALL)

    def is_part_of(self, whole: "Candidate") -> bool:
        """Whether it is a simpler explanation of the same kinds."""
        fewer = len(self.changes) < len(whole.changes) or self.free < whole.free
        if not fewer and "offset" not in self.kinds:
            return False
        rest = list(whole.changes)
        for change in self.changes:
            same = [
                one
                for one in rest
                if one.of == change.of and change.kind in {one.kind, *_PARTS.get(one.kind, ())}
            ]
            if not same:
                return False
            rest.remove(same[0])
        return self is not whole


def winner(candidates: Sequence[Candidate]) -> Candidate | None:
    """The best explanation, or a part of it that explains nearly as much; None if there is none."""
    eligible = [one for one in candidates if len(one.changes) < 2 or _is_needed(one, candidates)]
    if not eligible:
        return None
    best = min(eligible, key=lambda candidate: candidate.cost)
    for rival in eligible if best.explains() else ():
        if _is_better(rival, best):
            best = rival
    for part in sorted(candidates, key=lambda candidate: candidate.cost):
        if part.is_part_of(best) and part.explains() and not best.fit.halves_errors_of(part.fit):
            best = part
    return best if best.explains() else None


def _is_better(rival: Candidate, best: Candidate) -> bool:
    """Whether it explains as simply, and leaves half of an error of which half the best one does
    not leave: noise of a fitted parameter costs it more in the halves than in all.
    """
    is_simple = len(rival.changes) <= len(best.changes) and rival.explains()
    better = rival.fit.halves_errors_of(best.fit) and not best.fit.halves_errors_of(rival.fit)
    return is_simple and better and rival.cost < best.cost + _NEARLY


def _is_needed(combined: Candidate, candidates: Sequence[Candidate]) -> bool:
    """Whether it explains, and clearly better than with one of its changes left out."""
    if not (combined.fit.is_close and combined.explains()):
        return False
    parts = [one for one in candidates if one.is_part_of(combined)]
    return all(
        combined.fit.halves_errors_of(part.fit)
        for part in parts
        if len(part.changes) < len(combined.changes)
    )
