"""`iclnuim bench`: measurements, each with its figures and where they come from."""

import argparse
import importlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from iclnuim import checkout
from iclnuim import job as jobs
from iclnuim.errors import InputError, WorkError, blender_missing
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.odometry.registry import NAMES, odometer

from ..benchmark import evaluate_times
from ..console import Console
from ..options import Actions, action, count, renamed, subcommands
from ..sequence_options import add_camera_options, current_word, open_sequence, require
from .odometry import RENAMED_METHODS


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    _configure_render(actions)
    _configure_odometry(actions)
    _configure_noise(actions)
    evaluate_times.configure(actions)
    _configure_own(actions)


def _configure_own(actions: Actions) -> None:
    """Measurements of the project itself, which need a checkout."""
    try:
        checkout.load("iclnuim.tools", "this benchmark")
        checkout.load("iclnuim.blend.builder", "this benchmark")
    except WorkError as error:
        for name in ("farm", "chaos", "detail"):
            actions.parsers.add_parser(name, help="needs a checkout of the repository").set_defaults(run=_refuse(error))
        return
    for name in ("bench_farm", "bench_detail"):
        importlib.import_module(f"iclnuim.tools.{name}").configure(actions)


def _refuse(error: WorkError) -> Callable:
    def run(args: argparse.Namespace, console: Console) -> int:
        raise error

    return run


def _configure_render(actions: Actions) -> None:
    help = "time, error and flicker of path tracing and baked light"
    parser = action(actions, "render", help, "iclnuim bench render kt2", _render)
    add, sizes = parser.add_argument, (512, 1024, 2048)
    add("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    add("--breakdown", action="store_true", help="instead: where a frame's time goes: rays, shading, EXR, overhead")
    add("--frames", metavar="A:B:S", help="default: every 160th; with --breakdown every 30th")
    add("--maps", type=_sizes, default=sizes, metavar="N,N", help="sides of light maps; default: 512,1024,2048")
    _add_plot(parser, "error")
    add("--only", metavar="TEXT", help="only ways whose name holds this, such as `baked`")
    add("--light", choices=("baked", "path"), default="baked", help="of --breakdown; default: baked")
    add("--samples", type=int, metavar="N", help="of --breakdown")


def _configure_noise(actions: Actions) -> None:
    example = "iclnuim bench noise out/living_room/kt2/raw --official or_kt3 --plot noise.png"
    help = "speed of the noise models beside that of the files alone, and likeness to published noisy frames"
    parser = action(actions, "noise", help, example, _noise)
    add = parser.add_argument
    add("raw", type=Path, metavar="RAW", help="folder of a run, as `iclnuim render` makes it")
    add("--frames", default=":40", metavar="A:B:S", help="default: the first 40")
    add("--rounds", type=int, default=5, metavar="N", help="of which the median counts; default: 5")
    add("--workers", type=int, default=4, metavar="N", help="processes; default: 4")
    both = "holds clean/ and noisy/ of the same frames, such as the original's"
    add("--official", type=Path, metavar="DIR", help=both)
    _add_plot(parser, "likeness")


def _configure_odometry(actions: Actions) -> None:
    example = "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --plot odometry.png"
    help = "speed and error of our odometers and third-party ones in one run"
    parser = action(actions, "odometry", help, example, _odometry)
    what = "sequences with ground truth, or results of --json from before"
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(parser)
    parser.add_argument("--preset", default="best", help="of ours: best (default) or paper")
    parser.add_argument("--first", type=count, metavar="N", help="only the first N frames")
    parser.add_argument("--only", metavar="TEXT", help="only odometers whose name holds this, such as `icp`")
    _add_plot(parser, "error")


def _add_plot(parser: argparse.ArgumentParser, against: str) -> None:
    help = f"time against {against} as a picture (.png, .pdf, .svg)"
    parser.add_argument("--plot", type=Path, metavar="FILE", help=help)
    renamed(parser, "--chart", "--plot", type=Path)


def _sizes(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


def _render(args: argparse.Namespace, console: Console) -> int:
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise blender_missing("bench render", error) from None
    return _breakdown(args, console) if args.breakdown else _compare_light(args, console)


def _breakdown(args: argparse.Namespace, console: Console) -> int:
    from ..benchmark import breakdown

    job = jobs.shipped_job(args.sequence).changed(light=args.light, samples=args.samples)
    result = breakdown.measure(job.changed(denoise=False), args.frames or "::30")
    figures = asdict(result)
    console.result(figures, "\n".join(f"{name:<20}{value:9.2f}" for name, value in figures.items()))
    return 0


def _compare_light(args: argparse.Namespace, console: Console) -> int:
    from iclnuim.blender import worker
    from iclnuim.report import charts as plots

    from ..benchmark import light_comparison

    job = jobs.shipped_job(args.sequence).changed(map_size=max(args.maps))
    views = list(frame_slice(args.frames or "::160", len(worker.load_trajectory(job)) - 1))
    if len(views) < 3:
        raise InputError("at least 3 frames to compare", found=len(views))
    console.note(f"references: {light_comparison.REFERENCE_SAMPLES} samples, {len(views)} views")
    comparison = light_comparison.Comparison(job, views, PinholeCamera.parse("320x240"), console.note)
    ways = [w for w in light_comparison.ways(job, args.maps) if (args.only or "") in w.family]
    progress, results = console.progress(len(ways), "bench render", "ways"), []
    for way in ways:
        results.append(comparison.run(way))
        console.note(light_comparison.row(results[-1]))
        progress.advance()
    if args.plot:
        plots.save(light_comparison.figure(results), args.plot)
    console.result(
        {"machine": light_comparison.machine(), "ways": [asdict(r) for r in results]},
        f"{light_comparison.table(results)}\n{light_comparison.summary(results, job)}",
    )
    return 0


def _noise(args: argparse.Namespace, console: Console) -> int:
    from iclnuim.report import charts as plots

    from ..benchmark import noise

    if args.rounds < 1 or args.workers < 1:
        raise InputError("rounds and workers of at least 1", found=min(args.rounds, args.workers))
    overlaps = noise.overlaps(args.official / "clean", args.official / "noisy") if args.official else None
    times_ms = noise.model_times_ms(args.raw, args.frames)
    progress = console.progress(args.rounds * len(noise.PAIRS), "bench noise", "rounds")
    pairs = noise.pair_times(args.raw, args.frames, args.rounds, args.workers, progress.advance)
    if args.plot:
        plots.save(noise.figure(pairs, times_ms, overlaps), args.plot)
    values = {"pairs": [asdict(p) for p in pairs], "model_ms": times_ms, "overlap_with_official": overlaps}
    console.result(values, noise.table(pairs, times_ms, overlaps))
    return 0


def _odometry(args: argparse.Namespace, console: Console) -> int:
    from ..benchmark import odometry_comparison as comparison

    only = current_word(args.only or "", RENAMED_METHODS, console)
    which = [name for name in NAMES if only in name]
    if not which:
        raise InputError(f"part of a name of {', '.join(NAMES)}", found=args.only)
    results = [result for folder in args.folders if folder.suffix == ".json" for result in comparison.read(folder)]
    folders = [folder for folder in args.folders if folder.suffix != ".json"]
    if folders:
        require("bench odometry", "numba", "cv2")
        which = _installed(which, args.preset, console)
    sequences = [open_sequence(args, console, folder) for folder in folders]
    results += [comparison.compare(s, which, args.preset, args.first, console.progress) for s in sequences]
    if args.plot:
        from iclnuim.report import charts

        from ..benchmark import odometry_chart

        charts.save(odometry_chart.figure(results), args.plot)
    console.result({"races": results}, "\n\n".join(comparison.text(result) for result in results))
    return 0


def _installed(names: list[str], preset: str, console: Console) -> list[str]:
    """Those whose packages are there; the others' rows are left out, with a note. Raises WorkError where none is left."""
    found = []
    for name in names:
        try:
            odometer(name, preset)
            found.append(name)
        except WorkError as error:
            if name == names[-1] and not found:
                raise
            console.note(f"left out: {error}")
    return found
