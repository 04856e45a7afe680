"""`iclnuim bench detail-odometry`: how a room's level of detail changes the errors of odometers.

A room is built at several levels, and at the default level with several random seeds. Another seed
gives other cloth, wood and plaster of the same detail, so the differences between seeds are those
that detail has to exceed.
"""

import os
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from iclnuim import shipped
from iclnuim.benchmark.odometry.registry import names, odometer
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.formats.files import is_file, make_folder, read_json, write_json
from iclnuim.headless.method_options import installed, require
from iclnuim.headless.options import Actions, action, add_plot, add_span, numbers, whole_numbers
from iclnuim.native_output import native_output_in
from iclnuim.sequences.sequence_poses import read_truth
from iclnuim.version import __version__

from .measured_tables import tables

#: The level that is shipped.
DEFAULT = 1.0
KINDS = ("clean", "noisy")


@dataclass(frozen=True)
class Build:
    """A room at a level of detail with a seed. ate_m: by kind of sequence and method, None if
    lost.
    """

    sequence: str
    detail: float
    seed: int
    ate_m: dict[str, dict[str, float | None]]


def configure(actions: Actions) -> None:
    help = "level of detail of a room against the errors of odometers"
    example = "iclnuim bench detail-odometry kt2 --levels 0.5,1,1.4 --seeds 0,1,2"
    parser = action(actions, "detail-odometry", help, example, _run)
    add = parser.add_argument
    help = "default: kt2 office/kt0"
    add("sequences", nargs="*", default=["kt2", "office/kt0"], metavar="SEQUENCE", help=help)
    help = "levels of detail; default: 0.35,0.5,0.7,1,1.4"
    add("--levels", type=numbers, default=(0.35, 0.5, 0.7, 1.0, 1.4), metavar="D,D", help=help)
    help = "seeds of the room at level 1; default: 0,1,2"
    add("--seeds", type=whole_numbers, default=(0, 1, 2), metavar="N,N", help=help)
    add_span(parser, "these frames (B excluded); default: 80:320", 80, 240)
    add("--map-size", type=int, default=1024, metavar="N", help="light map size; default: 1024")
    add("--map-samples", type=int, default=8, metavar="N", help="light map samples; default: 8")
    help = "an odometer; may be given several times; default: every one that is installed"
    add("--method", action="append", metavar="NAME", help=help)
    add("--camera", metavar="WxH", help="default: 640x480")
    out = {"type": Path, "default": Path("out/detail"), "metavar": "DIR"}
    add("-o", "--out", **out, help="default: out/detail; resumed")
    add_plot(parser)


def _run(args: Namespace, console: Console) -> None:
    require(console, "bench detail-odometry", "numba", "cv2")
    try:
        # before Open3D: both bring a TBB, and that of bpy 5.2 has to be the first
        with native_output_in(Path(os.devnull)):
            import bpy  # noqa: F401
    except ImportError as error:
        raise blender_missing("bench detail-odometry", error) from None
    sequences = [shipped.full_name(name) for name in args.sequences]
    if args.start < 0:
        raise InputError("a first frame of 0 or more", setting="--start", found=args.start)
    if args.first is None:
        raise InputError("frames A:B with an end", setting="--frames", found=f"{args.start}:")
    if not all(0.15 <= d <= 3 for d in args.levels):
        raise InputError("levels within 0.15..3", found=args.levels)
    methods = args.method or installed(names(), "best", console)
    variants: list[tuple[str, float, int]] = []
    for sequence in sequences:
        variants += [(sequence, detail, 0) for detail in sorted({*args.levels, DEFAULT})]
        variants += [(sequence, DEFAULT, seed) for seed in args.seeds]
    variants = list(dict.fromkeys(variants))
    progress = console.progress(len(variants), "bench detail-odometry", "rooms")
    builds = []
    for sequence, detail, seed in variants:
        builds.append(_measured(sequence, detail, seed, methods, args))
        console.note(str(builds[-1]))
        progress.advance()
    if args.plot:
        from iclnuim.report import charts

        charts.save(_figure(builds), args.plot)
    values = {"builds": [asdict(b) for b in builds], "changes": changes(builds)}
    console.result(values, tables(values, "detail-odometry"))


def _measured(
    sequence: str, detail: float, seed: int, methods: Sequence[str], args: Namespace
) -> Build:
    """Build, light and render the room, and run all methods, unless this has been done."""
    room, kt = sequence.split("/")
    folder = args.out.resolve() / room / f"{detail:g}_{seed}" / kt
    settings = {
        "version": __version__,
        "methods": list(methods),
        "frames": [args.start, args.first],
        "light": [args.map_size, args.map_samples],
        "camera": args.camera,
    }
    kept = folder / "build.json"
    if is_file(kept) and (found := read_json(kept)).get("settings") == settings:
        return Build(**found["build"])
    make_folder(folder)
    scene = folder.parent / f"{room}.blend"
    if not scene.is_file():
        level = ["--detail", f"{detail:g}", "--seed", str(seed)]
        _iclnuim("scene", "build", room, *level, "--out", str(scene))
    _make(folder, scene, sequence, args)
    ate_m = {kind: _errors(folder / kind, methods, args.first) for kind in KINDS}
    build = Build(sequence, detail, seed, ate_m)
    write_json(kept, {"settings": settings, "build": asdict(build)})
    return build


def _make(folder: Path, scene: Path, sequence: str, args: Namespace) -> None:
    words = ["--scene", str(scene), "--trajectory", str(shipped.trajectory_file(sequence))]
    words += ["--frames", f"{args.start}:{args.start + args.first}", "--light", "baked"]
    words += ["--map-size", str(args.map_size), "--map-samples", str(args.map_samples)]
    if args.camera:
        words += ["--camera", args.camera]
    _iclnuim("make", *words, "--out", str(folder))


def _iclnuim(*words: str) -> None:
    """Run a command of iclnuim in a process of its own.

    Raises WorkError with its last line if it fails.
    """
    done = subprocess.run(
        [sys.executable, "-m", "iclnuim", *words, "--quiet"], capture_output=True, text=True
    )
    if done.returncode:
        raise WorkError((done.stderr.strip().splitlines() or [f"iclnuim {words[0]} failed"])[-1])


def _errors(folder: Path, methods: Sequence[str], frames: int) -> dict[str, float | None]:
    """ATE in metres of each method; None if it lost more than half of the frames."""
    from iclnuim.benchmark.experiments.recipes.curve import curves
    from iclnuim.benchmark.odometry.run import Sequence as Images
    from iclnuim.benchmark.odometry.track import Tracker
    from iclnuim.benchmark.perturbations.segment import Segment

    truth = read_truth(folder)
    assert truth is not None  # make wrote it
    segment = Segment.of(Images(folder), truth, 0, frames, seed=1)
    variants = []
    for name in methods:
        tracker = Tracker(odometer(name), segment.camera)
        variants.append(curves.Variant(name, None, tracker))
    points = curves.interleaved("detail", variants, segment.frames, segment.truth, lambda: None)
    found = dict.fromkeys(methods)
    found |= {p.method: p.ate_m for p in points if not p.failed}
    return found


def changes(builds: Sequence[Build]) -> list[dict[str, Any]]:
    """For each sequence, kind and method: ATE by level, and the range between seeds at level 1
    divided by their median.
    """
    rows = []
    for sequence in dict.fromkeys(b.sequence for b in builds):
        own = [b for b in builds if b.sequence == sequence]
        levels = sorted((b for b in own if b.seed == 0), key=lambda b: b.detail)
        for kind in KINDS:
            for method in levels[0].ate_m[kind]:
                ate_m = [b.ate_m[kind][method] for b in levels]
                seeds_m = [b.ate_m[kind][method] for b in own if b.detail == DEFAULT]
                row: dict[str, Any] = {"sequence": sequence, "kind": kind, "method": method}
                row["levels"] = [b.detail for b in levels]
                row["ate_m"] = ate_m
                row["seeds_m"] = seeds_m
                row["spread"] = _spread(seeds_m)
                rows.append(row)
    return rows


def _spread(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return (max(known) - min(known)) / median(known) if len(known) > 1 else None


def _draw(axes: Any, row: dict[str, Any], style: dict[str, Any]) -> Any:
    """Draw a method's errors; returns its line, None if all are lost."""
    ate_mm = 1e3 * np.array(row["ate_m"], float)  # NaN where it is lost
    seeds_mm = 1e3 * np.array(row["seeds_m"], float)
    if np.isnan(ate_mm).all():
        return None
    known = ~np.isnan(ate_mm)
    (line,) = axes.plot(np.array(row["levels"])[known], ate_mm[known], **style)
    if not np.isnan(seeds_mm).all():
        ends = [np.nanmin(seeds_mm), np.nanmax(seeds_mm)]
        axes.plot([DEFAULT] * 2, ends, color=style["color"], linewidth=4, alpha=0.35)
    return line


def _figure(builds: Sequence[Build]) -> Any:
    """A panel for each sequence and kind: ATE by detail; bars at level 1 are the range between
    seeds.
    """
    from iclnuim.benchmark.experiments.recipes.curve.error_chart import look
    from matplotlib.figure import Figure

    rows = changes(builds)
    panels = list(dict.fromkeys((row["sequence"], row["kind"]) for row in rows))
    drawing = Figure(figsize=(4.2 * len(panels) / 2 + 2.2, 7.4), layout="constrained")
    grid = drawing.subplots(2, -(-len(panels) // 2), sharex=True, sharey=True, squeeze=False)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    shown: dict[str, Any] = {}
    for axes, (sequence, kind) in zip(grid.T.flat, panels, strict=False):
        for row in rows:
            if (row["sequence"], row["kind"]) == (sequence, kind):
                line = _draw(axes, row, look(row["method"], methods))
                if line is not None:
                    shown[row["method"]] = line
        axes.set(xscale="log", yscale="log", title=f"{sequence} {kind}")
        axes.set_xticks(rows[0]["levels"], labels=[f"{d:g}" for d in rows[0]["levels"]])
        axes.xaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    drawing.supxlabel("level of detail; bars: range between seeds", fontsize="medium")
    drawing.supylabel("ATE RMSE [mm]", fontsize="medium")
    drawing.legend(shown.values(), shown.keys(), loc="outside right upper", fontsize=8)
    return drawing
