"""`iclnuim bench odometry`: our odometers and the peers' on the same frames, speed against error."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.errors import InputError

from ..console import Console
from ..options import action, count
from ..sequence_camera import add_camera_options, camera_from


def configure(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim bench odometry out/living_room/kt2/clean out/living_room/kt2/noisy --chart odometry.png"
    help = "speed and error of our odometers and the peers' in one run"
    race = action(actions, "odometry", help, example, _run)
    what = "sequences with ground truth, or results of --json from before"
    race.add_argument("folders", type=Path, nargs="+", metavar="DIR", help=what)
    add_camera_options(race)
    race.add_argument("--preset", default="best", help="of ours: best (default) or paper")
    race.add_argument("--first", type=count, metavar="N", help="only the first N frames")
    race.add_argument("--only", metavar="TEXT", help="only odometers whose name holds this, such as `icp`")
    race.add_argument("--chart", type=Path, metavar="FILE", help="time against error as a picture (.png, .pdf, .svg)")


def _run(args: argparse.Namespace, console: Console) -> int:
    from iclnuim.odometry.frames import Sequence
    from iclnuim.report import charts as plots

    from ..benchmark import odometry_chart, odometry_race

    which = [name for name in odometry_race.names() if (args.only or "") in name]
    if not which:
        raise InputError(f"part of a name of {', '.join(odometry_race.names())}", found=args.only)
    races = []
    for folder in args.folders:
        if folder.suffix == ".json":
            races += odometry_race.read(folder)
        else:
            sequence = Sequence(folder, camera=camera_from(args))
            races.append(odometry_race.race(sequence, which, args.preset, args.first, console.progress))
    if args.chart:
        plots.save(odometry_chart.figure(races), args.chart)
    console.result({"races": races}, "\n\n".join(odometry_race.text(race) for race in races))
    return 0
