"""What a sentence of the paper claims of figures: that one is less than another. A claim is true or
false by more than a tenth only; nearer figures decide nothing.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

#: Figures that differ by less than this share decide nothing. Another seed of the noise moves the
#: ATE of a method of the shipped cells by as much (tests/benchmark/test_claims.py).
TOLERANCE = 0.1
#: What a claim compares. METHOD: two methods on the same frames; ROOM: one method on two sequences
#: or rooms; NOISE: one method on the same sequence without noise and with it.
METHOD, ROOM, NOISE = "method", "room", "noise"


class MissingFigure(Exception):
    """A figure without which nothing is decided is missing. figures: those that there are, as text."""

    def __init__(self, figures: str = "") -> None:
        super().__init__()
        self.figures = figures


@dataclass(frozen=True)
class Claim:
    """`smaller` is less than `greater`, in metres; None if missing. kind: what it compares.
    smaller_is, greater_is: the figures in words. times: `greater` has to be so many times as large.
    narrow: the sentence says `narrowly`, so any difference in its direction fulfils it.
    """

    kind: str
    smaller: float | None
    greater: float | None
    smaller_is: str
    greater_is: str
    times: float = 1.0
    narrow: bool = False

    @property
    def margin(self) -> float:
        """Over 1 if the claim is fulfilled, under 1 if not, NaN if a figure is missing."""
        if self.smaller is None or self.greater is None:
            return math.nan
        return self.greater / (self.times * self.smaller)

    @property
    def holds(self) -> bool | None:
        """Whether it is true; None if the figures are too near to each other, or one is missing."""
        if self.margin > 1 / (1 - TOLERANCE):
            return True
        if self.margin < 1 - TOLERANCE:
            return False
        return True if self.narrow and self.margin > 1 else None

    @property
    def words(self) -> str:
        """`method: icp on kt0 345, icp_rgbd on kt0 1.14`."""
        smaller, greater = figures_mm(self.smaller), figures_mm(self.greater)
        return f"{self.kind}: {self.smaller_is} {smaller}, {self.greater_is} {greater}"


@dataclass(frozen=True)
class Answer:
    """holds: None if nothing is decided. figures: those that decide it, in mm. cause: the claim on
    which the answer turned, in words.
    """

    holds: bool | None
    figures: str
    cause: str


def every(claims: Iterable[Claim], figures: str) -> Answer:
    """All claims hold: turned by the one that does so least. A false one decides whatever others
    miss. Raises MissingFigure if none is false and one misses a figure.
    """
    found = list(claims)
    known = [claim for claim in found if not math.isnan(claim.margin)]
    narrowest = min(known, key=lambda claim: claim.margin, default=None)
    if narrowest is None or (len(known) < len(found) and narrowest.holds is not False):
        raise MissingFigure(figures)
    return Answer(all_hold(claim.holds for claim in known), figures, _cause(narrowest))


def any_of(claims: Iterable[Claim], figures: str) -> Answer:
    """At least one holds: turned by the one that does so most."""
    clearest = max(claims, key=lambda claim: claim.margin)
    return Answer(clearest.holds, figures, _cause(clearest))


def most(claims: Sequence[Claim], figures: str) -> Answer:
    """Over half of the claims hold and none is false; false if it is the other way round."""
    answers = [claim.holds for claim in claims]
    narrowest = min(claims, key=lambda claim: claim.margin)
    return Answer(majority(answers), figures, _cause(narrowest))


def all_hold(answers: Iterable[bool | None]) -> bool | None:
    """False if one is false, None if one is undecided."""
    found = set(answers)
    if False in found:
        return False
    return None if None in found else True


def majority(answers: Sequence[bool | None]) -> bool | None:
    """True if over half are true and none is false, False if over half are false and none is
    true.
    """
    for answer in (True, False):
        if 2 * answers.count(answer) > len(answers) and (not answer) not in answers:
            return answer
    return None


def _cause(claim: Claim) -> str:
    near = "" if claim.holds is not None else f", which differ by less than {TOLERANCE:.0%}"
    factor = "" if claim.times == 1 else f", where {claim.times:g} times as much decides"
    return claim.words + factor + near


def figures_mm(*values_m: float | None) -> str:
    """Lengths in mm with three digits, and none after the point from a metre on; a dash for a
    missing one.
    """
    texts = []
    for value_m in values_m:
        if value_m is None:
            texts.append("-")
        else:
            texts.append(f"{1e3 * value_m:.3g}" if value_m < 1 else f"{1e3 * value_m:.0f}")
    return ", ".join(texts)
