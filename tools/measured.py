"""Regenerates the measured tables and charts of the pages, each with the command that is listed
here.

    python tools/measured.py --list                    pages, marks, commands
    python tools/measured.py --only light    marks that begin so, or those of docs/measured/light
    python tools/measured.py --only farm --keep out/measured    also store the output of the
    commands; stored output is not measured again
    python tools/measured.py --only docs/measured/odometry --program orbslam3=/opt/orb/bin/python
    a system that is not found on PATH

In a page, a table is between `<!-- measured: MARK -->` and `<!-- end of MARK -->`. The script
writes the text between these marks, and the pictures that the pages show. Commands run in the top
folder of the checkout; sequences are those that `iclnuim make all` writes to out/.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import geometric_mean, mean
from typing import Any

from iclnuim.benchmark.odometry.registry import names
from iclnuim.benchmark.perturbations.plan import read_plan

TOP = Path(__file__).resolve().parents[1]
_PAGES = "docs/measured"
_PICTURES = f"{_PAGES}/pictures"
_KT2 = "out/living_room/kt2"
_SEQUENCES = [f"{room}/kt{k}" for room, k in product(("living_room", "office"), range(4))]
_NOISY = [f"out/{sequence}/noisy" for sequence in _SEQUENCES]
_SIXTEEN = " ".join(f"out/{sequence}/clean out/{sequence}/noisy" for sequence in _SEQUENCES)
_SYSTEMS = ("orbslam3 --runs 3 --vocabulary ORBvoc.txt", "rtabmap", "fovis", "dvo")
_BIASED = ("icp", "rgbd", "icp_rgbd")
_DETAIL = "bench detail --lit none --maps 512,1024,2048 --every 60"
_STRESS_METHODS = (
    "fovis",
    "rgbd",
    "dvo",
    "icp",
    "icp_rgbd",
    "opencv",
    "plane",
    "intensity",
)
_STRESS = (
    f"stress {_KT2}/clean out/office/kt1/clean --starts 1 --system fovis --system dvo"
    " --system orbslam3 --set orbslam3.vocabulary=ORBvoc.txt --runs 3"
    + "".join(f" --methods {name}" for name in _STRESS_METHODS)
)
_CLEAN_TWO = f"{_KT2}/clean out/office/kt1/clean"
_FOUR = f"{_KT2}/clean {_KT2}/noisy out/office/kt1/clean out/office/kt1/noisy"
#: Curve -> sequences, number of frames, and the step to which the table refers: the default, or one
#: at which all methods work.
_CURVES = {
    "iterations": (_FOUR, 120, 1.0),
    "levels": (_FOUR, 120, 0.0),
    "pixels": (_FOUR, 120, 1.0),
    "resolution": (_FOUR, 120, 640.0),
    "keyframe": (_FOUR, 120, 0.02),
    "rate": (f"{_CLEAN_TWO} --values 15,30,60,120,240", 60, 30.0),
    "realtime": (_FOUR, 120, 1.0),
}
_DETAIL_ODOMETRY = "bench detail-odometry --levels 0.5,0.7,1,1.4 --first 120"
_NOISE = f"bench noise {_KT2}/raw --frames :120 --official ../shared/data/iclnuim/or_kt3"
#: Title of the row, kind of sequence, options of `fuse`.
_SURFACES = (
    ("clean, `best`", "clean", ""),
    ("clean, `--preset paper`", "clean", "--preset paper"),
    ("noisy (`released`), `best --min-weight 3`", "noisy", "--min-weight 3"),
)

#: Headings of the third-party systems among the methods of `iclnuim stress`.
_TITLES = {"run:fovis": "FOVIS", "run:dvo": "DVO", "run:orbslam3": "ORB-SLAM3"}
#: The text of a table from the output of each of its commands.
Text = Callable[[Sequence[Any]], str]


@dataclass(frozen=True)
class Measured:
    """One table: its page, its mark, the commands (words after `iclnuim`; --json is added), and
    the function that makes the text from their output.
    """

    name: str
    mark: str
    commands: tuple[str, ...]
    text: Text
    #: A file of the commands' output that is published next to the page.
    data: Path | None = None

    @property
    def page(self) -> str:
        return f"{_PAGES}/{self.name}.md"

    @property
    def begin(self) -> str:
        return f"<!-- measured: {self.mark} -->\n"

    @property
    def end(self) -> str:
        return f"<!-- end of {self.mark} -->\n"


def table(header: Sequence[str] | str, rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown. header: the columns, or their text with " | " between them."""
    if isinstance(header, str):
        header = header.split(" | ")
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)


def _shown(value: float | None, spec: str, unit: str = "", factor: float = 1.0) -> str:
    """factor times the value with its unit; empty if it was not measured."""
    if value is None:
        return ""
    return f"{factor * value:{spec}}{unit}"


def _plain(sequence: str) -> str:
    return sequence.replace("_", " ").replace("/", " ")


def _mm(run: dict[str, Any]) -> str:
    """The ATE of a run in mm."""
    ate_m = run["ate_rmse_m"]
    if ate_m is None:
        return "-"
    digits = 3 if ate_m < 1 else 4
    return f"{1e3 * ate_m:.{digits}g}"


def _light(found: Sequence[Any]) -> str:
    rows = []
    for one in found[0]["methods"]:
        psnr_db = one["error"]["psnr_db"]
        rows.append(
            (
                one["method"]["family"],
                one["method"]["label"],
                f"{one['seconds']:.3g}",
                f"{mean(psnr_db):.1f}",
                f"{min(psnr_db):.1f}",
                f"{one['error']['median']:.4f}",
                f"{255 * one['flicker']:.2f}",
            )
        )
    header = (
        "light | samples | s/frame | PSNR dB | worst view | median error"
        " | median change from frame to frame (of 255)"
    )
    return table(header, rows)


def _textures(found: Sequence[Any]) -> str:
    rows = []
    for r in found[0]["rows"]:
        differences = [r["change_median"], r["change_mean"], r["difference"]]
        of_255 = [_shown(d, ".2f", factor=255) for d in differences]
        rows.append((_plain(r["sequence"]), r["textures"], *of_255))
    header = (
        "sequence | textures | median change | mean change | mean difference from 16 rays a pixel"
    )
    return table(header, rows)


def _levels(room: str) -> Text:
    def text(found: Sequence[Any]) -> str:
        knee = found[0]["knee"][room]
        rows = []
        for level in found[0]["levels"][room]:
            title = f"{level['detail']:g}"
            if level["detail"] == knee:
                title += ", the knee"
            if level["detail"] == 1:
                title = f"**{title}**"
            rows.append((title, *_level_figures(level)))
        header = (
            "detail | triangles | mean depth error | 99 % | off by more than 5 mm"
            " | colour, PSNR | build | frame"
        )
        return table(header, rows)

    return text


def _level_figures(level: dict[str, Any]) -> tuple[str, ...]:
    """The finest level, with which the others are compared, has no errors."""
    errors = ["", "", "", ""]
    if level["psnr_db"] is not None:
        errors = [
            f"{1e3 * level['mean_m']:.2g} mm",
            f"{1e3 * level['p99_m']:.2g} mm",
            f"{level['off_share']:.2%}",
            f"{level['psnr_db']:.1f} dB",
        ]
    times = (f"{level['build_s']:.1f} s", f"{level['frame_s']:.3f} s")
    return f"{level['triangles']:,}", *errors, *times


def _maps(found: Sequence[Any]) -> str:
    """One row per room and size of the light map."""
    rows = []
    for room, sizes in found[0]["maps"].items():
        for one in sizes:
            rows.append(
                (
                    room,
                    one["size"],
                    f"{one['bake_s']:.0f} s",
                    _shown(one["psnr_db"], ".1f", " dB"),
                    _shown(one["median_of_255"], ".2f", " of 255"),
                    f"{one['frame_s']:.3f} s",
                )
            )
    header = "room | map | bake | PSNR against the largest | median | frame, 320 x 240"
    return table(header, rows)


def _unseen(found: Sequence[Any]) -> str:
    rows = []
    for one in found[0]["unseen"]:
        shares = [one["triangles"], one["surface"], one["texels"]]
        rows.append((one["room"], one["poses"], *(_shown(share, ".1%") for share in shares)))
    header = "room | poses | triangles never seen | surface never seen | texels in use never seen"
    return table(header, rows)


def _systems(found: Sequence[Any]) -> str:
    """ATE in mm, one row per sequence; with the share of frames that have a pose, if some have
    none.
    """
    runs_of = {}
    for one in found[-1]["results"]:
        runs_of[one["sequence"]] = {run["odometer"]: run for run in one["runs"]}
    methods: dict[str, None] = {}
    for runs in runs_of.values():
        methods |= dict.fromkeys(name for name in runs if not name.endswith(" live"))
    rows = []
    for sequence, runs in sorted(runs_of.items()):
        rows.append((_plain(sequence), *(_covered(runs.get(name)) for name in methods)))
    return table(["", *methods], rows)


def _covered(run: dict[str, Any] | None) -> str:
    if run is None:
        return "-"
    share = run["coverage"]
    if share is None or share >= 0.9995:
        return _mm(run)
    return f"{_mm(run)} ({share:.1%})"


def _benchmark(name: str) -> Text:
    """One of the benchmark's tables; only the RMSE of the six statistics of an ATE."""

    def text(found: Sequence[Any]) -> str:
        one = found[-1]["tables"][name]
        columns = one["columns"]
        if columns[1] != "error mm":
            return table(columns, one["rows"])
        rows = [row[:1] + row[2:] for row in one["rows"] if row[1] == "RMSE"]
        return table(columns[:1] + columns[2:], rows)

    return text


def _speed(found: Sequence[Any]) -> str:
    """Median and 95th percentile in ms per frame, and ATE in mm."""
    races = found[0]["results"]
    cells: dict[str, dict[str, str]] = {}
    for race in races:
        for run in race["runs"]:
            cell = f"{run['ms_median']:.1f}, {run['ms_95']:.1f}: {_mm(run)}"
            cells.setdefault(run["odometer"], {})[race["sequence"]] = cell
    sequences = [race["sequence"] for race in races]
    rows = []
    for name, of in cells.items():
        rows.append((f"`{name}`", *(of.get(sequence, "-") for sequence in sequences)))
    return table(["", *sequences], rows)


def _splits(found: Sequence[Any]) -> str:
    """One row for each split of the cores."""
    rows: dict[str, dict[str, tuple[str, str]]] = {}
    for one in found[0]["splits"]:
        split = f"{one['workers']} x {one['threads']}"
        figures = (f"{one['frames_an_hour']:,.0f}", f"{one['busy_share']:.0%}")
        rows.setdefault(split, {})[one["light"]] = figures
    header = (
        "workers x threads | baked, frames an hour | cores busy"
        " | path traced, frames an hour | cores busy"
    )
    none = ("", "")
    return table(
        header,
        [(split, *of.get("baked", none), *of.get("path", none)) for split, of in rows.items()],
    )


def _chaos(found: Sequence[Any]) -> str:
    rows = []
    for name, damage in found[0].items():
        events = [damage["events"].get(kind, "") for kind in ("full", "stop")]
        lost = [damage[key] for key in ("broken", "lost", "twice")]
        rows.append((name, damage["frames"], damage["kills"], *events, *lost))
    header = (
        " | frames | kill -9 | full disk | stopped worker | frames broken | frames lost"
        " | finished twice"
    )
    return table(header, rows)


def _pairs(found: Sequence[Any]) -> str:
    rows = []
    for pair in found[0]["pairs"]:
        rows.append(
            (
                f"{pair['depth']} + {pair['rgb']}",
                f"{pair['frames_per_s']:.0f}",
                f"{pair['ratio']:.2f}",
                f"{pair['cpu_ms']:.0f}",
                f"{pair['cpu_ratio']:.2f}",
            )
        )
    header = "depth + RGB | frames/s | over files alone | processor ms a frame | over files alone"
    return table(header, rows)


def _models(found: Sequence[Any]) -> str:
    overlaps = found[0]["overlap_with_official"] or {}
    rows = []
    for kind, times_ms in found[0]["model_ms"].items():
        for name, ms in times_ms.items():
            overlap = overlaps.get(kind, {}).get(name)
            rows.append((f"{kind} `{name}`", f"{ms:.1f}", _shown(overlap, ".3f")))
    return table("model | ms a frame, one core | overlap with the official noise", rows)


def _surface(titles: Iterable[str]) -> Text:
    """One row per surface, from the output of `fuse` and `evaluate surface` alternately."""

    def text(found: Sequence[Any]) -> str:
        rows = []
        for title, made, error in zip(titles, found[::2], found[1::2], strict=True):
            distance_m = error["distance_m"]
            statistics = [distance_m[key] for key in ("mean", "median", "std", "min", "max")]
            distances = [f"{1e3 * value:.3g}" for value in statistics]
            rows.append((title, *distances, f"{made['memory_mb']:.0f} MB", made["parts_that_left"]))
        header = "kt2, ours | mean | median | std | min | max | memory | parts that left the window"
        return table(header, rows)

    return text


def _references(found: Sequence[Any]) -> str:
    """ATE in mm of the odometers with their default reference and with the model."""
    default, model = ({run["odometer"]: _mm(run) for run in one["runs"]} for one in found)
    rows = [(f"`{name}`", default[name], model[name]) for name in default]
    return table(["", "default reference", "model"], rows)


def _offsets(odometers: Sequence[str], sequences: Sequence[str]) -> Text:
    """ATE in mm, from the runs of each odometer on one sequence after the other."""

    def text(found: Sequence[Any]) -> str:
        values = [_mm(one["runs"][0]) for one in found]
        rows = []
        for k, name in enumerate(odometers):
            rows.append((f"`{name}`", *values[k :: len(odometers)]))
        return table(["noisy", *map(_plain, sequences)], rows)

    return text


def _by_method(found: Sequence[Any]) -> dict[str, dict[tuple[str, int], Any]]:
    """The groups of `stress --json` by method, then by perturbation and severity."""
    groups: dict[str, dict[tuple[str, int], Any]] = {}
    for cell in found[0]["cells"]:
        groups.setdefault(cell["method"], {})[cell["perturbation"], cell["severity"]] = cell
    ranks = {name: n for n, name in enumerate(names())}  # systems come last
    return dict(sorted(groups.items(), key=lambda item: ranks.get(item[0], len(ranks))))


def _stress_fails(found: Sequence[Any]) -> str:
    """The lowest severity at which at least half of the segments fail."""
    groups = _by_method(found)
    measured = {cell["perturbation"] for cell in found[0]["cells"] if cell["severity"]}
    rows = []
    for name in read_plan().perturbations:
        if name in measured:
            failing = [_fails_from(cells, name) for cells in groups.values()]
            rows.append((f"`{name}`", *failing))
    return table(["fails from severity", *map(_short, groups)], rows)


def _fails_from(cells: dict[tuple[str, int], Any], perturbation: str) -> object:
    for (name, severity), cell in sorted(cells.items()):
        if name == perturbation and cell["succeeded"] <= 0.5:
            return severity
    return "-"


def _stress_totals(found: Sequence[Any]) -> str:
    """Means over all perturbed cells; the last rows are of the unperturbed frames."""
    groups = _by_method(found)
    clean = [cells["clean", 0] for cells in groups.values()]
    shares = (
        ("segments that succeed", "succeeded"),
        ("frames: wrong poses reported as good", "false_successes"),
        ("frames: right poses reported as bad", "false_alarms"),
    )
    rows: list[list[str]] = []
    for title, key in shares:
        rows.append([title])
        for cells in groups.values():
            perturbed = [cell[key] for (_, severity), cell in cells.items() if severity]
            rows[-1].append(f"{mean(perturbed):.1%}")
    rows.append(["unperturbed: ATE, mm", *(f"{1e3 * cell['ate_m']:.2g}" for cell in clean)])
    rows.append(["unperturbed: NEES", *(_shown(cell["nees"], ".2f") for cell in clean)])
    return table(["", *map(_short, groups)], rows)


def _short(method: str) -> str:
    """The name of a method of `iclnuim stress` in a table."""
    return _TITLES.get(method, method.removeprefix("baseline:"))


def _curve(default: float) -> Text:
    """Error and time of each step divided by those of the default step; geometric means over the
    sequences.
    """

    def text(found: Sequence[Any]) -> str:
        # method -> sequence -> step; a method without the setting has one point, without a value
        steps: dict[str, dict[str, dict[float, Any]]] = {}
        values: dict[float, None] = {}
        for point in found[0]["points"]:
            if point["value"] is not None:
                values[point["value"]] = None
                of_method = steps.setdefault(point["method"], {})
                of_method.setdefault(point["sequence"], {})[point["value"]] = point
        rows = []
        for value in values:
            cells = [_step(of_method, value, default) for of_method in steps.values()]
            rows.append((f"{value:g}", *cells))
        return table(["", *map(_short, steps)], rows)

    return text


def _step(of_method: dict[str, dict[float, Any]], value: float, default: float) -> str:
    """A cell of the table of a curve, from the steps of one method on each sequence."""
    points = [of[value] for of in of_method.values() if value in of]
    bases = [of[default] for of in of_method.values() if value in of]
    if not points:
        return "-"
    if lost := sum(p["ate_m"] is None or 2 * p["tracked"] < p["processed"] for p in points):
        return f"fails on {lost}"
    error = _ratio(points, bases, "ate_m")
    time = _ratio(points, bases, "ms")
    text = f"{error:.2f}, {time:.2f}"
    share = mean(p["processed"] / p["frames"] for p in points)
    if share > 0.995:
        return text
    return f"{text} ({share:.0%})"


def _ratio(points: Sequence[Any], bases: Sequence[Any], key: str) -> float:
    return geometric_mean(p[key] / base[key] for p, base in zip(points, bases, strict=True))


def _voxels(found: Sequence[Any]) -> str:
    rows = []
    for point in found[0]["points"]:
        lengths_m = [point[key] for key in ("voxel_m", "mean_m", "p95_m")]
        lengths = [f"{1e3 * length_m:.3g} mm" for length_m in lengths_m]
        rows.append(
            (point["sequence"], *lengths, f"{point['ms']:.0f}", f"{point['memory_mb']:.0f}")
        )
    return table(["", "voxel", "mean distance", "95 %", "ms per frame", "MB"], rows)


def _detail_odometry(found: Sequence[Any]) -> str:
    """ATE in mm by level, and the range between seeds at level 1 divided by its median."""
    changes = found[0]["changes"]
    rows = []
    for change in changes:
        sequence = f"{change['sequence'].replace('_', ' ')} {change['kind']}"
        errors = [_shown(ate_m, ".3g", factor=1e3) or "-" for ate_m in change["ate_m"]]
        spread = _shown(change["spread"], ".0%")
        rows.append((sequence, f"`{change['method']}`", *errors, spread))
    steps = [f"{level:g}" for level in changes[0]["levels"]]
    return table(["", "", *steps, "between seeds"], rows)


def _detail_surface(found: Sequence[Any]) -> str:
    rows = []
    for build in found[0]["builds"]:
        if build["seed"] == 0:
            rows.append(
                (
                    build["sequence"].replace("_", " "),
                    f"{build['detail']:g}",
                    f"{build['triangles']:,}",
                    f"{1e3 * build['surface_m']:.3f} mm",
                )
            )
    return table(["", "detail", "triangles", "mean distance of the fused surface"], rows)


def _plotted(command: str, picture: str) -> str:
    return f"{command} --plot {_PICTURES}/{picture}"


def _surface_commands() -> Iterator[str]:
    for k, (_, kind, options) in enumerate(_SURFACES):
        mesh = f"out/measured-{k}.ply"
        poses = f"{_KT2}/clean/groundtruth.txt"
        fuse = " ".join(f"fuse {_KT2}/{kind} --poses {poses} {options} -o {mesh}".split())
        evaluate = f"evaluate surface {mesh} --model living_room"
        if k == 0:
            fuse = f"{fuse} --plot docs/pictures/surface.jpg"
            evaluate = _plotted(evaluate, "surface_error.png")
        yield fuse
        yield evaluate


def _light_page() -> Iterator[Measured]:
    render = _plotted("bench render kt2", "light.png")
    yield Measured("light", "light", (render,), _light)
    textures = _plotted("bench textures kt2 office/kt0", "textures.png")
    yield Measured("light", "textures", (textures,), _textures)


def _detail_page() -> Iterator[Measured]:
    detail = (_plotted(_DETAIL, "detail.png"),)
    yield Measured("detail", "detail-living-room", detail, _levels("living_room"))
    yield Measured("detail", "detail-office", detail, _levels("office"))
    yield Measured("detail", "detail-unseen", detail, _unseen)
    yield Measured("detail", "detail-maps", detail, _maps)
    odometry = (_plotted(_DETAIL_ODOMETRY, "detail_odometry.png"),)
    yield Measured("detail", "detail-odometry", odometry, _detail_odometry)
    yield Measured("detail", "detail-surface", odometry, _detail_surface)


def _odometry_page() -> Iterator[Measured]:
    three = f"../shared/data/iclnuim/or_kt0 {_KT2}/clean {_KT2}/noisy"
    speed = _plotted(f"bench odometry {three} --first 120", "odometry.png")
    yield Measured("odometry", "odometry-speed", (speed,), _speed)
    runs = [f"run {system} {_SIXTEEN}" for system in _SYSTEMS]
    ours = f"bench odometry {_SIXTEEN} out/systems/results.json --only ours"
    commands = (*runs, _plotted(ours, "systems.png"))
    yield Measured("odometry", "odometry-ate", commands, _systems)
    offsets = []
    for place in _NOISY:
        offsets += [f"odometry {name} {place} --depth-offset 0.00155" for name in _BIASED]
    titles = [sequence.removeprefix("living_room/") for sequence in _SEQUENCES]
    text = _offsets(_BIASED, titles)
    yield Measured("odometry", "odometry-bias", tuple(offsets), text)


def _farm_page() -> Iterator[Measured]:
    farm = _plotted("bench farm kt2", "farm.png")
    yield Measured("farm", "farm-splits", (farm,), _splits)
    chaos = _plotted("bench chaos kt2 --camera 160x120", "chaos.png")
    yield Measured("farm", "farm-chaos", (chaos,), _chaos)


def _sensor_page() -> Iterator[Measured]:
    noise = (_plotted(_NOISE, "noise.png"),)
    yield Measured("sensor", "noise-pairs", noise, _pairs)
    yield Measured("sensor", "noise-models", noise, _models)


def _surface_page() -> Iterator[Measured]:
    text = _surface([title for title, _, _ in _SURFACES])
    yield Measured("surface", "surface-error", tuple(_surface_commands()), text)
    references = []
    for to in ("default", "model"):
        references.append(f"odometry --all {_KT2}/clean --reference {to} -o out/measured-{to}")
    yield Measured("surface", "surface-model", tuple(references), _references)


def _stress_page() -> Iterator[Measured]:
    stress = (_plotted(_STRESS, "stress.png"),)
    data = Path("out/stress/stress.csv")
    yield Measured("stress", "stress-fails", stress, _stress_fails, data)
    yield Measured("stress", "stress-totals", stress, _stress_totals)


def _curves_page() -> Iterator[Measured]:
    for curve, (sequences, frames, default) in _CURVES.items():
        options = f"--method all --start 80 --first {frames}"
        command = _plotted(f"bench curve {curve} {sequences} {options}", f"curve_{curve}.png")
        yield Measured("curves", f"curve-{curve}", (command,), _curve(default))
    voxel = f"bench curve voxel {_KT2}/clean {_KT2}/noisy --start 80 --first 240"
    command = _plotted(voxel, "curve_voxel.png")
    yield Measured("curves", "curve-voxel", (command,), _voxels)


def _benchmark_page() -> Iterator[Measured]:
    numbered = [f"table_{n}" for n in range(2, 8)]
    for name in (*numbered, "table_2_office", "table_7_office", "findings", "correlation"):
        mark = f"benchmark-{name.replace('_', '-')}"
        yield Measured("benchmark", mark, ("benchmark",), _benchmark(name))


MEASURED = (
    *_light_page(),
    *_detail_page(),
    *_odometry_page(),
    *_farm_page(),
    *_sensor_page(),
    *_surface_page(),
    *_stress_page(),
    *_curves_page(),
    *_benchmark_page(),
)


def replaced(page: str, measured: Measured, text: str) -> str:
    """The page with another text between the marks.

    Raises ValueError unless each mark is in it exactly once, in this order.
    """
    before, begin, rest = page.partition(measured.begin)
    _, end, after = rest.partition(measured.end)
    if not (begin and end) or measured.begin in after or measured.end in before + after:
        marks = f"{measured.begin.strip()} and then {measured.end.strip()}"
        raise ValueError(f"{measured.page}: expected {marks}, each once")
    return before + begin + text + end + after


def output_of(command: str, keep: Path | None, programs: Sequence[str] = ()) -> Any:
    """The output of the command with --json: stored output if there is any, else measured now.
    programs: SYSTEM=PATH each.
    """
    kept = None
    if keep:
        kept = keep / f"{re.sub('[^A-Za-z0-9]+', '_', command)[:150]}.json"
    if kept and kept.is_file():
        return json.loads(kept.read_text())
    print(f"iclnuim {command} --json", file=sys.stderr, flush=True)
    words = [
        sys.executable,
        "-m",
        "iclnuim",
        *shlex.split(command),
        *_program_options(command, programs),
        "--json",
    ]
    done = subprocess.run(words, cwd=TOP, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"measured: iclnuim {command.split()[0]} ended with exit code {done.returncode}")
    if kept:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(done.stdout)
    return json.loads(done.stdout)


def _program_options(command: str, programs: Sequence[str]) -> list[str]:
    """The options that name the programs of a command's systems."""
    words, options = command.split(), []
    for system, _, program in (one.partition("=") for one in programs):
        if words[:2] == ["run", system]:
            options += ["--program", program]
        elif words[0] == "stress" and system in words:
            options += ["--set", f"{system}.program={program}"]
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    help = "show pages, marks and commands; measure nothing"
    parser.add_argument("--list", action="store_true", help=help)
    help = "only tables whose page or mark begins with TEXT"
    parser.add_argument("--only", metavar="TEXT", default="", help=help)
    help = "store the output of the commands in FOLDER; a stored one is not run again"
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help=help)
    help = "the program of a system that is not found on PATH; may be given several times"
    parser.add_argument("--program", metavar="SYSTEM=PATH", action="append", default=[], help=help)
    args = parser.parse_args(arguments)
    chosen = [m for m in MEASURED if m.mark.startswith(args.only) or m.page.startswith(args.only)]
    if not chosen:
        parser.error(f"--only: no page or mark begins with {args.only}")
    outputs: dict[str, Any] = {}
    for measured in chosen:
        if args.list:
            print(
                f"{measured.page} {measured.mark}",
                *(f"    iclnuim {c}" for c in measured.commands),
                sep="\n",
            )
            continue
        for command in measured.commands:
            if command not in outputs:
                outputs[command] = output_of(command, args.keep, args.program)
        page = TOP / measured.page
        text = measured.text([outputs[command] for command in measured.commands])
        page.write_text(replaced(page.read_text(), measured, text))
        if measured.data:
            shutil.copy(TOP / measured.data, page.parent)
        print(f"{measured.page}: {measured.mark}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
