"""The tables and sentences of docs/measured that are drawn from measured cells."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from statistics import geometric_mean, mean, median
from typing import Any

from iclnuim.benchmark.experiments.intervals import log_interval
from iclnuim.benchmark.experiments.recipes.paper.best_methods import best_methods_table
from iclnuim.benchmark.experiments.recipes.paper.charts import FIGURES
from iclnuim.benchmark.experiments.recipes.paper.correlation import correlation_table
from iclnuim.benchmark.experiments.recipes.paper.figures import (
    AUTHORS,
    Ours,
    Printed,
    Where,
    ate_of,
    reference_of,
    surface_of,
    system_key,
)
from iclnuim.benchmark.experiments.recipes.paper.findings import (
    findings_table,
    headline,
    verdicts_table,
)
from iclnuim.benchmark.experiments.recipes.paper.keys import NOISES, PaperKey, paper_odometers
from iclnuim.benchmark.experiments.recipes.paper.speed import speed_table
from iclnuim.benchmark.experiments.recipes.paper.tables import preset_tables, quality_of
from iclnuim.benchmark.experiments.recipes.stress.recipe import system_name
from iclnuim.benchmark.experiments.recipes.stress.tables import Summary, method_name
from iclnuim.benchmark.experiments.table import NOT_MEASURED, ResultTable, mm, shown
from iclnuim.benchmark.perturbations.plan import CLEAN, NOISY, SEVERITIES, read_plan
from iclnuim.shipped import TRAJECTORY_NAMES, further_sequences, paper_sequences
from iclnuim.tools.measured_cells import PublishedCells
from iclnuim.tools.measured_tables import Rows, words
from iclnuim.tools.scene_ways_drawn import (
    scene_blocks_table,
    scene_ways_figure,
    scene_ways_table,
)
from iclnuim.tools.sensor_curves import DARK, PUBLISHED, of_model
from matplotlib.figure import Figure

#: The programs by the authors of a method, and our odometer.
_AUTHORS = tuple((program, name) for name, program in AUTHORS.items())
_SYSTEMS = ("ORB-SLAM3", "RTAB-Map", *AUTHORS.values())
#: The systems among the methods of `iclnuim stress`.
_STRESS_SYSTEMS = tuple(map(system_name, ("libfovis", "dvo_core", "orbslam3")))
_OURS = ("fovis", "rgbd", "dvo", "icp", "icp_rgbd")
#: A coverage above is shown as whole.
_ALL = 0.995
#: The columns of our figures next to the printed ones.
_PRINTED = " | ".join(f"{kt} | printed" for kt in TRAJECTORY_NAMES)
_MEASURED = Path(__file__).resolve().parents[1] / "docs/measured"
Drawn = Callable[[PublishedCells], Rows]


def sequences() -> list[tuple[str, str, str]]:
    """Room, trajectory and noise of the sixteen sequences."""
    found = []
    for sequence in (*paper_sequences(), *further_sequences()):
        room, _, trajectory = sequence.partition("/")
        found += [(room, trajectory, noise) for noise in ("clean", "noisy")]
    return found


def _noisy_sequences() -> list[tuple[str, str, str]]:
    return [sequence for sequence in sequences() if sequence[2] == "noisy"]


def _title(sequence: tuple[str, str, str]) -> str:
    return " ".join(sequence).replace("_", " ")


def _errors_m(cells: PublishedCells) -> dict[PaperKey, list[float]]:
    """ATE in metres by key; of a system's runs under the key of run 0."""
    found: dict[PaperKey, list[float]] = {}
    for result in cells.benchmark():
        ate_m = ate_of(result.figures)
        if ate_m is not None:
            found.setdefault(replace(result.key, run=0), []).append(ate_m)
    return found


def _ours(sequence: tuple[str, str, str], odometer: str, preset: str = "best") -> PaperKey:
    return PaperKey(*sequence, odometer, preset, "default")


def _mm(error_m: float) -> str:
    """Three digits, and no exponent from a metre on."""
    return mm(error_m) if error_m < 1 else mm(error_m, ",.0f")


def _shown(errors_m: Sequence[float] | None) -> str:
    """The median in mm, with the smallest and the largest of several runs."""
    if not errors_m:
        return NOT_MEASURED
    shown = [_mm(error_m) for error_m in (median(errors_m), min(errors_m), max(errors_m))]
    return shown[0] if len(errors_m) == 1 else "{} ({} to {})".format(*shown)


def accuracy(cells: PublishedCells) -> Rows:
    """ATE in mm of our odometers on every sequence."""
    return _by_sequence(cells, _ours, _OURS)


def systems(cells: PublishedCells) -> Rows:
    """ATE in mm of the third-party systems on every sequence."""
    return _by_sequence(cells, system_key, _SYSTEMS)


def _by_sequence(
    cells: PublishedCells, key_of: Callable[..., PaperKey], methods: Sequence[str]
) -> Rows:
    errors_m = _errors_m(cells)
    rows = []
    for sequence in sequences():
        found = [_shown(errors_m.get(key_of(sequence, name))) for name in methods]
        rows.append([_title(sequence), *found])
    return [["ATE, mm", *methods], *rows]


def authors(cells: PublishedCells) -> Rows:
    """The preset `paper` next to the program of the method's authors."""
    errors_m = _errors_m(cells)
    rows = []
    for sequence in sequences():
        row = [_title(sequence)]
        for title, name in _AUTHORS:
            ours = errors_m.get(_ours(sequence, name, "paper"))
            theirs = errors_m.get(system_key(sequence, title))
            ratio = f"{ours[0] / theirs[0]:.2f}" if ours and theirs else "-"
            row += [_shown(ours), _shown(theirs), ratio]
        if row[1::3] != [NOT_MEASURED] * len(_AUTHORS):
            rows.append(row)
    columns = ["ATE, mm"]
    for title, name in _AUTHORS:
        columns += [f"`{name} --preset paper`", title, "ratio"]
    return [columns, *rows]


def cost(cells: PublishedCells) -> Rows:
    """Processor time a frame in ms, the median over the sequences; images are read, too."""
    times: dict[tuple[str, str], list[float]] = {}
    for result in cells.benchmark():
        track_s = result.figures.get("times", {}).get("track_s")
        key = result.key
        if track_s is not None and key.preset == "best":
            name = f"{key.odometer}{', model' * (key.reference == 'model')}"
            times.setdefault((name, key.noise), []).append(track_s / result.figures["frames"])
    medians = {of: [median(some)] for of, some in times.items()}
    rows = []
    for name in dict.fromkeys(name for name, _ in sorted(times)):
        found = [_shown(medians.get((name, noise))) for noise in NOISES]
        rows.append([f"`{name}`", *found])
    return [["processor time, ms a frame", "clean", "noisy"], *rows]


def speed(cells: PublishedCells) -> Rows:
    """Accuracy, surface and cost of every method under every condition."""
    return _rows(speed_table(cells.benchmark()))


def best_methods(cells: PublishedCells) -> Rows:
    """Which method for which condition."""
    return _rows(best_methods_table(cells.benchmark()))


def _rows(table: ResultTable) -> Rows:
    return [list(table.columns), *map(list, table.rows)]


def verdicts(cells: PublishedCells) -> Rows:
    """The findings with the verdict of each method."""
    return _rows(verdicts_table(cells.benchmark()))


def verdicts_in_short(cells: PublishedCells) -> Rows:
    """How many findings hold with each method."""
    return words("findings of section VI", [[line] for line in headline(cells.benchmark())])


def causes(cells: PublishedCells) -> Rows:
    """The findings that the cells of `best` decide: figures, verdict, seeds, and cause."""
    rows = []
    table = findings_table(cells.benchmark())
    for number, _, _, printed, ours, verdict, seeds, cause, _ in table.rows:
        of_seeds = "" if seeds == "-" else f" ({seeds})"
        rows.append((number, printed, ours, f"{verdict}{of_seeds}", cause))
    return words("no. | printed | `best` | verdict, seeds | cause", rows)


def as_printed(number: int, preset: str) -> Drawn:
    """A table of the paper whole: every statistic of a preset beside the printed one."""
    suffix = "" if preset == "best" else f"_{preset}"

    def drawn(cells: PublishedCells) -> Rows:
        tables = {table.name: table for table in preset_tables(cells.benchmark(), preset)}
        table = tables[f"table_{number}{suffix}"]
        rows = []
        for row in table.rows:
            printed = dict(zip(table.columns, row, strict=True)).get("printed", "")
            shown = [text or (NOT_MEASURED if printed else "-") for text in row[2:]]
            rows.append([*row[:2], *shown])
        return [list(table.columns), *rows]

    return drawn


def paper_figures(cells: PublishedCells) -> Rows:
    """The pictures of Figures 5 to 9, drawn from a folder with the pictures of its cells."""
    rows = []
    for number in range(5, 10):
        name = f"pictures/figure_{number}.jpg"
        there = (_MEASURED / name).is_file()
        picture = f"![Figure {number}]({name})" if there else NOT_MEASURED
        rows.append((number, FIGURES[number][1], picture))
    return words("figure | content | ours", rows)


def noise_seeds(cells: PublishedCells) -> Rows:
    """ATE in mm over the noise seeds of the paper's odometers, each with the paper's reference."""
    over_seeds: dict[PaperKey, list[float]] = {}
    for key, errors_m in _errors_m(cells).items():
        over_seeds.setdefault(replace(key, seed=0), []).extend(errors_m)
    rows = []
    for sequence in _noisy_sequences():
        keys = [PaperKey(*sequence, name, "best", reference_of(name)) for name in paper_odometers()]
        found = [over_seeds.get(key, []) for key in keys]
        counts = [len(errors_m) for errors_m in found]
        seeds = dict.fromkeys((min(counts), max(counts)))
        rows.append([_title(sequence), *map(_shown, found), " to ".join(map(str, seeds))])
    return [["ATE, mm", *paper_odometers(), "seeds"], *rows]


def correlations(cells: PublishedCells) -> Rows:
    """Whether a better trajectory has the better surface."""
    return _rows(correlation_table(cells.benchmark()))


def papers_methods(cells: PublishedCells) -> Rows:
    """ATE in mm of the paper's methods, of their authors' programs and of those with a model whose
    window is before the camera, next to the printed ones; where frames are lost, with the share of
    those that have poses.
    """
    ours = Ours(cells.benchmark(), "paper")
    theirs = replace(ours, programs=AUTHORS)
    ahead = replace(ours, model="model-ahead")
    rows = []
    for condition, places in _conditions():
        for name in paper_odometers():
            printed_m = [Printed().ate(Where(*place, name)) for place in places]
            methods = {name: ours}
            if name in AUTHORS:
                methods[AUTHORS[name]] = theirs
            if reference_of(name) == "model":
                methods[f"{name}, window ahead"] = ahead
            for title, of in methods.items():
                found = [_with_coverage(of.figures(Where(*place, name))) for place in places]
                rows.append([condition, title, *_beside(found, printed_m)])
    return words(f"ATE, mm | | {_PRINTED}", filter(_has_ours, rows))


def _with_coverage(figures: Mapping[str, Any]) -> str:
    text = _or_not(ate_of(figures))
    coverage = figures.get("coverage", 1.0)
    return text if coverage > _ALL or text == NOT_MEASURED else f"{text} ({100 * coverage:.0f} %)"


def against_model(cells: PublishedCells) -> Rows:
    """ATE in mm of icp and icp_rgbd against a model, next to those against keyframes."""
    ours = Ours(cells.benchmark())
    rows = []
    for condition, places in _conditions():
        for name in ("icp", "icp_rgbd"):
            beside = []
            for place, reference in product(places, ("model", "default")):
                beside.append(_or_not(ours.ate(Where(*place, name, reference))))
            rows.append([condition, name, *beside])
    header = " | ".join(f"{kt} | keyframes" for kt in TRAJECTORY_NAMES)
    return words(f"ATE, mm | | {header}", filter(_has_ours, rows))


def _conditions() -> Iterator[tuple[str, list[tuple[str, str, str]]]]:
    """The conditions of Tables III to VI in words, with the places of their four sequences."""
    for noise, room in product(NOISES, ("living_room", "office")):
        places = [(room, kt, noise) for kt in TRAJECTORY_NAMES]
        yield f"{room.replace('_', ' ')} {noise}", places


def surfaces(cells: PublishedCells) -> Rows:
    """Mean distance in mm of the surfaces of the living room to the model."""
    results = cells.benchmark()
    paper = Ours(results, "paper")
    views = {
        "paper": paper,
        "paper, window ahead": replace(paper, model="model-ahead"),
        "best": Ours(results),
    }
    rows = []
    for noise, (preset, ours), name in product(NOISES, views.items(), paper_odometers()):
        if ours.model != "model" and reference_of(name) != "model":
            continue  # the same cells as of `paper`
        wheres = [Where("living_room", kt, noise, name) for kt in TRAJECTORY_NAMES]
        found = [_or_not(ours.surface(where)) for where in wheres]
        beside = _beside(found, map(Printed().surface, wheres))
        rows.append([noise, f"{name}, {preset}", *beside])
    return words(f"mean distance, mm | | {_PRINTED}", filter(_has_ours, rows))


def _beside(ours: Iterable[str], printed_m: Iterable[float | None]) -> list[str]:
    """Ours and the printed figures in mm, alternately."""
    found = []
    for text, other_m in zip(ours, printed_m, strict=True):
        found += [text, mm(other_m, ".1f")]
    return found


def _has_ours(row: Sequence[str]) -> bool:
    """Whether a figure of ours is in a row of two words and then ours and printed alternately."""
    return set(row[2::2]) != {NOT_MEASURED}


def _or_not(length_m: float | None) -> str:
    return NOT_MEASURED if length_m is None else _mm(length_m)


# -- stress


def stress_summary(cells: PublishedCells, base: str = CLEAN) -> Summary:
    """The cells of `iclnuim stress` of a base; ours first, then the systems."""
    every = cells.stress().items()
    found = {key: outcome.to_dict() for key, outcome in every if key.base == base}
    further = sorted({key.method for key in found} - {*_OURS, *_STRESS_SYSTEMS})
    plan = read_plan()
    measured = {key.perturbation for key in found}
    names = tuple(name for name in plan.perturbations if name in measured)
    return Summary.of(plan, [*_OURS, *_STRESS_SYSTEMS, *further], names, found, base)


def stress_fails(cells: PublishedCells) -> Rows:
    """The lowest severity of a perturbation of clean frames at which at least half of the segments
    fail; of our odometers and of the systems.
    """
    return _fails(stress_summary(cells))


def stress_noisy(cells: PublishedCells) -> Rows:
    """The same of noisy frames, with the severities that were measured."""
    summary = stress_summary(cells, NOISY)
    header, *rows = _fails(summary)
    found = [[header[0], "measured", *header[1:]]]
    for name, *failing in rows:
        keys = [key for key in summary.groups if f"`{key[1]}`" == name]
        found.append([name, _severities(keys), *failing])
    return found


def _fails(summary: Summary) -> Rows:
    shown = [name for name in summary.methods if name in (*_OURS, *_STRESS_SYSTEMS)]
    rows = []
    for name in summary.perturbations:
        found = [_first_failure(summary, method, name) for method in shown]
        failing = [", ".join(filter(None, pair)) for pair in found]
        if any(failing):
            rows.append([f"`{name}`", *(word or NOT_MEASURED for word in failing)])
    return [["first fails at severity", *map(method_name, shown)], *rows]


def _severities(keys: Iterable[tuple[str, str, int]]) -> str:
    """`1, 3, 5`, or `1 to 5` for all: those of the perturbed groups with these keys."""
    found = sorted({severity for _, _, severity in keys if severity})
    if len(found) == SEVERITIES:
        return f"{found[0]} to {found[-1]}"
    return ", ".join(map(str, found))


def _first_failure(summary: Summary, method: str, perturbation: str) -> tuple[str, str]:
    """The severity, a dash if it fails at none, empty without cells; and `not 3, 4`: those above it
    at which it does not fail, empty if there are none.
    """
    fails = {}
    for severity, group in enumerate(summary.row(method, perturbation)[1:], 1):
        if group is not None:
            fails[severity] = group.failed
    first = next((severity for severity, failed in fails.items() if failed), None)
    if first is None:
        return ("-" if fails else "", "")
    above = [str(severity) for severity, failed in fails.items() if severity > first and not failed]
    return str(first), f"not {', '.join(above)}" if above else ""


def stress_totals(cells: PublishedCells) -> Rows:
    """Means over all perturbed groups of each method, clean frames perturbed."""
    return _totals(stress_summary(cells))


def stress_noisy_totals(cells: PublishedCells) -> Rows:
    """The same of noisy frames, at the severities that were measured with every perturbation."""
    summary = stress_summary(cells, NOISY)
    counts = Counter(severity for _, _, severity in summary.groups)
    whole = max(counts.values(), default=0)
    kept = {
        key: some for key, some in summary.groups.items() if counts[key[2]] == whole or not key[2]
    }
    return _totals(replace(summary, groups=kept))


def _totals(summary: Summary) -> Rows:
    """A row for each method; the last column is of unperturbed frames."""
    rows = []
    for method in summary.methods:
        groups = {key: group for key, group in summary.groups.items() if key[0] == method}
        clean = summary.row(method, summary.perturbations[0])[0]
        perturbed = [group for group in groups.values() if group is not clean]
        shares = (
            mean(group.succeeded for group in perturbed),
            mean(group.false_successes for group in perturbed),
            mean(group.false_alarms for group in perturbed),
        )
        segments = sum(group.segments for group in perturbed)
        texts = [_severities(groups), str(segments), *(f"{share:.1%}" for share in shares)]
        rows.append([method_name(method), *texts, _or_not(clean.ate_m if clean else None)])
    header = (
        "method | severities | segments | succeed | frames: wrong, reported as good"
        " | frames: right, reported as bad | unperturbed ATE, mm"
    )
    return words(header, rows)


# -- what we learned


def learned_noise(cells: PublishedCells) -> Rows:
    """A row for each of our odometers: its mean ATE on the noisy sequences, with the range over the
    noise seeds with which all of them are measured, and over the best.
    """
    errors_m = _errors_m(cells)
    noisy = _noisy_sequences()
    means_m: dict[str, list[float]] = {}
    worst_m: dict[str, float] = {}
    for name, seed in product(_OURS, {key.seed for key in errors_m}):
        keys = [replace(_ours(sequence, name), seed=seed) for sequence in noisy]
        found = [errors_m[key][0] for key in keys if key in errors_m]
        if len(found) == len(noisy):
            means_m.setdefault(name, []).append(geometric_mean(found))
            worst_m[name] = max(worst_m.get(name, 0), *found)
    ranked = sorted((median(of_seeds), name) for name, of_seeds in means_m.items())
    rows = []
    for mean_m, name in ranked:
        over_best = f"{mean_m / ranked[0][0]:.2f}"
        seeds = len(means_m[name])
        rows.append([f"`{name}`", _shown(means_m[name]), over_best, mm(worst_m[name]), str(seeds)])
    return words("odometer | mean ATE, mm | over the best | worst sequence, mm | seeds", rows)


def learned_pairs(cells: PublishedCells) -> Rows:
    """The ratio of the ATE of each pair of the odometers that use the image, on the noisy
    sequences, with its 95 % interval; of noise seeds the median.
    """
    over_seeds: dict[PaperKey, list[float]] = {}
    for key, errors_m in _errors_m(cells).items():
        over_seeds.setdefault(replace(key, seed=0), []).extend(errors_m)
    rows = []
    for one, other in combinations([name for name in _OURS if name != "icp"], 2):
        ratios = []
        for sequence in _noisy_sequences():
            both = [over_seeds.get(_ours(sequence, name)) for name in (one, other)]
            if both[0] and both[1]:
                ratios.append(median(both[0]) / median(both[1]))
        if len(ratios) > 1:
            texts = [f"{value:.2f}" for value in log_interval(ratios)]
            rows.append((f"`{one}` / `{other}`", *texts, len(ratios)))
    return words("ratio of the ATE | mean | 95 % from | to | sequences", rows)


def surface_quality(cells: PublishedCells) -> Rows:
    """The surfaces of the living room along the trajectories of our odometers, against the model."""
    ours = Ours(cells.benchmark())
    rows = []
    for noise, name, kt in product(NOISES, paper_odometers(), TRAJECTORY_NAMES):
        figures = ours.figures(Where("living_room", kt, noise, name))
        if "surface" in figures:
            lengths = ("accuracy_m", "completion_m", "depth_l1_m")
            texts = [mm(quality_of(length)(figures)) for length in lengths]
            share = shown(quality_of("f_score", "1cm")(figures), ".1f", 100)
            mean_mm = mm(surface_of(figures))
            rows.append((f"{kt} {noise}", f"`{name}`", mean_mm, *texts, share))
    header = "living room | odometer | mean mm | accuracy mm | completion mm | Depth L1 mm"
    return words(f"{header} | F 1 cm, %", rows)


def learned_orbslam3(cells: PublishedCells) -> Rows:
    """The perturbations at whose mildest severity ORB-SLAM3 fails, and those at which it never
    does.
    """
    summary = stress_summary(cells)
    by_severity: dict[str, list[str]] = {}
    for name in summary.perturbations:
        severity, others = _first_failure(summary, "run:orbslam3", name)
        if severity:
            text = f"`{name}` ({others})" if others else f"`{name}`"
            by_severity.setdefault(severity, []).append(text)
    rows = []
    for severity in sorted(by_severity, key=lambda word: (word == "-", word)):
        what = f"first at severity {severity}" if severity != "-" else "at none"
        rows.append([what, ", ".join(by_severity[severity])])
    sizes = {group.segments for key, group in summary.groups.items() if key[0] == "run:orbslam3"}
    n = " to ".join(map(str, sorted(sizes)))
    return words(f"ORB-SLAM3 fails, of n = {n} segments | with", rows)


def learned_light(cells: PublishedCells) -> Rows:
    """The error of baked light."""
    rows = [row for row in cells.facts("light") if row[0].startswith("PSNR of baked light")]
    return [["what", "measured", "command", "commit"], *rows]


def loaders(cells: PublishedCells) -> Rows:
    """The rows that tools/loaders.py has stored."""
    rows = []
    for row in _stored("loaders.csv"):
        figures = [_one_digit(row[name]) for name in ("poses", "camera", "depth_units")]
        name = f"{row['loader']} `{row['commit']}`"
        rows.append((name, f"`{row['format']}`", row["frames"], row["order"], *figures))
    return words("loader | format | frames | in order | poses | camera, px | depth, units", rows)


def rooms(cells: PublishedCells) -> Rows:
    """Public rooms: what `auto:6` sees, path tracing next to plain Cycles, baked light."""
    columns = ["room", "seen", "dB", "mm", "baked", "notes"]
    rows = [row for row in _stored("own_scenes.csv") if not row["refused"]]
    return [columns, *([row[name] for name in columns] for row in rows)]


def refused_rooms(cells: PublishedCells) -> Rows:
    """Public rooms that end in a line."""
    rows = [row for row in _stored("own_scenes.csv") if row["refused"]]
    return [["room", "refused"], *([row["room"], row["refused"]] for row in rows)]


def scene_ways(cells: PublishedCells) -> Rows:
    """The way that was chosen for each scene, beside the fastest that holds 40 dB."""
    return scene_ways_table(_stored("own_scenes_ways.csv"))


def scene_blocks(cells: PublishedCells) -> Rows:
    """Errors of frames against plain Cycles, in blocks of pixels."""
    return scene_blocks_table(_stored("own_scenes_ways.csv"))


def ways_figure() -> Figure:
    """Time and error of every way to light each scene."""
    return scene_ways_figure(_stored("own_scenes_ways.csv"))


def scene_checks(cells: PublishedCells) -> Rows:
    rows = [list(row.values()) for row in _stored("own_scenes_checks.csv")]
    return [["what", "measured", "command", "commit"], *rows]


def published_sensors(cells: PublishedCells) -> Rows:
    """Printed figures of devices, and what our models do there."""
    rows = []
    for point in PUBLISHED:
        unit = "%" if point.what == "fill" else "mm"
        place = f"{point.what} at {point.depth_m:g} m"
        if point.albedo == DARK:
            place += ", dark wall"
        source = f"{point.source}: {point.apart}" if point.apart else point.source
        rows.append((f"`{point.model}`", place, point.how, f"{of_model(point):.2f} {unit}", source))
    return words("model | what | printed | ours | source", rows)


def _stored(name: str) -> list[dict[str, str]]:
    with (_MEASURED / name).open(newline="") as file:
        return list(csv.DictReader(file))


def _one_digit(figure: str) -> str:
    return f"{float(figure):.1g}" if figure else "not read"


DRAWN: dict[str, Drawn] = {
    "odometry-ate": accuracy,
    "odometry-paper": authors,
    "odometry-cost": cost,
    "systems-ate": systems,
    "benchmark-best": best_methods,
    "benchmark-speed": speed,
    "benchmark-verdicts": verdicts,
    "benchmark-headline": verdicts_in_short,
    "benchmark-causes": causes,
    **{
        f"tables-{number}-{preset}": as_printed(number, preset)
        for number, preset in product(range(2, 8), ("paper", "best"))
    },
    "tables-figures": paper_figures,
    "benchmark-paper": papers_methods,
    "benchmark-model": against_model,
    "benchmark-seeds": noise_seeds,
    "benchmark-surfaces": surfaces,
    "benchmark-correlation": correlations,
    "stress-fails": stress_fails,
    "stress-noisy": stress_noisy,
    "stress-noisy-totals": stress_noisy_totals,
    "stress-totals": stress_totals,
    "own_scenes-rooms": rooms,
    "own_scenes-refused": refused_rooms,
    "own_scenes-ways": scene_ways,
    "own_scenes-blocks": scene_blocks,
    "own_scenes-checks": scene_checks,
    "learned-noise": learned_noise,
    "learned-pairs": learned_pairs,
    "surface-quality": surface_quality,
    "learned-orbslam3": learned_orbslam3,
    "learned-light": learned_light,
    "formats-loaders": loaders,
    "sensors-published": published_sensors,
}
