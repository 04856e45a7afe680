"""The competition of explanations: what an explanation must do to be named, whatever it is held
against.

All explanations compete by the errors that they leave. Each one is fitted on one half of the
evidence and judged on the other. The best one is named if it halves an error and makes none
worse, in both halves, and if no part of it does nearly as well.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .change import Change
from .fit import Fit, Limits

#: Costs that differ by less may differ by noise.
_NEARLY = 1.0
#: Explanations that leave less than this multiple of what the best one leaves are nearly as good.
_RIVALS = 1.25
#: Kinds that are parts of others.
_PARTS = {"body": {"rotation", "arm"}, "rate": {"offset"}}
#: Kinds that concern all errors of lengths.
_OF_ALL = {"scale", "offset", "rate", "rows"}


class Evidence(Protocol):
    """What explanations are held against: poses, depth images, a surface. errors (k,): as it is;
    after: as it is after changes; fitted: the changes of hypotheses that fit it best one after the
    other, None if one has none.
    """

    @property
    def errors(self) -> Sequence[float]: ...

    @property
    def limits(self) -> Limits: ...

    def after(self, changes: Sequence[Change]) -> "Evidence": ...

    def fitted(self, chain: Sequence[Any]) -> tuple[Change, ...] | None: ...


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
        concerns_all = set(self.kinds) <= _OF_ALL
        return self.fit.explains(concerns_all) and self.fit.pays(self.free)

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


def candidate(
    parts: Sequence[Evidence],
    chain: Sequence[Any],
    given: Sequence[Evidence | None] | None = None,
    before: tuple[Change, ...] = (),
) -> Candidate | None:
    """Hypotheses one after the other; None if one of them has no change.

    parts: the evidence, and its halves. given: those as given, None where they cannot be compared,
    if the parts are what changes `before` made of them.
    """
    whole, *halves = parts
    sets = [part.fitted(chain) for part in (whole, *halves[::-1])]
    changes = sets[0]
    if changes is None:
        return None
    found = [part.after(one or ()).errors for one, part in zip(sets, parts, strict=True)]
    limits = whole.after(changes).limits
    errors = [part.errors if part else limits.failed for part in given or parts]
    return Candidate((*before, *changes), Fit(np.array(errors), np.array(found), limits))


def screened(few: Evidence, chains: Iterable[Sequence[Any]]) -> list[tuple[float, Sequence[Any]]]:
    """Chains of hypotheses with the costs of the errors that they leave of little evidence, on
    which they are fitted.
    """
    found = []
    for chain in chains:
        if (changes := few.fitted(chain)) is not None:
            errors = np.array([few.after(changes).errors] * 3)
            free = sum(one.free for one in changes)
            found.append((Fit(errors, errors, few.limits).cost(free), chain))
    return found


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


def rivals(best: Candidate, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Explanations by other kinds, as many, that leave nearly as little as the best one, whatever
    the price of their parameters.
    """
    most = _RIVALS * best.fit.found[0]
    return [
        one
        for one in candidates
        if len(one.kinds) == len(best.kinds)
        and set(one.kinds) != set(best.kinds)
        and (one.fit.found[0] < most).all()
        and one.explains()
    ]


def in_common(rivals: Sequence[Candidate], candidates: Iterable[Candidate]) -> Candidate | None:
    """The best explanation by the kinds that all rivals have."""
    kinds = set.intersection(*(set(one.kinds) for one in rivals))
    found = [one for one in candidates if set(one.kinds) == kinds and one.explains()]
    return min(found, key=lambda candidate: candidate.cost, default=None)


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
