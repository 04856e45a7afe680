"""`iclnuim bench`: measurements of time and error; each reports its figures and their conditions."""

import argparse
import importlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from iclnuim import checkout
from iclnuim import job as jobs
from iclnuim.benchmark.odometry.registry import names, odometer
from iclnuim.benchmark.systems.experiment import merged
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.formats.files import read_json
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice

from ..method_options import installed, open_sequence, require
from ..options import action, count, subcommands
from ..sequence_options import add_camera_options
from . import bench_curve

if TYPE_CHECKING:
    from iclnuim.benchmark.odometry.run import Sequence
    from matplotlib.figure import Figure

#: Frames that each odometer tracks before the measurement, so that compiling and loading are not
#: timed.
_WARM_UP = 3


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    help = "time, error and flicker of path tracing and baked light"
    render = action(actions, "render", help, "iclnuim bench render kt2", _render)
    add, sizes = render.add_argument, (512, 1024, 2048)
    add("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    help = "instead, measure the parts of a frame's time: rays, shading, EXR, overhead"
    add("--breakdown", action="store_true", help=help)
    add("--frames", metavar="A:B:S", help="default: every 160th; with --breakdown every 30th")
    add(
        "--maps",
        type=_sizes,
        default=sizes,
        metavar="N,N",
        help="sizes of light maps in texels; default: 512,1024,2048",
    )
    add("--only", metavar="TEXT", help="only methods whose name contains TEXT, such as `baked`")
    add(
        "--light",
        choices=("baked", "path"),
        default="baked",
        help="for --breakdown; default: baked",
    )
    add("--samples", type=int, metavar="N", help="samples per pixel, for --breakdown")

    help = "frames with and without filtered textures, next to frames of many rays a pixel"
    textures = action(
        actions,
        "textures",
        help,
        "iclnuim bench textures kt2 office/kt0 --plot textures.png",
        _textures,
    )
    add = textures.add_argument
    add("sequences", nargs="+", metavar="SEQUENCE")
    add(
        "--frames",
        default="::160",
        metavar="A:B:S",
        help="each with the frame that follows it; default: every 160th",
    )
    add(
        "--camera",
        type=PinholeCamera.parse,
        default=PinholeCamera(),
        metavar="WxH",
        help="default: 640x480",
    )
    add(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw parts of frames side by side (.png, .pdf, .svg)",
    )

    help = "speed and error of our odometers and third-party ones in one run"
    example = "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --plot odometry.png"
    odometry = action(actions, "odometry", help, example, _odometry)
    add = odometry.add_argument
    what = "sequences with ground truth, or earlier results: output of --json, or results.json of `iclnuim run`"
    add("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(odometry)
    add("--preset", default="best", help="preset of our odometers: best (default) or paper")
    add("--first", type=count, metavar="N", help="only the first N frames")
    add(
        "--only",
        metavar="TEXT",
        help="only odometers whose name contains TEXT, such as `icp`, or `ours`: the built-in ones",
    )

    help = "speed of the noise models next to that of file input and output alone; similarity to published noisy frames"
    example = "iclnuim bench noise out/living_room/kt2/raw --official or_kt3 --plot noise.png"
    noise = action(actions, "noise", help, example, _noise)
    add = noise.add_argument
    add("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` writes it")
    add("--frames", default=":40", metavar="A:B:S", help="default: the first 40")
    help = "number of repetitions, of which the median is reported; default: 5"
    add("--rounds", type=int, default=5, metavar="N", help=help)
    add("--workers", type=int, default=4, metavar="N", help="number of processes; default: 4")
    both = "folder with clean/ and noisy/ of the same frames, such as those of the original dataset"
    add("--official", type=Path, metavar="DIR", help=both)
    for parser, against in ((render, "error"), (odometry, "error"), (noise, "similarity")):
        help = f"draw time against {against} (.png, .pdf, .svg)"
        parser.add_argument("--plot", type=Path, metavar="FILE", help=help)

    bench_curve.configure(actions)

    help = "time of trajectory evaluation next to that of evo_ape, each a whole process"
    evaluate = action(
        actions, "evaluate", help, "iclnuim bench evaluate groundtruth.txt estimate.txt", _evaluate
    )
    add = evaluate.add_argument
    add("reference", metavar="GT", help="ground truth, a TUM file")
    add("estimate", metavar="EST", help="estimated trajectory, a TUM file")
    help = "number of repetitions, of which the median is reported; default: 7"
    add("--rounds", type=count, default=7, metavar="N", help=help)

    try:  # measurements that only a checkout of the project has
        checkout.load("iclnuim.tools", "this benchmark")
        checkout.load("iclnuim.blend.builder", "this benchmark")
    except WorkError as error:
        for name in ("farm", "chaos", "detail", "detail-odometry"):
            unavailable = actions.add_parser(name, help="needs a checkout of the repository")
            unavailable.set_defaults(run=partial(_refuse, error))
    else:
        for name in ("bench_farm", "bench_detail", "detail_odometry"):
            importlib.import_module(f"iclnuim.tools.{name}").configure(actions)


def _refuse(error: WorkError, args: argparse.Namespace, console: Console) -> None:
    raise error


def _sizes(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


def _render(args: argparse.Namespace, console: Console) -> None:
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise blender_missing("bench render", error) from None
    if not args.breakdown:
        _compare_light(args, console)
        return
    from iclnuim.tools import frame_breakdown as breakdown

    job = jobs.shipped_job(args.sequence).changed(light=args.light, samples=args.samples)
    figures = asdict(breakdown.measure(job.changed(denoise=False), args.frames or "::30"))
    console.result(figures, "\n".join(f"{name:<20}{value:9.2f}" for name, value in figures.items()))


def _compare_light(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.blender import worker
    from iclnuim.report import charts
    from iclnuim.tools import light_comparison

    job = jobs.shipped_job(args.sequence).changed(map_size=max(args.maps))
    views = list(frame_slice(args.frames or "::160", len(worker.load_trajectory(job)) - 1))
    if len(views) < 3:
        raise InputError("at least 3 frames to compare", found=len(views))
    console.note(f"references: {light_comparison.REFERENCE_SAMPLES} samples, {len(views)} views")
    comparison = light_comparison.Comparison(
        job, views, PinholeCamera.parse("320x240"), console.note
    )
    methods = [w for w in light_comparison.ways(job, args.maps) if (args.only or "") in w.family]
    progress, results = console.progress(len(methods), "bench render", "methods"), []
    for method in methods:
        results.append(comparison.run(method))
        console.note(light_comparison.row(results[-1]))
        progress.advance()
    if args.plot:
        charts.save(light_comparison.figure(results), args.plot)
    recipe = worker.recipe(job)
    machine = {"cores": os.cpu_count(), **recipe["machine"], "blender": recipe["blender"]}
    text = f"{light_comparison.table(results)}\n{light_comparison.summary(results, job)}"
    console.result({"machine": machine, "ways": [asdict(r) for r in results]}, text)


def _textures(args: argparse.Namespace, console: Console) -> None:
    try:
        from iclnuim.blender import worker
    except ImportError as error:
        raise blender_missing("bench textures", error) from None
    from iclnuim.report import charts
    from iclnuim.tools import texture_comparison

    results, parts = [], []
    progress = console.progress(len(args.sequences), "bench textures", "sequences")
    for sequence in args.sequences:
        job = replace(jobs.shipped_job(sequence), camera=args.camera)
        firsts = frame_slice(args.frames, len(worker.load_trajectory(job)) - 1)
        rows, part = texture_comparison.measure(job, firsts)
        results += rows
        parts.append(part)
        progress.advance()
    if args.plot:
        charts.save(texture_comparison.figure(parts), args.plot)
    recipe = worker.recipe(job)
    machine = {"cores": os.cpu_count(), **recipe["machine"], "blender": recipe["blender"]}
    console.result(
        {"machine": machine, "rows": [asdict(r) for r in results]},
        texture_comparison.table(results),
    )


def _noise(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.tools import noise_comparison as noise

    if args.rounds < 1 or args.workers < 1:
        raise InputError("rounds and workers of at least 1", found=min(args.rounds, args.workers))
    overlaps = (
        noise.overlaps(args.official / "clean", args.official / "noisy") if args.official else None
    )
    times_ms = noise.model_times_ms(args.raw, args.frames)
    progress = console.progress(args.rounds * len(noise.PAIRS), "bench noise", "rounds")
    pairs = noise.pair_times(args.raw, args.frames, args.rounds, args.workers, progress.advance)
    if args.plot:
        from iclnuim.report import charts

        charts.save(noise.figure(pairs, times_ms, overlaps), args.plot)
    values = {
        "pairs": [asdict(p) for p in pairs],
        "model_ms": times_ms,
        "overlap_with_official": overlaps,
    }
    console.result(values, noise.table(pairs, times_ms, overlaps))


def _odometry(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.benchmark.odometry.run import table

    only = args.only or ""
    which = [
        name for name in names() if only in (name if ":" in name else f"ours:{name}")
    ]  # as in `iclnuim run`
    if not which:
        raise InputError(f"part of a name of {', '.join(names())}", found=args.only)
    results = [
        result
        for folder in args.folders
        if folder.suffix == ".json"
        for result in _read_results(folder)
    ]
    folders = [folder for folder in args.folders if folder.suffix != ".json"]
    if folders:
        require("bench odometry", "numba", "cv2")
        which = installed(which, args.preset, console)
    sequences = [open_sequence(args, console, folder) for folder in folders]
    results += [
        _compare_odometers(s, which, args.preset, args.first, console.progress) for s in sequences
    ]
    results = merged(results)
    if args.plot:
        from iclnuim.report import charts

        charts.save(_odometry_figure(results), args.plot)
    texts = []
    for r in results:
        title = r["sequence"] + (
            f", our odometers with preset {r['preset']}" if r["preset"] else ""
        )
        texts.append(f"{title}\n{table(r['runs'])}\nPareto front: {', '.join(_front(r['runs']))}")
    console.result({"races": results}, "\n\n".join(texts))


def _compare_odometers(
    sequence: "Sequence", names: list[str], preset: str, frames: int | None, progress: Callable
) -> dict:
    """Run the odometers; returns `sequence`, `preset` and `runs` (Run.to_dict() of each).

    Raises InputError without ground truth.
    """
    from iclnuim.benchmark.odometry.run import run_together
    from iclnuim.dataset.frames import sequence_name

    run_together([odometer(name, preset) for name in names], sequence, frames=_WARM_UP)
    runs = run_together(
        [odometer(name, preset) for name in names], sequence, progress=progress, frames=frames
    )
    if runs[0].truth is None:
        raise InputError("a ground truth in the folder", path=sequence.folder)
    return {
        "sequence": sequence_name(sequence.folder),
        "preset": preset,
        "runs": [run.to_dict() for run in runs],
    }


def _read_results(path: Path) -> list[dict]:
    """Read results that were written with --json. Raises InputError for another file."""
    results = read_json(path).get("races")
    if not isinstance(results, list):
        raise InputError("output of `iclnuim bench odometry --json`", path=path)
    return results


def _front(runs: list[dict]) -> list[str]:
    """The Pareto front: names of the runs that no other run beats in both median time and error."""
    from iclnuim.report import pareto

    runs = [d for d in runs if _has_point(d)]
    return [
        runs[k]["odometer"] for k in pareto.front([(d["ms_median"], d["ate_rmse_m"]) for d in runs])
    ]


def _has_point(d: dict) -> bool:
    return d["ate_rmse_m"] is not None and d["ms_median"] is not None


def _odometry_figure(results: list[dict]) -> "Figure":
    """ATE over time per frame: a dot at the median and a line to the 95th percentile (several runs:
    a triangle, and the quartiles of the ATE); the Pareto front is dashed.
    """
    import numpy as np
    from iclnuim.report.charts import COLOURS
    from matplotlib.figure import Figure

    columns = min(len(results), 4)
    rows = -(-len(results) // columns)
    side = 4.0 if rows == 1 else 3.0
    drawing = Figure(figsize=((side + 0.2) * columns + 1.5, side * rows), layout="constrained")
    panels = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    names = dict.fromkeys(d["odometer"] for result in results for d in result["runs"])
    # hollow markers once the colours are used up
    looks = {name: (COLOURS[i % len(COLOURS)], i // len(COLOURS)) for i, name in enumerate(names)}
    shown = {}
    for axes, result in zip(panels.flat, results, strict=False):
        best, not_beaten = [], _front(result["runs"])
        for d in result["runs"]:
            if not _has_point(d):
                continue
            ate_mm, marker = (
                d["ate_rmse_m"] * 1e3,
                "s" if d["odometer"].startswith("baseline:") else "o",
            )
            colour, hollow = looks[d["odometer"]]
            if (
                "runs" in d
            ):  # from `iclnuim run`: quartiles of the error, and the time of the whole process
                marker = "^"
                axes.plot(
                    [d["ms_median"]] * 2,
                    1e3 * np.array(d["ate_quartiles_m"]),
                    color=colour,
                    linewidth=1,
                )
            else:
                axes.plot([d["ms_median"], d["ms_95"]], [ate_mm, ate_mm], color=colour, linewidth=1)
            style = {
                "color": colour,
                "linestyle": "",
                "markerfacecolor": "white" if hollow else colour,
            }
            (shown[d["odometer"]],) = axes.plot(d["ms_median"], ate_mm, marker, **style)
            if d["odometer"] in not_beaten:
                best.append((d["ms_median"], ate_mm))
        axes.plot(
            [ms for ms, _ in sorted(best)],
            [mm for _, mm in sorted(best)],
            "--",
            color="grey",
            linewidth=0.8,
        )
        axes.set(xscale="log", yscale="log", title=result["sequence"])
        axes.set_xticks([5, 10, 20, 50, 100, 200], labels=["5", "10", "20", "50", "100", "200"])
        axes.xaxis.set_minor_formatter("")
        axes.yaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    for axes in panels.flat[len(results) :]:
        axes.set_visible(False)
    systems = (
        " (triangles: whole process)"
        if any("runs" in d for one in results for d in one["runs"])
        else ""
    )
    drawing.supxlabel(f"ms per frame: median, line to 95 %{systems}", fontsize="medium")
    drawing.supylabel("ATE RMSE [mm]", fontsize="medium")
    drawing.legend(shown.values(), shown.keys(), loc="outside right upper", fontsize=8)
    return drawing


def _evaluate(args: argparse.Namespace, console: Console) -> None:
    """Measure the time of `iclnuim evaluate ate` and of evo_ape on the same two TUM files."""
    reference, estimate = args.reference, args.estimate
    commands = {
        "iclnuim evaluate ate": [
            sys.executable,
            "-m",
            "iclnuim",
            "evaluate",
            "ate",
            reference,
            estimate,
        ]
    }
    evo_ape = shutil.which("evo_ape", path=str(Path(sys.executable).parent)) or shutil.which(
        "evo_ape"
    )
    if evo_ape:
        commands["evo_ape"] = [
            evo_ape,
            "tum",
            reference,
            estimate,
            "--align",
            "--t_max_diff",
            "0.02",
        ]
    else:
        console.note("evo_ape is not installed, so its row is left out; try: pip install evo")
    seconds: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(args.rounds):  # interleaved, so that other load on the machine affects both
        for name, command in commands.items():
            started = time.perf_counter()
            done = subprocess.run(command, capture_output=True, text=True)
            seconds[name].append(time.perf_counter() - started)
            if done.returncode:
                last = (done.stderr or done.stdout).strip().splitlines()[-1:]
                raise WorkError(f"{Path(command[0]).name} failed: {last}")
    figures = {
        name: {"median_s": median(times), "min_s": min(times)} for name, times in seconds.items()
    }
    ours, rows = figures["iclnuim evaluate ate"], [f"{'':22}   median    minimum   ratio"]
    for name, row in figures.items():
        ratio = row["median_s"] / ours["median_s"]
        rows.append(f"{name:<22}{row['median_s']:9.3f} s{row['min_s']:9.3f} s{ratio:8.2f}")
    console.result({"rounds": args.rounds, "times": figures}, "\n".join(rows))
