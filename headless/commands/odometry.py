"""`iclnuim odometry`: camera motion from the images of a sequence, by one odometer or all of them."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ..console import Console
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("method", nargs="?", metavar="METHOD", help="rgbd, dvo, icp, icp_rgbd or peer:NAME (see docs/odometry.md)")
    add("folder", type=Path, metavar="DIR", help="a sequence in TUM form, or in the original's")
    add("-o", "--out", type=Path, metavar="EST", help="write the path as a TUM trajectory")
    add("--preset", default="best", help="best (default) or paper")
    help = "what a frame is aligned against: own (default: as the preset says), frame, kept or model"
    add("--reference", default="own", metavar="KIND", help=help)
    add("--lost", default="hold", metavar="POLICY", help="hold (default), constant-velocity or restart")
    add("--all", action="store_true", help="run all of ours and print the table")
    add("--plot", type=Path, metavar="FILE", help="draw path and residual (.png, .pdf, .svg)")
    common(parser, "iclnuim odometry dvo out/living_room/kt2/clean -o est.txt")


def run(args: argparse.Namespace, console: Console) -> int:
    """Exit code 0 also where frames were lost: they are named, and left out of the trajectory."""
    from iclnuim.errors import InputError

    from ..odometry import report
    from ..odometry.registry import OURS, odometer, reference

    if bool(args.method) == args.all:
        raise InputError("a METHOD, or --all without one", found=args.method or "neither")
    if args.all and (args.out or args.plot):
        raise InputError("--all without -o and --plot", found="one of them")
    view = partial(reference, args.reference, preset=args.preset)
    runs = [
        report.run_sequence(odometer(name, args.preset), args.folder, args.lost, console.progress, reference=view)
        for name in (OURS if args.all else [args.method])
    ]
    for done in runs:
        for line in done.losses():
            console.note(f"{done.name}: {line}")
    if args.out:
        done.write(args.out)
        console.note(f"{args.out} written")
    if args.plot:
        from .. import plots

        plots.save(report.figure(done), args.plot)
    console.result({"runs": [r.to_dict() for r in runs]}, report.table(runs))
    return 0
