"""Regenerates the measured tables and charts of the pages, each with the command that is listed
here.

    python tools/measured.py --list                    pages, marks, commands
    python tools/measured.py --only light              one mark, or those of a page: docs/measured/odometry
    python tools/measured.py --only farm --keep out/measured    also store the output of the
    commands; stored output is not measured again python tools/measured.py --only docs/measured/odometry
    --program orbslam3=/opt/orb/bin/python    a system that is not found on PATH

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
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import geometric_mean
from typing import Any

from iclnuim.benchmark.odometry.registry import names
from iclnuim.benchmark.perturbations.plan import read_plan

TOP = Path(__file__).resolve().parents[1]
_KT2 = "out/living_room/kt2"
_SIXTEEN = [
    f"out/{room}/kt{k}/{kind}"
    for room in ("living_room", "office")
    for k in range(4)
    for kind in ("clean", "noisy")
]
_SYSTEMS = ("orbslam3 --runs 3 --vocabulary ORBvoc.txt", "rtabmap", "fovis", "dvo")
_NOISY = [place for place in _SIXTEEN if place.endswith("/noisy")]
_BIASED = ("icp", "rgbd", "icp_rgbd")
_DETAIL = "bench detail --lit none --maps 512,1024,2048 --every 60 --plot docs/measured/pictures/detail.png"
_STRESS_METHODS = "".join(
    f" --methods {name}"
    for name in ("fovis", "rgbd", "dvo", "icp", "icp_rgbd", "opencv", "plane", "intensity")
)
_STRESS = (
    f"stress {_KT2}/clean out/office/kt1/clean --starts 1 --system fovis --system dvo --system orbslam3"
    f" --set orbslam3.vocabulary=ORBvoc.txt --runs 3{_STRESS_METHODS} --plot docs/measured/pictures/stress.png"
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
_DETAIL_ODOMETRY = "bench detail-odometry --levels 0.5,0.7,1,1.4 --first 120 --plot docs/measured/pictures/detail_odometry.png"
_FARM = "bench farm kt2 --plot docs/measured/pictures/farm.png"
_NOISE = f"bench noise {_KT2}/raw --frames :120 --official ../shared/data/iclnuim/or_kt3 --plot docs/measured/pictures/noise.png"
_SURFACES = {
    "clean, `best`": ("clean", ""),
    "clean, `--preset paper`": ("clean", "--preset paper"),
    "noisy (`released`), `best --min-weight 3`": ("noisy", "--min-weight 3"),
}


@dataclass(frozen=True)
class Measured:
    """One table: its mark in a page, the commands (words after `iclnuim`; --json is added), and the
    function that makes the text from their output.
    """

    page: str
    mark: str
    commands: tuple[str, ...]
    text: Callable[[Sequence[Any]], str]
    #: A file of the commands' output that is published next to the page.
    data: Path | None = None

    @property
    def begin(self) -> str:
        return f"<!-- measured: {self.mark} -->\n"

    @property
    def end(self) -> str:
        return f"<!-- end of {self.mark} -->\n"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    return "".join(
        f"| {' | '.join(map(str, row))} |\n" for row in (header, ["---"] * len(header), *rows)
    )


def _light(found: Sequence[Any]) -> str:
    header = (
        "light",
        "samples",
        "s/frame",
        "PSNR dB",
        "worst view",
        "median error",
        "median change from frame to frame (of 255)",
    )
    rows = []
    for one in found[0]["methods"]:
        psnr_db = one["error"]["psnr_db"]
        name = (one["method"]["family"], one["method"]["label"], f"{one['seconds']:.3g}")
        errors = (
            f"{sum(psnr_db) / len(psnr_db):.1f}",
            f"{min(psnr_db):.1f}",
            f"{one['error']['median']:.4f}",
        )
        rows.append((*name, *errors, f"{255 * one['flicker']:.2f}"))
    return table(header, rows)


def _textures(found: Sequence[Any]) -> str:
    header = (
        "sequence",
        "textures",
        "median change",
        "mean change",
        "mean difference from 16 rays a pixel",
    )
    rows = []
    for r in found[0]["rows"]:
        differences = (r["change_median"], r["change_mean"], r["difference"])
        name = (r["sequence"].replace("_", " ").replace("/", " "), r["textures"])
        rows.append((*name, *("" if d is None else f"{255 * d:.2f}" for d in differences)))
    return table(header, rows)


def _levels(room: str) -> Callable[[Sequence[Any]], str]:
    def text(found: Sequence[Any]) -> str:
        header = (
            "detail",
            "triangles",
            "mean depth error",
            "99 %",
            "off by more than 5 mm",
            "colour, PSNR",
            "build",
            "frame",
        )
        rows, knee = [], found[0]["knee"][room]
        for v in found[0]["levels"][room]:
            level = f"{v['detail']:g}" + (", the knee" if v["detail"] == knee else "")
            name = (f"**{level}**" if v["detail"] == 1 else level, f"{v['triangles']:,}")
            times = (f"{v['build_s']:.1f} s", f"{v['frame_s']:.3f} s")
            if v["psnr_db"] is None:  # the finest level, with which the others are compared
                rows.append((*name, "", "", "", "", *times))
                continue
            depth = (
                f"{1e3 * v['mean_m']:.2g} mm",
                f"{1e3 * v['p99_m']:.2g} mm",
                f"{v['off_share']:.2%}",
            )
            rows.append((*name, *depth, f"{v['psnr_db']:.1f} dB", *times))
        return table(header, rows)

    return text


def _maps(found: Sequence[Any]) -> str:
    """One row per room and size of the light map."""
    rows = []
    for room, sizes in found[0]["maps"].items():
        for m in sizes:
            error = (
                ("", "")
                if m["psnr_db"] is None
                else (f"{m['psnr_db']:.1f} dB", f"{m['median_of_255']:.2f} of 255")
            )
            rows.append((room, m["size"], f"{m['bake_s']:.0f} s", *error, f"{m['frame_s']:.3f} s"))
    return table(
        ("room", "map", "bake", "PSNR against the largest", "median", "frame, 320 x 240"), rows
    )


def _unseen(found: Sequence[Any]) -> str:
    rows = []
    for u in found[0]["unseen"]:
        texels = "" if u["texels"] is None else f"{u['texels']:.1%}"
        rows.append((u["room"], u["poses"], f"{u['triangles']:.1%}", f"{u['surface']:.1%}", texels))
    return table(
        ("room", "poses", "triangles never seen", "surface never seen", "texels in use never seen"),
        rows,
    )


def _systems(found: Sequence[Any]) -> str:
    """ATE in mm, one row per sequence; with the share of frames that have a pose, if some have
    none.
    """
    runs_of = {
        one["sequence"]: {run["odometer"]: run for run in one["runs"]} for one in found[-1]["races"]
    }
    names = [
        n
        for n in dict.fromkeys(n for runs in runs_of.values() for n in runs)
        if not n.endswith(" live")
    ]

    def cell(run: dict | None) -> str:
        if run is None:
            return "-"
        share = run["coverage"]
        return _mm(run) + ("" if share is None or share >= 0.9995 else f" ({share:.1%})")

    rows = [
        (sequence.replace("_", " ").replace("/", " "), *(cell(runs.get(name)) for name in names))
        for sequence, runs in sorted(runs_of.items())
    ]
    return table(("", *names), rows)


def _benchmark(name: str) -> Callable[[Sequence[Any]], str]:
    """One of the benchmark's tables; only the RMSE of the six statistics of an ATE."""

    def text(found: Sequence[Any]) -> str:
        one = found[-1]["tables"][name]
        columns, rows = one["columns"], one["rows"]
        if columns[1] == "error mm":
            columns, *rows = (
                row[:1] + row[2:] for row in (columns, *(row for row in rows if row[1] == "RMSE"))
            )
        return table(columns, rows)

    return text


def _speed(found: Sequence[Any]) -> str:
    """Median and 95th percentile in ms per frame, and ATE in mm."""
    return _odometers(found, lambda r: f"{r['ms_median']:.1f}, {r['ms_95']:.1f}: {_mm(r)}")


def _odometers(found: Sequence[Any], cell: Callable[[dict], str]) -> str:
    sequences = found[0]["races"]
    names = list(
        dict.fromkeys(run["odometer"] for sequence in sequences for run in sequence["runs"])
    )
    cells = [{run["odometer"]: cell(run) for run in sequence["runs"]} for sequence in sequences]
    rows = [(f"`{name}`", *(column.get(name, "-") for column in cells)) for name in names]
    return table(("", *(sequence["sequence"] for sequence in sequences)), rows)


def _mm(run: dict) -> str:
    ate_m = run["ate_rmse_m"]
    return "-" if ate_m is None else f"{1e3 * ate_m:.{3 if ate_m < 1 else 4}g}"


def _splits(found: Sequence[Any]) -> str:
    lights: dict[str, dict[str, tuple[str, str]]] = {}
    for s in found[0]["splits"]:
        split = f"{s['workers']} x {s['threads']}"
        lights.setdefault(split, {})[s["light"]] = (
            f"{s['frames_an_hour']:,.0f}",
            f"{s['busy_share']:.0%}",
        )
    rows = [
        (split, *by.get("baked", ("", "")), *by.get("path", ("", "")))
        for split, by in lights.items()
    ]
    header = (
        "workers x threads",
        "baked, frames an hour",
        "cores busy",
        "path traced, frames an hour",
        "cores busy",
    )
    return table(header, rows)


def _chaos(found: Sequence[Any]) -> str:
    header = (
        "",
        "frames",
        "kill -9",
        "full disk",
        "stopped worker",
        "frames broken",
        "frames lost",
        "finished twice",
    )
    rows = []
    for name, damage in found[0].items():
        events = (damage["events"].get(kind, "") for kind in ("full", "stop"))
        rows.append(
            (
                name,
                damage["frames"],
                damage["kills"],
                *events,
                damage["broken"],
                damage["lost"],
                damage["twice"],
            )
        )
    return table(header, rows)


def _pairs(found: Sequence[Any]) -> str:
    rows = [
        (
            f"{p['depth']} + {p['rgb']}",
            f"{p['frames_per_s']:.0f}",
            f"{p['ratio']:.2f}",
            f"{p['cpu_ms']:.0f}",
            f"{p['cpu_ratio']:.2f}",
        )
        for p in found[0]["pairs"]
    ]
    return table(
        ("depth + RGB", "frames/s", "over files alone", "processor ms a frame", "over files alone"),
        rows,
    )


def _models(found: Sequence[Any]) -> str:
    overlaps, rows = found[0]["overlap_with_official"] or {}, []
    for kind, times_ms in found[0]["model_ms"].items():
        for name, ms in times_ms.items():
            overlap = overlaps.get(kind, {}).get(name)
            rows.append(
                (f"{kind} `{name}`", f"{ms:.1f}", "" if overlap is None else f"{overlap:.3f}")
            )
    return table(("model", "ms a frame, one core", "overlap with the official noise"), rows)


def _surface(found: Sequence[Any]) -> str:
    """One row per surface, from the output of `fuse` and `evaluate surface` alternately."""
    rows = []
    for name, made, error in zip(_SURFACES, found[::2], found[1::2], strict=True):
        distances = [
            f"{1e3 * error['distance_m'][key]:.3g}"
            for key in ("mean", "median", "std", "min", "max")
        ]
        rows.append((name, *distances, f"{made['memory_mb']:.0f} MB", made["parts_that_left"]))
    header = (
        "kt2, ours",
        "mean",
        "median",
        "std",
        "min",
        "max",
        "memory",
        "parts that left the window",
    )
    return table(header, rows)


def _references(found: Sequence[Any]) -> str:
    """ATE in mm of the odometers with their default reference and with the model."""
    own, model = ({run["odometer"]: _mm(run) for run in one["runs"]} for one in found)
    return table(
        ("", "default reference", "model"), [(f"`{name}`", own[name], model[name]) for name in own]
    )


def _offsets(found: Sequence[Any]) -> str:
    """ATE in mm, one row for each of _BIASED, one column for each of _NOISY."""
    values = [_mm(one["runs"][0]) for one in found]
    rows = [(f"`{name}`", *values[k :: len(_BIASED)]) for k, name in enumerate(_BIASED)]
    names = [
        place.removeprefix("out/").removeprefix("living_room/").removesuffix("/noisy")
        for place in _NOISY
    ]
    return table(("noisy", *(name.replace("/", " ") for name in names)), rows)


def _surface_commands() -> tuple[str, ...]:
    commands = []
    for k, (kind, options) in enumerate(_SURFACES.values()):
        mesh = f"out/measured-{k}.ply"
        fuse = f"fuse {_KT2}/{kind} --poses {_KT2}/clean/groundtruth.txt {options} -o {mesh}"
        fuse, evaluate = " ".join(fuse.split()), f"evaluate surface {mesh} --model living_room"
        if k == 0:
            fuse += " --plot docs/pictures/surface.jpg"
            evaluate += " --plot docs/measured/pictures/surface_error.png"
        commands += [fuse, evaluate]
    return tuple(commands)


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
    measured = {p for cells in groups.values() for p, severity in cells if severity}
    names = [name for name in read_plan().perturbations if name in measured]

    def first(cells: dict[tuple[str, int], Any], name: str) -> object:
        failed = (
            k for (p, k), cell in sorted(cells.items()) if p == name and cell["succeeded"] <= 0.5
        )
        return next(failed, "-")

    rows = [(f"`{name}`", *(first(cells, name) for cells in groups.values())) for name in names]
    return table(("fails from severity", *map(_short, groups)), rows)


def _stress_totals(found: Sequence[Any]) -> str:
    """Means over all perturbed cells; the last rows are of the unperturbed frames."""
    groups = _by_method(found)
    perturbed = [[cell for (_, k), cell in cells.items() if k] for cells in groups.values()]
    clean = [cells["clean", 0] for cells in groups.values()]
    rows: list[tuple[object, ...]] = [
        (title, *(f"{sum(cell[key] for cell in cells) / len(cells):.1%}" for cells in perturbed))
        for title, key in (
            ("segments that succeed", "succeeded"),
            ("frames: wrong poses reported as good", "false_successes"),
            ("frames: right poses reported as bad", "false_alarms"),
        )
    ]
    rows.append(("unperturbed: ATE, mm", *(f"{1e3 * cell['ate_m']:.2g}" for cell in clean)))
    rows.append(
        (
            "unperturbed: NEES",
            *("" if cell["nees"] is None else f"{cell['nees']:.2f}" for cell in clean),
        )
    )
    return table(("", *map(_short, groups)), rows)


def _short(method: str) -> str:
    """The name of a method of `iclnuim stress` in a table."""
    return {"run:fovis": "FOVIS", "run:dvo": "DVO", "run:orbslam3": "ORB-SLAM3"}.get(
        method, method.removeprefix("baseline:")
    )


def _curve_command(curve: str, sequences: str, frames: int, method: str = "--method all") -> str:
    options = (
        f"{method} --start 80 --first {frames} --plot docs/measured/pictures/curve_{curve}.png"
    )
    return f"bench curve {curve} {sequences} {options.strip()}"


def _curve(default: float) -> Callable[[Sequence[Any]], str]:
    """Error and time of each step divided by those of the default step; geometric means over the
    sequences.
    """

    def text(found: Sequence[Any]) -> str:
        points = found[0]["points"]
        steps = {
            (p["method"], p["sequence"], p["value"]): p for p in points if p["value"] is not None
        }
        names, values = (dict.fromkeys(key[k] for key in steps) for k in (0, 2))
        sequences = dict.fromkeys(key[1] for key in steps)

        def cell(name: str, value: float) -> str:
            pairs = [(steps.get((name, s, value)), steps[name, s, default]) for s in sequences]
            found = [(one, base) for one, base in pairs if one is not None]
            if not found:
                return "-"
            if lost := sum(
                one["ate_m"] is None or 2 * one["tracked"] < one["processed"] for one, _ in found
            ):
                return f"fails on {lost}"
            error, time = (
                geometric_mean([one[key] / base[key] for one, base in found])
                for key in ("ate_m", "ms")
            )
            share = sum(one["processed"] / one["frames"] for one, _ in found) / len(found)
            return f"{error:.2f}, {time:.2f}" + ("" if share > 0.995 else f" ({share:.0%})")

        return table(
            ("", *map(_short, names)),
            [(f"{value:g}", *(cell(n, value) for n in names)) for value in values],
        )

    return text


def _voxels(found: Sequence[Any]) -> str:
    rows = [
        (
            p["sequence"], f"{1e3 * p['voxel_m']:.3g} mm", f"{1e3 * p['mean_m']:.3g} mm", f"{1e3 * p['p95_m']:.3g} mm",
            f"{p['ms']:.0f}", f"{p['memory_mb']:.0f}",
        )
        for p in found[0]["points"]
    ]  # fmt: skip
    return table(("", "voxel", "mean distance", "95 %", "ms per frame", "MB"), rows)


def _detail_odometry(found: Sequence[Any]) -> str:
    """ATE in mm by level, and the range between seeds at level 1 divided by its median."""
    changes = found[0]["changes"]
    rows = []
    for row in changes:
        errors = ("-" if m is None else f"{1e3 * m:.3g}" for m in row["ate_m"])
        spread = "" if row["spread"] is None else f"{row['spread']:.0%}"
        rows.append(
            (
                f"{row['sequence'].replace('_', ' ')} {row['kind']}",
                f"`{row['method']}`",
                *errors,
                spread,
            )
        )
    levels = [f"{d:g}" for d in changes[0]["levels"]]
    return table(("", "", *levels, "between seeds"), rows)


def _detail_surface(found: Sequence[Any]) -> str:
    builds = [b for b in found[0]["builds"] if b["seed"] == 0]
    rows = [
        (
            b["sequence"].replace("_", " "),
            f"{b['detail']:g}",
            f"{b['triangles']:,}",
            f"{1e3 * b['surface_m']:.3f} mm",
        )
        for b in builds
    ]
    return table(("", "detail", "triangles", "mean distance of the fused surface"), rows)


_BENCHMARK = (
    *(f"table_{n}" for n in range(2, 8)),
    "table_2_office",
    "table_7_office",
    "findings",
    "correlation",
)

MEASURED = (
    Measured(
        "docs/measured/light.md",
        "light",
        ("bench render kt2 --plot docs/measured/pictures/light.png",),
        _light,
    ),
    Measured(
        "docs/measured/light.md",
        "textures",
        ("bench textures kt2 office/kt0 --plot docs/measured/pictures/textures.png",),
        _textures,
    ),
    Measured("docs/measured/detail.md", "detail-living-room", (_DETAIL,), _levels("living_room")),
    Measured("docs/measured/detail.md", "detail-office", (_DETAIL,), _levels("office")),
    Measured("docs/measured/detail.md", "detail-unseen", (_DETAIL,), _unseen),
    Measured("docs/measured/detail.md", "detail-maps", (_DETAIL,), _maps),
    Measured(
        "docs/measured/odometry.md",
        "odometry-speed",
        (
            f"bench odometry ../shared/data/iclnuim/or_kt0 {_KT2}/clean {_KT2}/noisy --first 120 --plot docs/measured/pictures/odometry.png",
        ),
        _speed,
    ),
    Measured(
        "docs/measured/odometry.md",
        "odometry-ate",
        (
            *(f"run {system} {' '.join(_SIXTEEN)}" for system in _SYSTEMS),
            f"bench odometry {' '.join(_SIXTEEN)} out/systems/results.json --only ours --plot docs/measured/pictures/systems.png",
        ),
        _systems,
    ),
    Measured("docs/measured/farm.md", "farm-splits", (_FARM,), _splits),
    Measured(
        "docs/measured/farm.md",
        "farm-chaos",
        ("bench chaos kt2 --camera 160x120 --plot docs/measured/pictures/chaos.png",),
        _chaos,
    ),
    Measured("docs/measured/sensor.md", "noise-pairs", (_NOISE,), _pairs),
    Measured("docs/measured/sensor.md", "noise-models", (_NOISE,), _models),
    Measured("docs/measured/surface.md", "surface-error", _surface_commands(), _surface),
    Measured(
        "docs/measured/surface.md",
        "surface-model",
        tuple(
            f"odometry --all {_KT2}/clean --reference {to} -o out/measured-{to}"
            for to in ("default", "model")
        ),
        _references,
    ),
    Measured(
        "docs/measured/odometry.md",
        "odometry-bias",
        tuple(
            f"odometry {name} {place} --depth-offset 0.00155"
            for place in _NOISY
            for name in _BIASED
        ),
        _offsets,
    ),
    Measured(
        "docs/measured/stress.md",
        "stress-fails",
        (_STRESS,),
        _stress_fails,
        Path("out/stress/stress.csv"),
    ),
    Measured("docs/measured/stress.md", "stress-totals", (_STRESS,), _stress_totals),
    *(
        Measured(
            "docs/measured/curves.md",
            f"curve-{curve}",
            (_curve_command(curve, sequences, frames),),
            _curve(default),
        )
        for curve, (sequences, frames, default) in _CURVES.items()
    ),
    Measured(
        "docs/measured/curves.md",
        "curve-voxel",
        (_curve_command("voxel", f"{_KT2}/clean {_KT2}/noisy", 240, ""),),
        _voxels,
    ),
    Measured("docs/measured/detail.md", "detail-odometry", (_DETAIL_ODOMETRY,), _detail_odometry),
    Measured("docs/measured/detail.md", "detail-surface", (_DETAIL_ODOMETRY,), _detail_surface),
    *(
        Measured(
            "docs/measured/benchmark.md",
            f"benchmark-{name.replace('_', '-')}",
            ("benchmark",),
            _benchmark(name),
        )
        for name in _BENCHMARK
    ),
)


def replaced(page: str, measured: Measured, text: str) -> str:
    """The page with another text between the marks.

    Raises ValueError unless each mark is in it exactly once, in this order.
    """
    before, begin, rest = page.partition(measured.begin)
    _, end, after = rest.partition(measured.end)
    if not (begin and end) or measured.begin in after or measured.end in before + after:
        raise ValueError(
            f"{measured.page}: expected {measured.begin.strip()} and then {measured.end.strip()}, each once"
        )
    return before + begin + text + end + after


def output_of(command: str, keep: Path | None, programs: Sequence[str] = ()) -> Any:
    """The output of the command with --json: stored output if there is any, else measured now.
    programs: SYSTEM=PATH each.
    """
    kept = keep / f"{re.sub('[^A-Za-z0-9]+', '_', command)[:150]}.json" if keep else None
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
    parser.add_argument(
        "--list", action="store_true", help="show pages, marks and commands; measure nothing"
    )
    parser.add_argument(
        "--only", metavar="TEXT", default="", help="only tables whose page or mark begins with TEXT"
    )
    help = (
        "store the output of the commands in FOLDER; a command with stored output is not run again"
    )
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help=help)
    help = "the program of a system of `iclnuim run` that is not found on PATH; may be given several times"
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
