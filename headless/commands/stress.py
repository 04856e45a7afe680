"""`iclnuim stress`: where methods fail: frames perturbed step by step, every method on each, figures and heat maps."""

import argparse
import os
from dataclasses import replace
from pathlib import Path

from iclnuim.dataset.frame_pool import cores
from iclnuim.errors import InputError, WorkError
from iclnuim.odometry.registry import NAMES, odometer

from ..options import Console, common, count
from ..sequence_options import require
from ..systems.system import System, read_system

_SEVERITIES = (1, 2, 3, 4, 5)
_DEFAULT = (Path("out/living_room/kt2/clean"), Path("out/office/kt1/clean"))


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    help = "clean sequences with ground truth; default: out/living_room/kt2/clean out/office/kt1/clean"
    add("folders", type=Path, nargs="*", metavar="DIR", help=help)
    add("--list", action="store_true", help="one perturbation a line with its five severities, and nothing else")
    help = "perturbations (default), or corruptions: those of SLAM-under-Perturbation"
    add("--scale", default="perturbations", metavar="NAME", help=help)
    add("-o", "--out", type=Path, default=Path("out/stress"), metavar="OUT", help="default: out/stress")
    help = "perturbations whose name holds this, such as `holes`; several times; default: all"
    add("--only", action="append", default=[], metavar="TEXT", help=help)
    add("--severities", type=_severities, default=_SEVERITIES, metavar="K,K", help="such as 1,2,5; default: all five")
    help = "an odometer, or those whose name holds this, such as `baseline`; several times; default: all that are installed"
    add("--methods", action="append", default=[], metavar="TEXT", help=help)
    help = "also a system of `iclnuim run`, such as orbslam3; several times"
    add("--system", action="append", default=[], metavar="SYSTEM", help=help)
    add("--set", action="append", default=[], metavar="SYSTEM.NAME=VALUE", help="an option of a system, several times")
    add("--runs", type=count, default=5, metavar="N", help="of each system of others on each stretch; default: 5")
    add("--preset", default="best", help="of ours: best (default) or paper")
    add("--frames", type=count, metavar="N", help="of a stretch; default: 120")
    add("--starts", type=count, metavar="N", help="only the first N stretches of each sequence; default: all three")
    add("--workers", type=count, metavar="N", help="processes; default: one a core")
    add("--report-only", action="store_true", help="table and pages of what is there, without making any cell")
    help = "by third-party odometers alone: how much errors grow at severities 1 and 2, how many fail at 5"
    add("--calibration", action="store_true", help=help)
    add("--plot", type=Path, metavar="FILE", help="heat maps of all methods as a picture (.png, .pdf, .svg)")
    common(parser, "iclnuim stress out/living_room/kt2/clean --only holes --only noise --starts 1")


def _severities(text: str) -> tuple[int, ...]:
    found = tuple(sorted({int(part) for part in text.split(",")}))
    if not set(found) <= set(_SEVERITIES):
        raise argparse.ArgumentTypeError(f"expected numbers of {_SEVERITIES[0]} to {_SEVERITIES[-1]}, found {text!r}")
    return found


def run(args: argparse.Namespace, console: Console) -> None:
    """Exit code 0 also where methods failed: their cells say so."""
    require("stress", "numba", "cv2")
    from ..stress.plan import SCALES, read_plan

    if args.scale not in SCALES:
        raise InputError(f"a scale ({', '.join(SCALES)})", setting="--scale", found=args.scale)
    plan = read_plan(SCALES[args.scale])
    if args.list:
        values = {name: p.to_dict() for name, p in plan.perturbations.items()}
        console.result(values, plan.table())
        return
    # before Open3D is loaded, whose results change with the number of threads
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from ..stress import pages
    from ..stress.matrix import Base, Matrix
    from ..stress.summary import Summary

    chosen = tuple(n for n in plan.perturbations if not args.only or any(text in n for text in args.only))
    if not chosen:
        raise InputError(f"part of a name of {', '.join(plan.perturbations)}", setting="--only", found=args.only[0])
    folders = args.folders or [folder for folder in _DEFAULT if folder.is_dir()]
    if not folders:
        raise InputError("a sequence", found="none", hint=f"{_DEFAULT[0]}, which `iclnuim make kt2` makes")
    bases = {base.name: base for base in map(Base.of, folders)}
    plan = replace(plan, frames=args.frames or plan.frames)
    matrix = Matrix(
        out=args.out,
        plan=plan,
        bases=bases,
        methods=() if args.system and not args.methods else _methods(args, console),
        systems=_systems(args),
        perturbations=chosen,
        severities=args.severities,
        starts=args.starts,
        preset=args.preset,
        runs=args.runs,
    )
    if not args.report_only:
        progress = console.progress(matrix.missing(), "stress", "cells")
        matrix.run(args.workers or cores(), progress.advance)
    summary = Summary.of(matrix)
    if not summary.cells:
        raise WorkError(f"{args.out}: no cells", hint="the same command without --report-only")
    pages.write(summary, args.out)
    console.note(f"{args.out / 'stress.html'} written")
    if args.plot:
        from iclnuim.report import charts

        charts.save(pages.figure(summary), args.plot)
    console.result(summary.to_dict(), summary.calibration() if args.calibration else summary.text())


def _methods(args: argparse.Namespace, console: Console) -> tuple[str, ...]:
    """Names of the registry; those whose packages are missing are left out, with a note."""
    texts = args.methods or [""]
    exact = {text for text in texts if text in NAMES}  # icp is also part of icp_rgbd
    wanted = [name for name in NAMES if name in exact or any(text in name for text in texts if text not in exact)]
    if not wanted:
        raise InputError(f"part of a name of {', '.join(NAMES)}", setting="--methods", found=args.methods[0])
    found = []
    for name in wanted:
        try:
            odometer(name, args.preset)
            found.append(name)
        except WorkError as error:
            console.note(f"left out: {error}")
    return tuple(found)


def _systems(args: argparse.Namespace) -> tuple[System, ...]:
    """Of --system, with the options that --set gives each."""
    options: dict[str, dict[str, str]] = {name: {} for name in args.system}
    for text in args.set:
        key, sign, value = text.partition("=")
        system, dot, name = key.partition(".")
        if not (sign and dot and name) or system not in options:
            expected = f"SYSTEM.NAME=VALUE with SYSTEM of {', '.join(options) or '--system'}"
            raise InputError(expected, setting="--set", found=text)
        options[system][name] = value
    return tuple(read_system(name, given) for name, given in options.items())
