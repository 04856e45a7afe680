"""`iclnuim odometry`: camera motion from the images of a sequence, by one odometer or all of them."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from iclnuim.formats.files import check_file

from ..console import Console
from ..options import common, count
from ..sequence_camera import add_camera_options, camera_from, words


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("method", nargs="?", metavar="METHOD", help="rgbd, dvo, icp, icp_rgbd or peer:NAME (see docs/odometry.md)")
    add("folder", type=Path, metavar="DIR", help="a sequence in TUM form, or in the original's")
    add("-o", "--out", type=Path, metavar="EST", help="write the path as a TUM trajectory")
    add("--preset", default="best", help="best (default) or paper")
    help = "what a frame is aligned against: own (default: as the preset says), frame, kept, entropy or model"
    add("--reference", default="own", metavar="KIND", help=help)
    add("--lost", default="hold", metavar="POLICY", help="hold (default), constant-velocity or restart")
    help = "what the sensor adds to inverse depth, 1/m, taken off again; default: 0"
    add("--depth-offset", type=float, default=0.0, metavar="B", help=help)
    add("--first", type=count, metavar="N", help="only the first N frames")
    add("--all", action="store_true", help="run all of ours and print the table")
    add("--plot", type=Path, metavar="FILE", help="draw path, residual and certainty (.png, .pdf, .svg)")
    add("--show", action="store_true", help="the same in a window")
    add_camera_options(parser)
    common(parser, "iclnuim odometry dvo out/living_room/kt2/clean -o est.txt")


def run(args: argparse.Namespace, console: Console) -> int:
    """Exit code 0 also where frames were lost: they are named, and left out of the trajectory."""
    from iclnuim.errors import InputError
    from iclnuim.odometry import report
    from iclnuim.odometry.frames import Sequence
    from iclnuim.odometry.registry import OURS, odometer, reference

    if bool(args.method) == args.all:
        raise InputError("a METHOD, or --all without one", found=args.method or "neither")
    if args.all and (args.out or args.plot or args.show):
        raise InputError("--all without -o, --plot and --show", found="one of them")
    if args.out:
        check_file(args.out)
    odometers = [odometer(name, args.preset) for name in (OURS if args.all else [args.method])]
    view = partial(reference, args.reference, preset=args.preset)
    sequence = Sequence(args.folder, args.depth_offset, camera_from(args))
    if sequence.camera.assumed:
        console.note(words(sequence.camera))
    runs = report.run_together(odometers, sequence, args.lost, console.progress, args.first, view)
    for done in runs:
        for line in done.losses():
            console.note(f"{done.name}: {line}")
    figures = [done.to_dict() for done in runs]
    console.result({"runs": figures}, report.table(figures))
    _keep(runs[0], args, console)
    return 0


def _keep(done, args: argparse.Namespace, console: Console) -> None:
    if args.out:
        done.write(args.out)
        console.note(f"{args.out} written")
    if args.plot or args.show:
        from iclnuim.odometry import drawing
        from iclnuim.report import charts as plots

        if args.plot:
            plots.save(drawing.figure(done), args.plot)
            console.note(f"{args.plot} written")
        if args.show:
            drawing.show(done)
