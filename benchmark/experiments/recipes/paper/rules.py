"""The rules of the 18 findings of the paper's section VI, over printed figures and over ours.

A rule returns whether the finding holds, the figures that decide it in mm (four figures are those
of kt0 to kt3), and the comparison on which it turned. No result is coded here.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

from .claims import (
    METHOD,
    NOISE,
    ROOM,
    Answer,
    Claim,
    MissingFigure,
    all_hold,
    any_of,
    every,
    figures_mm,
    majority,
    most,
)
from .figures import PaperFigures, Printed, Where
from .keys import LAMBERTIAN, NOISES, family, paper_odometers
from .tables import LIVING, TRAJECTORIES

OFFICE = "office"
#: Findings 8, 10 and 15: an error is poor beside another, notably or significantly greater, if it is
#: this many times as large; finding 6: one is narrowly less than another if it is not.
_SIGNIFICANTLY = 2.0
#: Finding 11: reflections are the reason for an error if it is this many times that without them.
_EXPLAINED = 2.0


class Void(Exception):
    """The finding explains another one, which does not hold."""


@dataclass(frozen=True)
class FindingRule:
    """answer: over figures. why: its condition in words."""

    answer: Callable[[PaperFigures], Answer]
    why: str


# -- figures for rules, in metres; None if missing

Figures: TypeAlias = Sequence[float | None]


def _there(value: float | None) -> float:
    if value is None:
        raise MissingFigure
    return value


def _all_there(values: Figures) -> list[float]:
    return [_there(value) for value in values]


def _ate(of: PaperFigures, room: str, kt: str, noise: str, odometer: str) -> float | None:
    return of.ate(Where(room, kt, noise, odometer))


def _ates(
    of: PaperFigures, room: str, noise: str, odometer: str, statistic: str = "rmse"
) -> list[float | None]:
    """ATE of kt0 to kt3."""
    wheres = [Where(room, kt, noise, odometer) for kt in TRAJECTORIES]
    return [of.ate(where, statistic) for where in wheres]


def _ates_of(
    of: PaperFigures, room: str, noise: str, odometers: Iterable[str]
) -> list[float | None]:
    """ATE of several odometers on kt0 to kt3."""
    return sum((_ates(of, room, noise, name) for name in odometers), [])


def _surfaces(
    of: PaperFigures, noise: str, odometer: str, reference: str = ""
) -> list[float | None]:
    """Mean surface errors of kt0 to kt3 in the living room."""
    wheres = [Where(LIVING, kt, noise, odometer, reference) for kt in TRAJECTORIES]
    return [of.surface(where) for where in wheres]


def _five(of: PaperFigures, room: str, noise: str, kt: str) -> dict[str, float | None]:
    """ATE of the five odometers."""
    return {name: _ate(of, room, kt, noise, name) for name in paper_odometers()}


def _first(of: PaperFigures, room: str, noise: str, pick: Callable) -> str:
    """The odometers with the least (min) or greatest (max) ATE on kt0 to kt3, as text."""
    return ", ".join(_picked(_five(of, room, noise, kt), pick) for kt in TRAJECTORIES)


def _picked(errors: Mapping[str, float | None], pick: Callable) -> str:
    """The odometer with the least or greatest error; a dash if an error is missing."""
    return "-" if None in errors.values() else pick(errors, key=errors.__getitem__)


def _mean(values: Figures) -> float:
    """Geometric mean, as errors span orders of magnitude. Raises MissingFigure if one is missing."""
    return math.exp(sum(map(math.log, _all_there(values))) / len(values))


# -- claims of rules


def _best_of_five(of: PaperFigures, room: str, noise: str, kt: str, name: str) -> list[Claim]:
    """Its ATE is less than those of the other four."""
    errors = _five(of, room, noise, kt)
    return [_below(kt, errors, name, other) for other in errors if other != name]


def _below(
    kt: str, errors: dict[str, float | None], one: str, other: str, narrow: bool = False
) -> Claim:
    words = (f"{one} on {kt}", f"{other} on {kt}")
    return Claim(METHOD, errors[one], errors[other], *words, narrow=narrow)


def _greatest(values: Figures, k: int, what: str, times: float = 1.0) -> list[Claim]:
    """The figure of sequence k is greater than those of the other three, by a factor `times`."""
    others = [j for j in range(len(values)) if j != k]
    return [_less_on(values, j, k, what, times) for j in others]


def _least(values: Figures, k: int, what: str) -> list[Claim]:
    others = [j for j in range(len(values)) if j != k]
    return [_less_on(values, k, j, what) for j in others]


def _less_on(values: Figures, j: int, k: int, what: str, times: float = 1.0) -> Claim:
    words = (f"{what} on {TRAJECTORIES[j]}", f"on {TRAJECTORIES[k]}")
    return Claim(ROOM, values[j], values[k], *words, times=times)


def _grows(clean: float | None, noisy: float | None, what: str, times: float = 1.0) -> Claim:
    return Claim(NOISE, clean, noisy, f"{what} clean", "noisy", times=times)


def _falls(clean: float | None, noisy: float | None, what: str) -> Claim:
    return Claim(NOISE, noisy, clean, f"{what} noisy", "clean")


def _all_but_kt0(clean: Figures, noisy: Figures, what: str) -> list[Claim]:
    """Noise increases the error on all sequences but the first, where chance decides."""
    claims = []
    for kt, without, with_noise in list(zip(TRAJECTORIES, clean, noisy, strict=True))[1:]:
        claims.append(_grows(without, with_noise, f"{what} on {kt}"))
    return claims


# -- the rules, in the order of the findings


def _kt2_best_kt0_worst(of: PaperFigures) -> Answer:
    means = _ates(of, LIVING, "clean", "icp", "mean")
    claims = [*_least(means, 2, "icp's mean"), *_greatest(means, 0, "icp's mean")]
    return every(claims, f"icp's mean ATE {figures_mm(*means)}")


def _nearer_but_rougher(of: PaperFigures) -> Answer:
    ate = {name: _ate(of, LIVING, "kt0", "clean", name) for name in ("dvo", "icp")}
    wheres = {name: Where(LIVING, "kt0", "clean", name) for name in ("dvo", "icp")}
    surface = {name: of.surface(where) for name, where in wheres.items()}
    text = (
        f"kt0, dvo and icp: ATE {figures_mm(*ate.values())}, "
        f"surface {figures_mm(*surface.values())}"
    )
    nearer = _below("kt0", ate, "dvo", "icp", narrow=True)
    words = ("the surface of icp on kt0", "of dvo")
    rougher = Claim(METHOD, surface["icp"], surface["dvo"], *words)
    return every([nearer, rougher], text)


def _the_model_is_the_reason(of: PaperFigures) -> Answer:
    explained = _nearer_but_rougher(of)
    if explained.holds is False:
        raise Void(f"finding 2, which it explains, is not the case ({explained.cause})")
    claims = []
    texts = []
    for name in ("icp", "dvo"):
        without = _there(of.surface(Where(LIVING, "kt0", "clean", name, "default")))
        against = _there(of.surface(Where(LIVING, "kt0", "clean", name, "model")))
        words = (f"the surface of {name} with the model", "without")
        claims.append(Claim(METHOD, against, without, *words))
        both = f"{figures_mm(without)} without the model, {figures_mm(against)} with it"
        texts.append(f"{name} {both}")
    return every(claims, f"kt0's surface: {'; '.join(texts)}")


def _better_but_rougher(of: PaperFigures) -> Answer:
    """On a sequence, it does if of one of its pairs of odometers the better trajectory has the
    clearly worse surface; a sequence without a clear pair decides nothing. The paper prints pairs
    of one sequence.
    """
    answers: list[bool | None] = []
    texts = []
    for noise in NOISES:
        pairs = [_clear_pairs(of, kt, noise) for kt in TRAJECTORIES]
        found = [any(turned) if turned else None for turned in pairs]
        turned = sum(map(sum, pairs))
        texts.append(
            f"{noise} on {found.count(True)} of {len(found)} sequences, "
            f"in {turned} of {sum(map(len, pairs))} clear pairs"
        )
        answers += found
    with_one, without = answers.count(True), answers.count(False)
    cause = (
        f"{METHOD}: {with_one} sequences with such a pair, {without} without, "
        f"{answers.count(None)} without a clear pair"
    )
    text = f"the better trajectory has the worse surface: {'; '.join(texts)}"
    return Answer(majority(answers), text, cause)


def _clear_pairs(of: PaperFigures, kt: str, noise: str) -> list[bool]:
    """Of each pair of odometers on a sequence of the living room that differs clearly in ATE and in
    surface error: whether the better trajectory has the worse surface.
    """
    errors = []
    for name in paper_odometers():
        where = Where(LIVING, kt, noise, name)
        ate, surface = of.ate(where), of.surface(where)
        if ate is not None and surface is not None:
            errors.append((ate, surface))
    if len(errors) < 2 and not isinstance(of, Printed):
        raise MissingFigure
    found = []
    for one, other in combinations(errors, 2):
        better = [Claim(METHOD, a, b, "", "").holds for a, b in zip(one, other, strict=True)]
        if None not in better:
            found.append(better[0] != better[1])
    return found


def _the_model_helps_dvo(of: PaperFigures) -> Answer:
    without = _all_there(_surfaces(of, "clean", "dvo", "default"))
    against = _all_there(_surfaces(of, "clean", "dvo", "model"))
    claims = []
    for kt, better, worse in zip(TRAJECTORIES, against, without, strict=True):
        words = (f"dvo's surface on {kt} with the model", "without")
        claims.append(Claim(METHOD, better, worse, *words))
    text = (
        f"dvo's surfaces {figures_mm(*without)} without the model, {figures_mm(*against)} with it"
    )
    return most(claims, text)


def _dvo_on_kt0_icp_elsewhere(of: PaperFigures) -> Answer:
    kt0 = _five(of, LIVING, "clean", "kt0")
    claims = [_below("kt0", kt0, "dvo", "icp", narrow=True)]
    words = ("icp on kt0", "dvo on kt0")
    claims.append(Claim(METHOD, kt0["icp"], kt0["dvo"], *words, times=1 / _SIGNIFICANTLY))
    for kt in TRAJECTORIES[1:]:
        claims += _best_of_five(of, LIVING, "clean", kt, "icp")
    text = (
        f"least ATE: {_first(of, LIVING, 'clean', min)}; "
        f"kt0: dvo {figures_mm(kt0['dvo'])}, icp {figures_mm(kt0['icp'])}"
    )
    return every(claims, text)


def _fovis_worst(of: PaperFigures) -> Answer:
    claims = []
    for kt in TRAJECTORIES:
        errors = _five(of, LIVING, "clean", kt)
        others = [name for name in errors if name != "fovis"]
        claims += [_below(kt, errors, name, "fovis") for name in others]
    fovis = figures_mm(*_ates(of, LIVING, "clean", "fovis"))
    return every(claims, f"greatest ATE: {_first(of, LIVING, 'clean', max)}; fovis {fovis}")


def _photometric_poor(of: PaperFigures) -> Answer:
    return _photometric_worse(of, LIVING, _SIGNIFICANTLY)


def _photometric_worse(of: PaperFigures, room: str, times: float = 1.0) -> Answer:
    photometric = _mean(_ates_of(of, room, "clean", family("photometric")))
    geometric = _mean(_ates_of(of, room, "clean", family("geometric")))
    words = ("icp and icp_rgbd", "dvo and rgbd")
    text = f"{words[1]} {figures_mm(photometric)}, {words[0]} {figures_mm(geometric)}"
    return every([Claim(METHOD, geometric, photometric, *words, times=times)], text)


def _icp_slides_on_kt0(of: PaperFigures) -> Answer:
    ate = _ates(of, LIVING, "clean", "icp")
    answer = every(_greatest(ate, 0, "icp"), f"icp's ATE {figures_mm(*ate)}")
    if isinstance(of, Printed) or answer.holds is False:
        return answer
    wheres = [Where(LIVING, kt, "clean", "icp") for kt in TRAJECTORIES]
    shares = [_there(of.degenerate(where)) for where in wheres]
    slides = shares[0] == max(shares) > 0
    texts = ", ".join(f"{share:.1%}" for share in shares)
    text = f"{answer.figures}; under-constrained frames {texts}"
    cause = answer.cause if slides else f"{ROOM}: under-constrained frames {texts}"
    return Answer(all_hold([answer.holds, slides]), text, cause)


def _icp_best_in_the_office(of: PaperFigures) -> Answer:
    ate = _ates(of, OFFICE, "clean", "icp")
    claims = _greatest(ate, 1, "icp", _SIGNIFICANTLY)
    for kt in TRAJECTORIES:
        claims += _best_of_five(of, OFFICE, "clean", kt, "icp")
    text = f"least ATE: {_first(of, OFFICE, 'clean', min)}; icp {figures_mm(*ate)}"
    return every(claims, text)


def _assumptions(of: PaperFigures) -> Answer:
    """Why photometric methods do worse is decided by frames without reflections, where they should
    do better.
    """
    worse = _photometric_worse(of, OFFICE)
    if worse.holds is False:
        return worse
    try:
        without = _mean(_ates_of(of, OFFICE, LAMBERTIAN, family("photometric")))
    except MissingFigure:
        raise MissingFigure(worse.figures) from None
    with_them = _mean(_ates_of(of, OFFICE, "clean", family("photometric")))
    words = ("dvo and rgbd without reflections", "with")
    claim = Claim(ROOM, without, with_them, *words, times=_EXPLAINED)
    answer = every([claim], f"{worse.figures}; {words[0]} {figures_mm(without)}")
    return Answer(all_hold([worse.holds, answer.holds]), answer.figures, answer.cause)


def _noise_costs_surface(of: PaperFigures) -> Answer:
    clean = _surfaces(of, "clean", "icp")
    noisy = _surfaces(of, "noisy", "icp")
    text = f"icp's surfaces {figures_mm(*clean)} clean, {figures_mm(*noisy)} noisy"
    claim = _grows(sum(_all_there(clean)), sum(_all_there(noisy)), "sum of icp's surfaces")
    return every([claim], text)


def _icp_best_surfaces(of: PaperFigures) -> Answer:
    clean = _surfaces(of, "clean", "icp")
    noisy = _surfaces(of, "noisy", "icp")
    text = f"icp's surfaces {figures_mm(*clean)} clean, {figures_mm(*noisy)} noisy"
    claims = _all_but_kt0(clean, noisy, "icp's surface")
    if isinstance(of, Printed):
        return every(claims, text)  # the paper prints no noisy surfaces of the other odometers
    for name in paper_odometers():
        if name != "icp":
            theirs = _surfaces(of, "noisy", name)
            for kt, mine, other in zip(TRAJECTORIES, noisy, theirs, strict=True):
                words = (f"icp's surface on {kt}", f"{name}'s")
                claims.append(Claim(METHOD, mine, other, *words))
    return every(claims, text)


def _noise_costs_icp_but_on_kt0(of: PaperFigures) -> Answer:
    clean = _ates(of, LIVING, "clean", "icp")
    noisy = _ates(of, LIVING, "noisy", "icp")
    text = f"icp's ATE {figures_mm(*clean)} clean, {figures_mm(*noisy)} noisy"
    return every(_all_but_kt0(clean, noisy, "icp"), text)


def _icp_suffers_on_kt3(of: PaperFigures) -> Answer:
    clean = _ate(of, LIVING, "kt3", "clean", "icp")
    noisy = _ate(of, LIVING, "kt3", "noisy", "icp")
    text = f"icp's ATE on kt3 {figures_mm(clean)} clean, {figures_mm(noisy)} noisy"
    return every([_grows(clean, noisy, "icp on kt3", _SIGNIFICANTLY)], text)


def _noise_may_help(of: PaperFigures) -> Answer:
    falls = {}
    texts = []
    for name in (*family("photometric"), "fovis"):
        claims = []
        for room in (LIVING, OFFICE):
            both = [_all_there(_ates(of, room, noise, name)) for noise in NOISES]
            for kt, clean, noisy in zip(TRAJECTORIES, *both, strict=True):
                words = f"{name} on {room.replace('_', ' ')} {kt}"
                claims.append(_falls(clean, noisy, words))
        count = sum(claim.holds is True for claim in claims)
        texts.append(f"{name} falls on {count} of {len(claims)} sequences")
        falls[name] = any_of(claims, "")
    fovis = falls.pop("fovis")
    others = sorted(falls.values(), key=lambda answer: [False, None, True].index(answer.holds))
    holds = all_hold([fovis.holds, others[-1].holds])
    cause = fovis.cause if fovis.holds is holds else others[-1].cause
    return Answer(holds, "; ".join(texts), cause)


def _office_noisy(of: PaperFigures) -> Answer:
    clean = _ates(of, OFFICE, "clean", "icp")
    noisy = _ates(of, OFFICE, "noisy", "icp")
    kt1 = _five(of, OFFICE, "noisy", "kt1")
    kt3 = _five(of, OFFICE, "noisy", "kt3")
    claims = []
    for kt, without, with_noise in zip(TRAJECTORIES, clean, noisy, strict=True):
        claims.append(_grows(without, with_noise, f"icp on {kt}"))
    claims.append(_below("kt1", kt1, "dvo", "icp"))
    claims += _best_of_five(of, OFFICE, "noisy", "kt3", "icp_rgbd")
    text = (
        f"icp {figures_mm(*clean)} clean, {figures_mm(*noisy)} noisy; "
        f"kt1: dvo {figures_mm(kt1['dvo'])}; least ATE on kt3: {_picked(kt3, min)}"
    )
    return every(claims, text)


def _photometric_robust(of: PaperFigures) -> Answer:
    growth = []
    texts = []
    image = [name for name in paper_odometers() if name != "icp"]
    for names, words in ((image, ", ".join(image)), (["icp"], "icp")):
        both = []
        for noise in NOISES:
            rooms = [_ates_of(of, room, noise, names) for room in (LIVING, OFFICE)]
            both.append(_mean(sum(rooms, [])))
        growth.append(both[1] / both[0])
        clean, noisy = map(figures_mm, both)
        texts.append(f"{words} {clean} clean, {noisy} noisy, {growth[-1]:.3g} times")
    text = f"mean ATE of {'; of '.join(texts)}"
    claim = Claim(NOISE, growth[0], growth[1], "", "")
    return Answer(claim.holds, text, f"{NOISE}: {growth[0]:.3g} times, icp {growth[1]:.3g} times")


_DECIDES = "on over half of the sequences, and the opposite on none"
RULES = {
    1: FindingRule(
        _kt2_best_kt0_worst, "the mean of icp's ATE is least on kt2 and greatest on kt0"
    ),
    2: FindingRule(_nearer_but_rougher, "dvo's ATE is below icp's, its mean surface error above"),
    3: FindingRule(
        _the_model_is_the_reason,
        "for icp and for dvo, the surface of kt0 is better against the model than against the "
        "reference by default (for `best` a keyframe); void if finding 2 is not the case",
    ),
    4: FindingRule(
        _better_but_rougher,
        f"of a pair of odometers on one sequence, the better trajectory has the worse surface: "
        f"{_DECIDES}",
    ),
    5: FindingRule(
        _the_model_helps_dvo,
        f"dvo's mean surface error is smaller with the model than without: {_DECIDES}",
    ),
    6: FindingRule(
        _dvo_on_kt0_icp_elsewhere,
        "dvo's ATE on kt0 is below icp's, by however little, and icp's is less than "
        f"{_SIGNIFICANTLY:g} times dvo's; icp has the least of the five on kt1 to kt3",
    ),
    7: FindingRule(_fovis_worst, "fovis has the greatest ATE of the five on all four trajectories"),
    8: FindingRule(
        _photometric_poor,
        "the geometric mean of the ATE over all four trajectories is for dvo and rgbd at least "
        f"{_SIGNIFICANTLY:g} times that of icp and icp_rgbd",
    ),
    9: FindingRule(
        _icp_slides_on_kt0,
        "icp's ATE is greatest on kt0, and so is the share of frames that it reports as "
        "under-constrained",
    ),
    10: FindingRule(
        _icp_best_in_the_office,
        "icp has the least ATE of the five on all four trajectories; on kt1 its ATE is at least "
        f"{_SIGNIFICANTLY:g} times that on each of the others",
    ),
    11: FindingRule(
        _assumptions,
        "dvo and rgbd are worse than icp and icp_rgbd by the geometric mean, and without reflections "
        "(--lambertian), the one assumption that this decides, their error is at most half as large",
    ),
    12: FindingRule(
        _noise_costs_surface,
        "icp's mean surface error over the four trajectories grows with noise",
    ),
    13: FindingRule(
        _icp_best_surfaces,
        "icp's noisy surface is the best of the five on all four; its error grows on kt1 to kt3",
    ),
    14: FindingRule(_noise_costs_icp_but_on_kt0, "icp's ATE grows on kt1 to kt3"),
    15: FindingRule(
        _icp_suffers_on_kt3,
        f"icp's ATE on kt3 grows by a factor of at least {_SIGNIFICANTLY:g}",
    ),
    16: FindingRule(
        _noise_may_help,
        "the ATE of fovis falls on some trajectory of the two rooms, and so does that of dvo or of "
        "rgbd",
    ),
    17: FindingRule(
        _office_noisy,
        "icp's ATE grows on all four; dvo's is below icp's on kt1; icp_rgbd's is least of the five "
        "on kt3",
    ),
    18: FindingRule(
        _photometric_robust,
        "the geometric mean of the ATE over both rooms grows with noise by a smaller factor for the "
        "four that use the image than for icp; the factor is large for any method that is accurate on "
        "clean frames",
    ),
}
