"""The 18 findings of the paper's section VI. Each is a rule over figures, applied to the printed
figures and to ours; if it is about noisy frames, for each noise seed whose cells are measured.

A rule returns whether the finding holds, and the figures that decide it, in mm; four figures are
those of kt0 to kt3. No result is coded here.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ...cell import Measured
from ...table import ResultTable
from .correlation import correlation
from .figures import Ours, PaperFigures, Printed, Where, paper, seeds_of
from .keys import LAMBERTIAN, family, paper_titles
from .tables import LIVING, TRAJECTORIES

OFFICE = "office"
HOLDS = "holds"
FAILS = "does not hold"
UNDECIDED = "undecided by the seeds"
MISSING = "not measured"
#: Those about noisy frames: each noise seed decides them.
NOISY = range(12, 19)
#: Finding 15: noise increases an error strongly if it multiplies the error by at least this factor.
_STRONGLY = 2.0
#: Finding 11: reflections are the reason for an error if it is at most this share of it without
#: them.
_EXPLAINED = 0.5
#: Whether a finding holds (None if the figures cannot decide it), and the figures as text.
RuleResult = tuple[bool | None, str]
#: Effect of noise on kt0 to kt3 in the paper: the error grows on all but kt0.
_ALL_BUT_KT0 = [False, True, True, True]


class _MissingFigure(Exception):
    """A figure that a rule needs is missing."""


@dataclass(frozen=True)
class FindingRule:
    """holds: over figures. why: its condition in words."""

    holds: Callable[[PaperFigures], RuleResult]
    why: str


def findings_table(results: Sequence[Measured], preset: str = "best") -> ResultTable:
    """One row per finding that the cells decide: the printed figures, ours, the verdict, and why:
    the rule, and a remark on the printed figures. A note has the numbers of the others.
    """
    rows = []
    missing = []
    for finding in paper()["findings"]:
        number = finding["number"]
        rule = RULES[number]
        holds, printed = apply_rule(rule.holds, Printed())
        if holds is False:
            printed += "; by this rule, the printed figures contradict the finding"
        ours = _ours(results, preset, number)
        if not ours:
            missing.append(str(number))
            continue
        answers = [holds for holds, _ in ours]
        why = rule.why
        if remark := finding.get("remark"):
            why += f". {remark}"
        seeds_text = f"{answers.count(True)} of {len(answers)}" if number in NOISY else "-"
        decided = (verdict(answers), seeds_text, why)
        texts = (finding["finding"], printed or "-", ours[0][1] or "-", *decided)
        rows.append((str(number), finding["section"], *texts))
    columns = ("no.", "section", "finding", "printed", "ours", "verdict", "seeds", "why")
    title = "The findings of section VI, decided by rules over the cells."
    notes = [
        "The verdicts apply to these cells only: frames, noise and odometers are ours, not the "
        "paper's. Errors in mm."
    ]
    if missing:
        which = f"Findings {', '.join(missing)}" if rows else "All findings"
        notes.append(f"{which} need more cells than these {len(results)}, which fill the tables.")
    table = ResultTable("findings", title, columns, tuple(rows), notes=tuple(notes))
    return table.of_preset(preset)


def _ours(results: Sequence[Measured], preset: str, number: int) -> list[tuple[bool, str]]:
    """Of our figures: one result of a finding's rule; if it is about noise, one for each noise seed
    that decides it.
    """
    if number == _MAIN:
        found = [_main_finding([r for r in results if r.key.preset == preset or r.key.external])]
    else:
        seeds = seeds_of(results, preset) if number in NOISY else [0]
        views = [Ours(results, preset, seed) for seed in seeds]
        found = [apply_rule(RULES[number].holds, view) for view in views]
    return [(holds, text) for holds, text in found if holds is not None]


def apply_rule(rule: Callable[[PaperFigures], RuleResult], of: PaperFigures) -> RuleResult:
    """Result of the rule; (None, "") if a figure is missing."""
    try:
        return rule(of)
    except _MissingFigure:
        return None, ""


def verdict(holds: Iterable[bool]) -> str:
    """The verdict from a rule's results for the noise seeds; at least one."""
    answers = set(holds)
    if len(answers) > 1:
        return UNDECIDED
    return HOLDS if answers == {True} else FAILS


# -- figures for rules


def _there(value: float | None) -> float:
    if value is None:
        raise _MissingFigure
    return value


def _ate(of: PaperFigures, room: str, kt: str, noise: str, odometer: str) -> float:
    return _there(of.ate(Where(room, kt, noise, odometer)))


def _ates(of: PaperFigures, room: str, noise: str, odometer: str) -> list[float]:
    """ATE of kt0 to kt3 in metres."""
    return [_ate(of, room, kt, noise, odometer) for kt in TRAJECTORIES]


def _ates_of(of: PaperFigures, room: str, noise: str, odometers: Iterable[str]) -> list[float]:
    """ATE of several odometers on kt0 to kt3."""
    return sum((_ates(of, room, noise, name) for name in odometers), [])


def _surfaces(of: PaperFigures, noise: str, odometer: str, reference: str = "") -> list[float]:
    """Mean surface errors of kt0 to kt3 in the living room, in metres."""
    wheres = [Where(LIVING, kt, noise, odometer, reference) for kt in TRAJECTORIES]
    return [_there(of.surface(where)) for where in wheres]


def _five(of: PaperFigures, room: str, noise: str, kt: str) -> dict[str, float]:
    """ATE of the five odometers."""
    return {name: _ate(of, room, kt, noise, name) for name in paper_titles()}


def _extremes(of: PaperFigures, room: str, noise: str, pick: Callable) -> list[str]:
    """For each of kt0 to kt3, the odometer with the least (min) or greatest (max) ATE."""
    found = [_five(of, room, noise, kt) for kt in TRAJECTORIES]
    return [pick(errors, key=errors.__getitem__) for errors in found]


def _mean(values: Sequence[float]) -> float:
    """Geometric mean, as errors span orders of magnitude."""
    return math.exp(sum(map(math.log, values)) / len(values))


def _grown(clean: Sequence[float], noisy: Sequence[float]) -> list[bool]:
    return [b > a for a, b in zip(clean, noisy, strict=True)]


def _mm(*values: float) -> str:
    texts = []
    for value in values:
        texts.append(f"{1e3 * value:.3g}" if value < 1 else f"{1e3 * value:.0f}")
    return ", ".join(texts)


def _names(found: Sequence[str]) -> str:
    return ", ".join(paper_titles()[name] for name in found)


# -- the rules, in the order of the findings


def _kt2_best_kt0_worst(of: PaperFigures) -> RuleResult:
    means = _surfaces(of, "clean", "icp")
    return means[2] == min(means) and means[0] == max(means), f"ICP's surfaces {_mm(*means)}"


def _nearer_but_rougher(of: PaperFigures) -> RuleResult:
    ate = [_ate(of, LIVING, "kt0", "clean", name) for name in ("dvo", "icp")]
    wheres = [Where(LIVING, "kt0", "clean", name) for name in ("dvo", "icp")]
    surface = [_there(of.surface(where)) for where in wheres]
    text = f"kt0, DVO and ICP: ATE {_mm(*ate)}, surface {_mm(*surface)}"
    return ate[0] < ate[1] and surface[0] > surface[1], text


def _the_model_is_the_reason(of: PaperFigures) -> RuleResult:
    better = []
    texts = []
    for name in ("icp", "dvo"):
        without = _there(of.surface(Where(LIVING, "kt0", "clean", name, "default")))
        against = _there(of.surface(Where(LIVING, "kt0", "clean", name, "model")))
        better.append(against < without)
        texts.append(f"{_names([name])} {_mm(without)} without the model, {_mm(against)} with it")
    return all(better), f"kt0's surface: {'; '.join(texts)}"


def _main_finding(results: Sequence[Measured]) -> RuleResult:
    found = correlation(results)
    if found is None or not found.pairs:
        return None, ""
    text = (
        f"in {found.discordant} of {found.pairs} pairs on one sequence, the better trajectory has "
        f"the worse surface; Spearman's \u03c1 over {found.n} cells is {found.rho:.2f}, "
        f"95 % interval {found.low:.2f} to {found.high:.2f}"
    )
    return found.discordant > 0, text


def _the_model_helps_dvo(of: PaperFigures) -> RuleResult:
    without = _surfaces(of, "clean", "dvo", "default")
    against = _surfaces(of, "clean", "dvo", "model")
    text = f"DVO's surfaces {_mm(*without)} without the model, {_mm(*against)} with it"
    return all(_grown(against, without)), text


def _dvo_on_kt0_icp_elsewhere(of: PaperFigures) -> RuleResult:
    best = _extremes(of, LIVING, "clean", min)
    kt0 = _five(of, LIVING, "clean", "kt0")
    text = f"least ATE: {_names(best)}; kt0: DVO {_mm(kt0['dvo'])}, ICP {_mm(kt0['icp'])}"
    return best == ["dvo", "icp", "icp", "icp"], text


def _fovis_worst(of: PaperFigures) -> RuleResult:
    worst = _extremes(of, LIVING, "clean", max)
    text = f"greatest ATE: {_names(worst)}; FOVIS {_mm(*_ates(of, LIVING, 'clean', 'fovis'))}"
    return set(worst) == {"fovis"}, text


def _photometric_poor(of: PaperFigures, room: str = LIVING) -> RuleResult:
    photometric = _mean(_ates_of(of, room, "clean", family("photometric")))
    geometric = _mean(_ates_of(of, room, "clean", family("geometric")))
    text = f"DVO and RGB-D {_mm(photometric)}, ICP and ICP+RGB-D {_mm(geometric)}"
    return photometric > geometric, text


def _icp_slides_on_kt0(of: PaperFigures) -> RuleResult:
    ate = _ates(of, LIVING, "clean", "icp")
    text = f"ICP's ATE {_mm(*ate)}"
    worst = ate[0] == max(ate)
    if isinstance(of, Printed):
        return worst, text
    wheres = [Where(LIVING, kt, "clean", "icp") for kt in TRAJECTORIES]
    shares = [_there(of.degenerate(where)) for where in wheres]
    text += f"; under-constrained frames {', '.join(f'{share:.1%}' for share in shares)}"
    return worst and shares[0] == max(shares) > 0, text


def _icp_best_in_the_office(of: PaperFigures) -> RuleResult:
    best = _extremes(of, OFFICE, "clean", min)
    ate = _ates(of, OFFICE, "clean", "icp")
    text = f"least ATE: {_names(best)}; ICP {_mm(*ate)}"
    return set(best) == {"icp"} and ate[1] == max(ate), text


def _assumptions(of: PaperFigures) -> RuleResult:
    """Why photometric methods do worse is decided by frames without reflections, where they should
    do better.
    """
    fact, text = _photometric_poor(of, OFFICE)
    try:
        without = _mean(_ates_of(of, OFFICE, LAMBERTIAN, family("photometric")))
    except _MissingFigure:
        return (None if fact else False), text
    if not fact:
        return False, text
    with_them = _mean(_ates_of(of, OFFICE, "clean", family("photometric")))
    text = f"{text}; DVO and RGB-D without reflections {_mm(without)}"
    return without <= _EXPLAINED * with_them, text


def _noise_costs_surface(of: PaperFigures) -> RuleResult:
    clean = _surfaces(of, "clean", "icp")
    noisy = _surfaces(of, "noisy", "icp")
    return sum(noisy) > sum(clean), f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy"


def _icp_best_surfaces(of: PaperFigures) -> RuleResult:
    clean = _surfaces(of, "clean", "icp")
    noisy = _surfaces(of, "noisy", "icp")
    text = f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy"
    grown = _grown(clean, noisy) == _ALL_BUT_KT0
    if isinstance(of, Printed):  # the paper prints no noisy surfaces of the other odometers
        return grown, text
    if not grown:
        return False, text
    others = [_surfaces(of, "noisy", name) for name in paper_titles() if name != "icp"]
    wins = sum(mine < min(theirs) for mine, *theirs in zip(noisy, *others, strict=True))
    text += f"; the best of the five on {wins} of {len(noisy)}"
    return grown and wins == len(noisy), text


def _noise_costs_icp_but_on_kt0(of: PaperFigures) -> RuleResult:
    clean = _ates(of, LIVING, "clean", "icp")
    noisy = _ates(of, LIVING, "noisy", "icp")
    text = f"ICP's ATE {_mm(*clean)} clean, {_mm(*noisy)} noisy"
    return _grown(clean, noisy) == _ALL_BUT_KT0, text


def _icp_suffers_on_kt3(of: PaperFigures) -> RuleResult:
    clean = _ates(of, LIVING, "clean", "icp")
    noisy = _ates(of, LIVING, "noisy", "icp")
    growth = [b / a for a, b in zip(clean, noisy, strict=True)]
    text = f"with noise, ICP's ATE is {', '.join(f'{g:.3g}' for g in growth)} times as large"
    return growth[3] == max(growth) and growth[3] >= _STRONGLY, text


def _noise_may_help(of: PaperFigures) -> RuleResult:
    falls = {}
    for name in (*family("photometric"), "fovis"):
        clean = _ates(of, LIVING, "clean", name)
        grown = _grown(clean, _ates(of, LIVING, "noisy", name))
        falls[name] = [kt for kt, more in zip(TRAJECTORIES, grown, strict=True) if not more]
    texts = [f"{_names([name])} falls on {', '.join(kts) or 'none'}" for name, kts in falls.items()]
    helped = [name for name, kts in falls.items() if kts]
    return len(helped) >= 2 and "fovis" in helped, "; ".join(texts)


def _office_noisy(of: PaperFigures) -> RuleResult:
    clean = _ates(of, OFFICE, "clean", "icp")
    noisy = _ates(of, OFFICE, "noisy", "icp")
    dvo = _five(of, OFFICE, "noisy", "kt1")["dvo"]
    kt3 = _extremes(of, OFFICE, "noisy", min)[3]
    text = (
        f"ICP {_mm(*clean)} clean, {_mm(*noisy)} noisy; kt1: DVO {_mm(dvo)}; "
        f"least ATE on kt3: {_names([kt3])}"
    )
    return all(_grown(clean, noisy)) and dvo < noisy[1] and kt3 == "icp_rgbd", text


def _photometric_robust(of: PaperFigures) -> RuleResult:
    growth = []
    for names in ([*family("photometric"), "fovis"], ["icp"]):
        by_noise = []
        for noise in ("clean", "noisy"):
            both = _ates_of(of, LIVING, noise, names) + _ates_of(of, OFFICE, noise, names)
            by_noise.append(_mean(both))
        growth.append(by_noise[1] / by_noise[0])
    text = (
        f"with noise, the ATE of DVO, RGB-D and FOVIS is {growth[0]:.3g} times as large, "
        f"ICP's {growth[1]:.3g} times"
    )
    return growth[0] < growth[1], text


#: The main finding: our verdict uses all cells that have a surface, not figures of named cells.
_MAIN = 4
RULES = {
    1: FindingRule(
        _kt2_best_kt0_worst, "the mean surface error is least on kt2 and greatest on kt0"
    ),
    2: FindingRule(_nearer_but_rougher, "DVO's ATE is below ICP's, its mean surface error above"),
    3: FindingRule(
        _the_model_is_the_reason,
        "for ICP and for DVO, the surface of kt0 is better with the model than without",
    ),
    _MAIN: FindingRule(
        _nearer_but_rougher,
        "it does so in at least one pair whose ATE and surface error differ by over 10 %",
    ),
    5: FindingRule(
        _the_model_helps_dvo,
        "DVO's mean surface error is smaller with the model on all four trajectories",
    ),
    6: FindingRule(
        _dvo_on_kt0_icp_elsewhere, "least ATE of the five: DVO on kt0, ICP on kt1 to kt3"
    ),
    7: FindingRule(_fovis_worst, "FOVIS has the greatest ATE of the five on all four trajectories"),
    8: FindingRule(
        _photometric_poor,
        "geometric mean of the ATE over both odometers and all four trajectories",
    ),
    9: FindingRule(
        _icp_slides_on_kt0,
        "ICP's ATE is greatest on kt0, and so is its share of under-constrained frames",
    ),
    10: FindingRule(
        _icp_best_in_the_office,
        "ICP has the least ATE of the five on all four trajectories, its greatest on kt1",
    ),
    11: FindingRule(
        _assumptions,
        "they are worse by the geometric mean, and without reflections (--lambertian) their error "
        "is at most half as large",
    ),
    12: FindingRule(
        _noise_costs_surface,
        "ICP's mean surface error over the four trajectories grows with noise",
    ),
    13: FindingRule(
        _icp_best_surfaces,
        "ICP's noisy surface is the best of the five on all four; its error grows on all but kt0",
    ),
    14: FindingRule(_noise_costs_icp_but_on_kt0, "ICP's ATE grows on kt1 to kt3 and falls on kt0"),
    15: FindingRule(
        _icp_suffers_on_kt3,
        f"ICP's ATE grows most on kt3, by a factor of at least {_STRONGLY:g}",
    ),
    16: FindingRule(
        _noise_may_help,
        "the ATE of two or more of DVO, RGB-D and FOVIS, FOVIS among them, falls on some "
        "trajectory",
    ),
    17: FindingRule(
        _office_noisy,
        "ICP's ATE grows on all four; DVO's is below ICP's on kt1; ICP+RGB-D's is least on kt3",
    ),
    18: FindingRule(_photometric_robust, "growth of the geometric mean of the ATE over both rooms"),
}
