"""The 18 findings of the paper's section VI: each is a rule over figures, applied to the printed ones and, for each noise seed, to ours.

A rule returns whether the finding holds and the figures that say so, in mm, of kt0 to kt3 where there are four. Nothing here knows a result.
"""

import math
from collections.abc import Callable, Iterable, Sequence

from .cells import TITLES
from .correlation import correlation
from .lookup import Figures, Ours, Printed, paper, seeds_of
from .paper_tables import TRAJECTORIES
from .text_tables import Table

LIVING, OFFICE = "living_room", "office"
PHOTOMETRIC, GEOMETRIC = ("dvo", "rgbd"), ("icp", "icp_rgbd")
HOLDS, FAILS, UNDECIDED, MISSING = "holds", "does not hold", "undecided by the seeds", "not measured"
#: An error that noise makes so many times as large has grown strongly (15).
_STRONGLY = 2.0
#: Whether a finding holds, None where the figures cannot say, and the figures.
Judged = tuple[bool | None, str]
#: What noise does to four trajectories: it makes the error of all but kt0 grow.
_ALL_BUT_KT0 = [False, True, True, True]


class _Missing(Exception):
    """A figure that a rule needs is not there."""


def findings_table(results: Sequence[dict], preset: str = "best") -> Table:
    """A row a finding: printed, ours, verdict, and why: the rule, and what is to be said of the printed figures."""
    seeds, rows = seeds_of(results, preset), []
    for finding in paper()["findings"]:
        number = finding["number"]
        rule, asked = RULES[number]
        holds, said = judged(rule, Printed())
        printed = said if holds is not False else f"{said}; by the rule the printed figures say otherwise"
        ours = [judged(rule, Ours(results, preset, seed)) for seed in seeds]
        if number == _MAIN:
            ours = [_main_finding([r for r in results if r["cell"].preset == preset or r["cell"].external])]
        found = verdict(holds for holds, _ in ours)
        if len(ours) > 1:
            asked += f"; holds with {sum(holds is True for holds, _ in ours)} of {len(ours)} seeds"
        if remark := finding.get("remark"):
            asked += f". {remark}"
        texts = (finding["finding"], printed or "-", ours[0][1] or "-", found, asked)
        rows.append((str(number), finding["section"], *texts))
    columns = ("no.", "section", "finding", "printed", "ours", "verdict", "why")
    suffix = ("", "") if preset == "best" else (f"_{preset}", f" Preset {preset}.")
    title = f"The findings of section VI, by rules over the cells.{suffix[1]}"
    note = "Verdicts are of these cells alone: other rooms' frames, other noise and our own odometers. Errors in mm."
    return Table(f"findings{suffix[0]}", title, columns, tuple(rows), notes=(note,))


def judged(rule: Callable[[Figures], Judged], of: Figures) -> Judged:
    """(None, "") where a figure is missing."""
    try:
        return rule(of)
    except _Missing:
        return None, ""


def verdict(holds: Iterable[bool | None]) -> str:
    """Of a rule's answers for every noise seed."""
    answers = set(holds)
    if None in answers:
        return MISSING
    return UNDECIDED if len(answers) > 1 else HOLDS if answers == {True} else FAILS


# -- figures for rules


def _there(value: float | None) -> float:
    if value is None:
        raise _Missing
    return value


def _ates(of: Figures, room: str, noise: str, odometer: str) -> list[float]:
    """Of kt0 to kt3."""
    return [_there(of.ate(room, kt, noise, odometer)) for kt in TRAJECTORIES]


def _surfaces(of: Figures, noise: str, odometer: str, reference: str = "") -> list[float]:
    """Mean errors in the living room."""
    return [_there(of.surface(LIVING, kt, noise, odometer, reference=reference)) for kt in TRAJECTORIES]


def _five(of: Figures, room: str, noise: str, trajectory: str) -> dict[str, float]:
    return {name: _there(of.ate(room, trajectory, noise, name)) for name in TITLES}


def _extremes(of: Figures, room: str, noise: str, pick: Callable) -> list[str]:
    """Of kt0 to kt3 the odometer with the least (min) or greatest (max) ATE."""
    found = [_five(of, room, noise, kt) for kt in TRAJECTORIES]
    return [pick(errors, key=errors.__getitem__) for errors in found]


def _mean(values: Sequence[float]) -> float:
    """Geometric, as errors span orders of magnitude."""
    return math.exp(sum(map(math.log, values)) / len(values))


def _grown(clean: Sequence[float], noisy: Sequence[float]) -> list[bool]:
    return [b > a for a, b in zip(clean, noisy, strict=True)]


def _mm(*values: float) -> str:
    return ", ".join(f"{1e3 * value:.3g}" if value < 1 else f"{1e3 * value:.0f}" for value in values)


def _names(found: Sequence[str]) -> str:
    return ", ".join(TITLES[name] for name in found)


# -- the rules, in the order of the findings


def _kt2_best_kt0_worst(of: Figures) -> Judged:
    means = _surfaces(of, "clean", "icp")
    return means[2] == min(means) and means[0] == max(means), f"ICP's surfaces {_mm(*means)}"


def _nearer_but_rougher(of: Figures) -> Judged:
    ate = [_there(of.ate(LIVING, "kt0", "clean", name)) for name in ("dvo", "icp")]
    surface = [_there(of.surface(LIVING, "kt0", "clean", name)) for name in ("dvo", "icp")]
    said = f"kt0, DVO and ICP: ATE {_mm(*ate)}, surface {_mm(*surface)}"
    return ate[0] < ate[1] and surface[0] > surface[1], said


def _the_model_is_the_reason(of: Figures) -> Judged:
    better, said = [], []
    for name in ("icp", "dvo"):
        without, against = (
            _there(of.surface(LIVING, "kt0", "clean", name, "mean", how)) for how in ("default", "model")
        )
        better.append(against < without)
        said.append(f"{TITLES[name]} {_mm(without)} without, {_mm(against)} with the model")
    return all(better), f"kt0's surface: {'; '.join(said)}"


def _main_finding(results: Sequence[dict]) -> Judged:
    found = correlation(results)
    if found is None or not found.pairs:
        return None, ""
    pairs = f"in {found.discordant} of {found.pairs} pairs on one sequence the better trajectory has the worse surface"
    rho = f"Spearman's \u03c1 over {found.n} cells {found.rho:.2f}, 95 % {found.low:.2f} to {found.high:.2f}"
    return found.discordant > 0, f"{pairs}; {rho}"


def _the_model_helps_dvo(of: Figures) -> Judged:
    without, against = (_surfaces(of, "clean", "dvo", how) for how in ("default", "model"))
    said = f"DVO's surfaces {_mm(*without)} without, {_mm(*against)} with the model"
    return not any(b >= a for a, b in zip(without, against, strict=True)), said


def _dvo_on_kt0_icp_elsewhere(of: Figures) -> Judged:
    best, kt0 = _extremes(of, LIVING, "clean", min), _five(of, LIVING, "clean", "kt0")
    said = f"least ATE: {_names(best)}; kt0: DVO {_mm(kt0['dvo'])}, ICP {_mm(kt0['icp'])}"
    return best == ["dvo", "icp", "icp", "icp"], said


def _fovis_worst(of: Figures) -> Judged:
    worst = _extremes(of, LIVING, "clean", max)
    said = f"greatest ATE: {_names(worst)}; FOVIS {_mm(*_ates(of, LIVING, 'clean', 'fovis'))}"
    return set(worst) == {"fovis"}, said


def _photometric_poor(of: Figures, room: str = LIVING) -> Judged:
    light, planes = (
        _mean([v for name in names for v in _ates(of, room, "clean", name)]) for names in (PHOTOMETRIC, GEOMETRIC)
    )
    return light > planes, f"DVO and RGB-D {_mm(light)}, ICP and ICP+RGB-D {_mm(planes)}"


def _icp_slides_on_kt0(of: Figures) -> Judged:
    ate = _ates(of, LIVING, "clean", "icp")
    said, worst = f"ICP's ATE {_mm(*ate)}", ate[0] == max(ate)
    if isinstance(of, Printed):
        return worst, said
    shares = [_there(of.degenerate(LIVING, kt, "clean", "icp")) for kt in TRAJECTORIES]
    said += f"; under-constrained frames {', '.join(f'{share:.1%}' for share in shares)}"
    return worst and shares[0] == max(shares) > 0, said


def _icp_best_in_the_office(of: Figures) -> Judged:
    best, ate = _extremes(of, OFFICE, "clean", min), _ates(of, OFFICE, "clean", "icp")
    return set(best) == {"icp"} and ate[1] == max(ate), f"least ATE: {_names(best)}; ICP {_mm(*ate)}"


def _assumptions(of: Figures) -> Judged:
    """That photometric methods do worse the cells can say; why, only frames without reflections and shadows could."""
    fact, said = _photometric_poor(of, OFFICE)
    return (None if fact else False), said


def _noise_costs_surface(of: Figures) -> Judged:
    clean, noisy = (_surfaces(of, noise, "icp") for noise in ("clean", "noisy"))
    return sum(noisy) > sum(clean), f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy"


def _icp_best_surfaces(of: Figures) -> Judged:
    clean, noisy = (_surfaces(of, noise, "icp") for noise in ("clean", "noisy"))
    said, grown = f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy", _grown(clean, noisy) == _ALL_BUT_KT0
    if isinstance(of, Printed):  # of the others the paper prints no noisy surfaces
        return grown, said
    others = [_surfaces(of, "noisy", name) for name in TITLES if name != "icp"]
    wins = sum(noisy[k] < min(other[k] for other in others) for k in range(len(noisy)))
    return grown and wins == len(noisy), f"{said}; the best of the five on {wins} of {len(noisy)}"


def _noise_costs_icp_but_on_kt0(of: Figures) -> Judged:
    clean, noisy = (_ates(of, LIVING, noise, "icp") for noise in ("clean", "noisy"))
    return _grown(clean, noisy) == _ALL_BUT_KT0, f"ICP's ATE {_mm(*clean)} clean, {_mm(*noisy)} noisy"


def _icp_suffers_on_kt3(of: Figures) -> Judged:
    clean, noisy = (_ates(of, LIVING, noise, "icp") for noise in ("clean", "noisy"))
    growth = [b / a for a, b in zip(clean, noisy, strict=True)]
    said = f"with noise ICP's ATE is {', '.join(f'{g:.3g}' for g in growth)} times as large"
    return growth[3] == max(growth) and growth[3] >= _STRONGLY, said


def _noise_may_help(of: Figures) -> Judged:
    falls = {}
    for name in (*PHOTOMETRIC, "fovis"):
        grown = _grown(*(_ates(of, LIVING, noise, name) for noise in ("clean", "noisy")))
        falls[name] = [kt for kt, more in zip(TRAJECTORIES, grown, strict=True) if not more]
    said = "; ".join(f"{TITLES[name]} falls on {', '.join(kts) or 'none'}" for name, kts in falls.items())
    return len(list(filter(None, falls.values()))) >= 2 and bool(falls["fovis"]), said


def _office_noisy(of: Figures) -> Judged:
    clean, noisy = (_ates(of, OFFICE, noise, "icp") for noise in ("clean", "noisy"))
    dvo, kt3 = _five(of, OFFICE, "noisy", "kt1")["dvo"], _extremes(of, OFFICE, "noisy", min)[3]
    said = f"ICP {_mm(*clean)} clean, {_mm(*noisy)} noisy; kt1: DVO {_mm(dvo)}; least ATE on kt3: {TITLES[kt3]}"
    return all(_grown(clean, noisy)) and dvo < noisy[1] and kt3 == "icp_rgbd", said


def _photometric_robust(of: Figures) -> Judged:
    growth = []
    for names in ((*PHOTOMETRIC, "fovis"), ("icp",)):
        where = [(room, name) for room in (LIVING, OFFICE) for name in names]
        clean, noisy = ([v for room, name in where for v in _ates(of, room, n, name)] for n in ("clean", "noisy"))
        growth.append(_mean(noisy) / _mean(clean))
    said = f"with noise the ATE of DVO, RGB-D and FOVIS is {growth[0]:.3g} times as large, ICP's {growth[1]:.3g} times"
    return growth[0] < growth[1], said


#: The main finding: its rule asks all cells that have a surface, not figures by name.
_MAIN = 4
#: Number -> the rule, and what it asks.
RULES: dict[int, tuple[Callable[[Figures], Judged], str]] = {
    1: (_kt2_best_kt0_worst, "least mean surface error on kt2, greatest on kt0"),
    2: (_nearer_but_rougher, "DVO's ATE below ICP's, its mean surface error above"),
    3: (_the_model_is_the_reason, "for ICP and for DVO the surface of kt0 is better with the model than without"),
    _MAIN: (_nearer_but_rougher, "in some pair of cells on one sequence that differs by over 10 % in both"),
    5: (_the_model_helps_dvo, "a smaller mean error with the model on all four"),
    6: (_dvo_on_kt0_icp_elsewhere, "least ATE of the five: DVO on kt0, ICP on kt1 to kt3"),
    7: (_fovis_worst, "greatest ATE of the five on all four"),
    8: (_photometric_poor, "geometric mean of the ATE over both and all four"),
    9: (_icp_slides_on_kt0, "ICP's ATE is greatest on kt0, and so is its share of under-constrained frames"),
    10: (_icp_best_in_the_office, "least ATE of the five on all four, ICP's greatest on kt1"),
    11: (_assumptions, "photometric worse by the geometric mean; the reason needs frames without reflections"),
    12: (_noise_costs_surface, "mean over the four trajectories"),
    13: (_icp_best_surfaces, "ICP's noisy surface the best of the five on all four; its error grows on all but kt0"),
    14: (_noise_costs_icp_but_on_kt0, "grows on kt1 to kt3, falls on kt0"),
    15: (_icp_suffers_on_kt3, f"growth greatest on kt3, and at least {_STRONGLY:g} fold"),
    16: (_noise_may_help, "two or more of DVO, RGB-D and FOVIS, FOVIS among them, fall on some trajectory"),
    17: (_office_noisy, "ICP grows on all four; DVO below ICP on kt1; ICP+RGB-D least on kt3"),
    18: (_photometric_robust, "growth of the geometric mean over both rooms"),
}
