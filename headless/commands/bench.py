"""`iclnuim bench`: measurements, each with its figures and where they come from."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from iclnuim import job as jobs
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice

from ..console import Console
from ..options import action, subcommands


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "WHAT")
    _configure_render(actions)
    _configure_odometry(actions)


def _configure_render(actions: argparse._SubParsersAction) -> None:
    render = action(
        actions,
        "render",
        "time, error and flicker of path tracing and baked light",
        "iclnuim bench render kt2",
        _render,
    )
    render.add_argument("sequence", nargs="?", default="kt2", metavar="SEQUENCE", help="default: kt2")
    render.add_argument(
        "--breakdown", action="store_true", help="instead: where a frame's time goes: rays, shading, EXR, overhead"
    )
    render.add_argument("--frames", metavar="A:B:S", help="default: every 160th; with --breakdown every 30th")
    render.add_argument(
        "--maps",
        type=_sizes,
        default=(512, 1024, 2048),
        metavar="N,N",
        help="sides of light maps; default: 512,1024,2048",
    )
    render.add_argument("--chart", type=Path, metavar="FILE", help="time against error as a picture (.png, .pdf, .svg)")
    render.add_argument("--only", metavar="TEXT", help="only ways whose name holds this, such as `baked`")
    render.add_argument("--light", choices=("baked", "path"), default="baked", help="of --breakdown; default: baked")
    render.add_argument("--samples", type=int, metavar="N", help="of --breakdown")


def _configure_odometry(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim bench odometry out/living_room/kt2/clean --chart odometry.png"
    help = "speed and error of our odometers and the peers' in one run"
    race = action(actions, "odometry", help, example, _odometry)
    race.add_argument("folder", type=Path, metavar="DIR", help="a sequence with ground truth")
    race.add_argument("--preset", default="best", help="of ours: best (default) or paper")
    race.add_argument("--first", type=int, metavar="N", help="only the first N frames")
    race.add_argument("--only", metavar="TEXT", help="only odometers whose name holds this, such as `icp`")
    race.add_argument("--chart", type=Path, metavar="FILE", help="time against error as a picture (.png, .pdf, .svg)")


def _sizes(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


def _render(args: argparse.Namespace, console: Console) -> int:
    try:
        import bpy  # noqa: F401
    except ImportError:
        raise WorkError("bench render needs the bpy package; try: pip install bpy") from None
    return _breakdown(args, console) if args.breakdown else _race(args, console)


def _breakdown(args: argparse.Namespace, console: Console) -> int:
    from ..benchmark import breakdown

    job = jobs.shipped_job(args.sequence).changed(light=args.light, samples=args.samples)
    result = breakdown.measure(job.changed(denoise=False), args.frames or "::30")
    figures = asdict(result)
    console.result(figures, "\n".join(f"{name:<20}{value:9.2f}" for name, value in figures.items()))
    return 0


def _race(args: argparse.Namespace, console: Console) -> int:
    from iclnuim.blender import worker

    from .. import plots
    from ..benchmark import light_chart, light_race

    job = jobs.shipped_job(args.sequence)
    job = job.changed(map_size=max(args.maps))
    views = list(frame_slice(args.frames or "::160", len(worker.load_trajectory(job)) - 1))
    if len(views) < 3:
        raise InputError("at least 3 frames to compare", found=len(views))
    console.note(f"references: {light_race.REFERENCE_SAMPLES} samples, {len(views)} views")
    race = light_race.Race(job, views, PinholeCamera.parse("320x240"), console.note)
    ways = [w for w in light_race.ways(job, args.maps) if (args.only or "") in w.family]
    progress, results = console.progress(len(ways), "bench render", "ways"), []
    for way in ways:
        results.append(race.run(way))
        console.note(light_chart.row(results[-1]))
        progress.advance()
    if args.chart:
        plots.save(light_chart.figure(results), args.chart)
    console.result(
        {"machine": light_race.machine(), "ways": [asdict(r) for r in results]},
        light_chart.table(results) + "\n" + light_chart.summary(results, job),
    )
    return 0


def _odometry(args: argparse.Namespace, console: Console) -> int:
    from .. import plots
    from ..benchmark import odometry_race
    from ..odometry.report import table

    which = [name for name in odometry_race.names() if (args.only or "") in name]
    if not which:
        raise InputError(f"part of a name of {', '.join(odometry_race.names())}", found=args.only)
    runs = odometry_race.race(args.folder, which, args.preset, args.first, console.progress)
    if args.chart:
        plots.save(odometry_race.figure(runs), args.chart)
    front = odometry_race.front(runs)
    values = {"runs": [run.to_dict() for run in runs], "front": front}
    console.result(values, f"{table(runs)}\nPareto front: {', '.join(front)}")
    return 0
