"""The 18 findings of the paper's section VI. Each is a rule over figures, applied to the printed
figures and, for each noise seed, to ours.

A rule returns whether the finding holds, and the figures that decide it, in mm; four figures are
those of kt0 to kt3. No result is coded here.
"""

import math
from collections.abc import Callable, Iterable, Sequence

from .cells import LAMBERTIAN, PHOTOMETRIC, TITLES
from .correlation import correlation
from .lookup import Figures, Ours, Printed, paper, seeds_of
from .paper_tables import TRAJECTORIES
from .table import ResultTable

LIVING, OFFICE = "living_room", "office"
GEOMETRIC = ("icp", "icp_rgbd")
HOLDS, FAILS, UNDECIDED, MISSING = (
    "holds",
    "does not hold",
    "undecided by the seeds",
    "not measured",
)
#: Finding 15: noise increases an error strongly if it multiplies the error by at least this factor.
_STRONGLY = 2.0
#: Finding 11: reflections are the reason for an error if it is at most this share of it without
#: them.
_EXPLAINED = 0.5
#: Whether a finding holds (None if the figures cannot decide it), and the figures as text.
RuleResult = tuple[bool | None, str]
#: Effect of noise on kt0 to kt3 in the paper: the error grows on all but kt0.
_ALL_BUT_KT0 = [False, True, True, True]


class _Missing(Exception):
    """A figure that a rule needs is missing."""


def findings_table(results: Sequence[dict], preset: str = "best") -> ResultTable:
    """One row per finding: the printed figures, ours, the verdict, and why: the rule, and a remark
    on the printed figures.
    """
    seeds, rows = seeds_of(results, preset), []
    for finding in paper()["findings"]:
        number = finding["number"]
        rule, why = RULES[number]
        holds, text = apply_rule(rule, Printed())
        printed = (
            text
            if holds is not False
            else f"{text}; by this rule, the printed figures contradict the finding"
        )
        ours = [apply_rule(rule, Ours(results, preset, seed)) for seed in seeds]
        if number == _MAIN:
            ours = [
                _main_finding(
                    [r for r in results if r["cell"].preset == preset or r["cell"].external]
                )
            ]
        found = verdict(holds for holds, _ in ours)
        if len(ours) > 1:
            why += f"; holds with {sum(holds is True for holds, _ in ours)} of {len(ours)} seeds"
        if remark := finding.get("remark"):
            why += f". {remark}"
        texts = (finding["finding"], printed or "-", ours[0][1] or "-", found, why)
        rows.append((str(number), finding["section"], *texts))
    columns = ("no.", "section", "finding", "printed", "ours", "verdict", "why")
    suffix = ("", "") if preset == "best" else (f"_{preset}", f" Preset {preset}.")
    title = f"The findings of section VI, decided by rules over the cells.{suffix[1]}"
    note = "The verdicts apply to these cells only: frames, noise and odometers are ours, not the paper's. Errors in mm."
    return ResultTable(f"findings{suffix[0]}", title, columns, tuple(rows), notes=(note,))


def apply_rule(rule: Callable[[Figures], RuleResult], of: Figures) -> RuleResult:
    """Result of the rule; (None, "") if a figure is missing."""
    try:
        return rule(of)
    except _Missing:
        return None, ""


def verdict(holds: Iterable[bool | None]) -> str:
    """The verdict from a rule's results for all noise seeds."""
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
    """ATE of kt0 to kt3 in metres."""
    return [_there(of.ate(room, kt, noise, odometer)) for kt in TRAJECTORIES]


def _surfaces(of: Figures, noise: str, odometer: str, reference: str = "") -> list[float]:
    """Mean surface errors of kt0 to kt3 in the living room, in metres."""
    return [
        _there(of.surface(LIVING, kt, noise, odometer, reference=reference)) for kt in TRAJECTORIES
    ]


def _five(of: Figures, room: str, noise: str, trajectory: str) -> dict[str, float]:
    return {name: _there(of.ate(room, trajectory, noise, name)) for name in TITLES}


def _extremes(of: Figures, room: str, noise: str, pick: Callable) -> list[str]:
    """For each of kt0 to kt3, the odometer with the least (min) or greatest (max) ATE."""
    found = [_five(of, room, noise, kt) for kt in TRAJECTORIES]
    return [pick(errors, key=errors.__getitem__) for errors in found]


def _mean(values: Sequence[float]) -> float:
    """Geometric mean, as errors span orders of magnitude."""
    return math.exp(sum(map(math.log, values)) / len(values))


def _grown(clean: Sequence[float], noisy: Sequence[float]) -> list[bool]:
    return [b > a for a, b in zip(clean, noisy, strict=True)]


def _mm(*values: float) -> str:
    return ", ".join(
        f"{1e3 * value:.3g}" if value < 1 else f"{1e3 * value:.0f}" for value in values
    )


def _names(found: Sequence[str]) -> str:
    return ", ".join(TITLES[name] for name in found)


# -- the rules, in the order of the findings


def _kt2_best_kt0_worst(of: Figures) -> RuleResult:
    means = _surfaces(of, "clean", "icp")
    return means[2] == min(means) and means[0] == max(means), f"ICP's surfaces {_mm(*means)}"


def _nearer_but_rougher(of: Figures) -> RuleResult:
    ate = [_there(of.ate(LIVING, "kt0", "clean", name)) for name in ("dvo", "icp")]
    surface = [_there(of.surface(LIVING, "kt0", "clean", name)) for name in ("dvo", "icp")]
    text = f"kt0, DVO and ICP: ATE {_mm(*ate)}, surface {_mm(*surface)}"
    return ate[0] < ate[1] and surface[0] > surface[1], text


def _the_model_is_the_reason(of: Figures) -> RuleResult:
    better, text = [], []
    for name in ("icp", "dvo"):
        without, against = (
            _there(of.surface(LIVING, "kt0", "clean", name, "mean", how))
            for how in ("default", "model")
        )
        better.append(against < without)
        text.append(f"{TITLES[name]} {_mm(without)} without the model, {_mm(against)} with it")
    return all(better), f"kt0's surface: {'; '.join(text)}"


def _main_finding(results: Sequence[dict]) -> RuleResult:
    found = correlation(results)
    if found is None or not found.pairs:
        return None, ""
    pairs = f"in {found.discordant} of {found.pairs} pairs on one sequence, the better trajectory has the worse surface"
    rho = f"Spearman's \u03c1 over {found.n} cells is {found.rho:.2f}, 95 % interval {found.low:.2f} to {found.high:.2f}"
    return found.discordant > 0, f"{pairs}; {rho}"


def _the_model_helps_dvo(of: Figures) -> RuleResult:
    without, against = (_surfaces(of, "clean", "dvo", how) for how in ("default", "model"))
    text = f"DVO's surfaces {_mm(*without)} without the model, {_mm(*against)} with it"
    return not any(b >= a for a, b in zip(without, against, strict=True)), text


def _dvo_on_kt0_icp_elsewhere(of: Figures) -> RuleResult:
    best, kt0 = _extremes(of, LIVING, "clean", min), _five(of, LIVING, "clean", "kt0")
    text = f"least ATE: {_names(best)}; kt0: DVO {_mm(kt0['dvo'])}, ICP {_mm(kt0['icp'])}"
    return best == ["dvo", "icp", "icp", "icp"], text


def _fovis_worst(of: Figures) -> RuleResult:
    worst = _extremes(of, LIVING, "clean", max)
    text = f"greatest ATE: {_names(worst)}; FOVIS {_mm(*_ates(of, LIVING, 'clean', 'fovis'))}"
    return set(worst) == {"fovis"}, text


def _photometric_poor(of: Figures, room: str = LIVING) -> RuleResult:
    photometric, geometric = (
        _mean([v for name in names for v in _ates(of, room, "clean", name)])
        for names in (PHOTOMETRIC, GEOMETRIC)
    )
    return (
        photometric > geometric,
        f"DVO and RGB-D {_mm(photometric)}, ICP and ICP+RGB-D {_mm(geometric)}",
    )


def _icp_slides_on_kt0(of: Figures) -> RuleResult:
    ate = _ates(of, LIVING, "clean", "icp")
    text, worst = f"ICP's ATE {_mm(*ate)}", ate[0] == max(ate)
    if isinstance(of, Printed):
        return worst, text
    shares = [_there(of.degenerate(LIVING, kt, "clean", "icp")) for kt in TRAJECTORIES]
    text += f"; under-constrained frames {', '.join(f'{share:.1%}' for share in shares)}"
    return worst and shares[0] == max(shares) > 0, text


def _icp_best_in_the_office(of: Figures) -> RuleResult:
    best, ate = _extremes(of, OFFICE, "clean", min), _ates(of, OFFICE, "clean", "icp")
    return set(best) == {"icp"} and ate[1] == max(
        ate
    ), f"least ATE: {_names(best)}; ICP {_mm(*ate)}"


def _assumptions(of: Figures) -> RuleResult:
    """Why photometric methods do worse is decided by frames without reflections, where they should
    do better.
    """
    fact, text = _photometric_poor(of, OFFICE)
    without = [of.ate(OFFICE, kt, LAMBERTIAN, name) for name in PHOTOMETRIC for kt in TRAJECTORIES]
    known = [value for value in without if value is not None]
    if not fact or len(known) < len(without):
        return (None if fact else False), text
    mean, before = (
        _mean(known),
        _mean([v for name in PHOTOMETRIC for v in _ates(of, OFFICE, "clean", name)]),
    )
    return mean <= _EXPLAINED * before, f"{text}; DVO and RGB-D without reflections {_mm(mean)}"


def _noise_costs_surface(of: Figures) -> RuleResult:
    clean, noisy = (_surfaces(of, noise, "icp") for noise in ("clean", "noisy"))
    return sum(noisy) > sum(clean), f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy"


def _icp_best_surfaces(of: Figures) -> RuleResult:
    clean, noisy = (_surfaces(of, noise, "icp") for noise in ("clean", "noisy"))
    text, grown = (
        f"ICP's surfaces {_mm(*clean)} clean, {_mm(*noisy)} noisy",
        _grown(clean, noisy) == _ALL_BUT_KT0,
    )
    if isinstance(of, Printed):  # the paper prints no noisy surfaces of the other odometers
        return grown, text
    others = [_surfaces(of, "noisy", name) for name in TITLES if name != "icp"]
    wins = sum(noisy[k] < min(other[k] for other in others) for k in range(len(noisy)))
    return grown and wins == len(noisy), f"{text}; the best of the five on {wins} of {len(noisy)}"


def _noise_costs_icp_but_on_kt0(of: Figures) -> RuleResult:
    clean, noisy = (_ates(of, LIVING, noise, "icp") for noise in ("clean", "noisy"))
    return _grown(
        clean, noisy
    ) == _ALL_BUT_KT0, f"ICP's ATE {_mm(*clean)} clean, {_mm(*noisy)} noisy"


def _icp_suffers_on_kt3(of: Figures) -> RuleResult:
    clean, noisy = (_ates(of, LIVING, noise, "icp") for noise in ("clean", "noisy"))
    growth = [b / a for a, b in zip(clean, noisy, strict=True)]
    text = f"with noise, ICP's ATE is {', '.join(f'{g:.3g}' for g in growth)} times as large"
    return growth[3] == max(growth) and growth[3] >= _STRONGLY, text


def _noise_may_help(of: Figures) -> RuleResult:
    falls = {}
    for name in (*PHOTOMETRIC, "fovis"):
        grown = _grown(*(_ates(of, LIVING, noise, name) for noise in ("clean", "noisy")))
        falls[name] = [kt for kt, more in zip(TRAJECTORIES, grown, strict=True) if not more]
    text = "; ".join(
        f"{TITLES[name]} falls on {', '.join(kts) or 'none'}" for name, kts in falls.items()
    )
    return len(list(filter(None, falls.values()))) >= 2 and bool(falls["fovis"]), text


def _office_noisy(of: Figures) -> RuleResult:
    clean, noisy = (_ates(of, OFFICE, noise, "icp") for noise in ("clean", "noisy"))
    dvo, kt3 = _five(of, OFFICE, "noisy", "kt1")["dvo"], _extremes(of, OFFICE, "noisy", min)[3]
    text = f"ICP {_mm(*clean)} clean, {_mm(*noisy)} noisy; kt1: DVO {_mm(dvo)}; least ATE on kt3: {TITLES[kt3]}"
    return all(_grown(clean, noisy)) and dvo < noisy[1] and kt3 == "icp_rgbd", text


def _photometric_robust(of: Figures) -> RuleResult:
    growth = []
    for names in ((*PHOTOMETRIC, "fovis"), ("icp",)):
        where = [(room, name) for room in (LIVING, OFFICE) for name in names]
        clean, noisy = (
            [v for room, name in where for v in _ates(of, room, n, name)]
            for n in ("clean", "noisy")
        )
        growth.append(_mean(noisy) / _mean(clean))
    text = f"with noise, the ATE of DVO, RGB-D and FOVIS is {growth[0]:.3g} times as large, ICP's {growth[1]:.3g} times"
    return growth[0] < growth[1], text


#: The main finding: our verdict uses all cells that have a surface, not figures of named cells.
_MAIN = 4
#: Number -> the rule, and its condition in words.
RULES: dict[int, tuple[Callable[[Figures], RuleResult], str]] = {
    1: (_kt2_best_kt0_worst, "the mean surface error is least on kt2 and greatest on kt0"),
    2: (_nearer_but_rougher, "DVO's ATE is below ICP's, its mean surface error above"),
    3: (
        _the_model_is_the_reason,
        "for ICP and for DVO, the surface of kt0 is better with the model than without",
    ),
    _MAIN: (
        _nearer_but_rougher,
        "it does so in at least one pair whose ATE and surface error differ by over 10 %",
    ),
    5: (
        _the_model_helps_dvo,
        "DVO's mean surface error is smaller with the model on all four trajectories",
    ),
    6: (_dvo_on_kt0_icp_elsewhere, "least ATE of the five: DVO on kt0, ICP on kt1 to kt3"),
    7: (_fovis_worst, "FOVIS has the greatest ATE of the five on all four trajectories"),
    8: (
        _photometric_poor,
        "geometric mean of the ATE over both odometers and all four trajectories",
    ),
    9: (
        _icp_slides_on_kt0,
        "ICP's ATE is greatest on kt0, and so is its share of under-constrained frames",
    ),
    10: (
        _icp_best_in_the_office,
        "ICP has the least ATE of the five on all four trajectories, its greatest on kt1",
    ),
    11: (
        _assumptions,
        "they are worse by the geometric mean, and without reflections (--lambertian) their error is at most half as large",
    ),
    12: (
        _noise_costs_surface,
        "ICP's mean surface error over the four trajectories grows with noise",
    ),
    13: (
        _icp_best_surfaces,
        "ICP's noisy surface is the best of the five on all four; its error grows on all but kt0",
    ),
    14: (_noise_costs_icp_but_on_kt0, "ICP's ATE grows on kt1 to kt3 and falls on kt0"),
    15: (
        _icp_suffers_on_kt3,
        f"ICP's ATE grows most on kt3, by a factor of at least {_STRONGLY:g}",
    ),
    16: (
        _noise_may_help,
        "the ATE of two or more of DVO, RGB-D and FOVIS, FOVIS among them, falls on some trajectory",
    ),
    17: (
        _office_noisy,
        "ICP's ATE grows on all four; DVO's is below ICP's on kt1; ICP+RGB-D's is least on kt3",
    ),
    18: (_photometric_robust, "growth of the geometric mean of the ATE over both rooms"),
}
