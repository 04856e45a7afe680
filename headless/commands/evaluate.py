"""`iclnuim evaluate`: the error of an estimated trajectory against the ground truth, absolute (ate) and relative (rpe),
and of a reconstructed surface (surface).

What --json prints and --csv writes is described in error_report.py. Options are plain words and numbers here, checked
by the settings of iclnuim.evaluation, so that nothing heavy is imported before it is needed.
"""

from __future__ import annotations

import argparse
import os

from iclnuim.report.trajectory_text import error_text

from .. import surface_evaluation
from ..console import Console
from ..options import action, subcommands
from ..quick_ate import quick_ate


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser)
    _configure_ate(actions)
    _configure_rpe(actions)
    surface_evaluation.configure(actions)


def spelled_out(argv: list[str]) -> list[str]:
    """`DIR EST` -> `ate GROUNDTRUTH EST`, the ground truth being the one in the folder; `ate` and `rpe` take one too."""
    named = argv[:1] if argv[:1] in (["ate"], ["rpe"]) else []
    files = argv[len(named) :]
    if not files or not os.path.isdir(files[0]):
        return argv
    from pathlib import Path

    from iclnuim.dataset.images import find_truth
    from iclnuim.errors import InputError

    truth = find_truth(Path(files[0]))
    if truth is None and named:
        return argv  # camera files of POV-Ray are a folder, and a trajectory
    if truth is None:
        raise InputError("a ground truth (groundtruth.txt, *.gt.freiburg, *.gt.sim)", path=files[0], found="none")
    return [*(named or ["ate"]), str(truth), *files[1:]]


def _configure_ate(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate ate groundtruth.txt estimate.txt --align sim3 --plot error.png"
    parser = action(actions, "ate", "absolute trajectory error: six statistics, coverage, recall", example, run_ate)
    _files_and_times(parser)
    add = parser.add_argument
    add("--align", default="se3", metavar="METHOD", help="none, origin, yaw, se3 (default) or sim3 (with scale)")
    add("--align-first", type=int, metavar="N", help="align on the first N pairs only; default: all")
    add("--up", default="z", metavar="AXIS", help="the axis that yaw turns about, x, y or z (default)")


def _configure_rpe(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    parser = action(actions, "rpe", "relative pose error: drift over frames, seconds or metres", example, run_rpe)
    _files_and_times(parser)
    add = parser.add_argument
    add("--delta", default="1", metavar="D", help="30 (frames), 1s (seconds) or 0.5m (metres); default: 1")
    add("--pairs", choices=("all", "consecutive"), default="all", help="from every pose (default), or end to end")
    tolerance = "how far a stretch may be off delta (seconds; metres with all pairs); default: %(default)s"
    add("--tolerance", type=float, default=0.1, metavar="SHARE", help=tolerance)
    measured = "whose path metres are counted along: reference (default), or estimate as evo and the TUM tools do"
    add("--measured-on", default="reference", metavar="WHICH", help=measured)
    add("--correct-scale", action="store_true", help="scale the estimate first as --align sim3 would")


def _files_and_times(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("reference", metavar="GT", help="ground truth, in any format that `iclnuim trajectory info` reads")
    add("estimate", metavar="EST", help="estimated trajectory")
    add("--from", dest="format", metavar="FORMAT", help="format of EST: tum, tum-ids, gt.freiburg, kitti ...")
    add("--reference-from", metavar="FORMAT", help="format of GT; default: by name and content, as for EST")
    add("--rate", type=float, default=30.0, metavar="HZ", help="of files that number their frames; default: 30")
    association = "greedy (default): one-to-one as in the TUM tools; nearest: the nearest of GT for each pose of EST"
    add("--association", default="greedy", metavar="RULE", help=association)
    difference = "pairs differ by less than this many seconds; default: %(default)s"
    add("--max-difference", type=float, default=0.02, metavar="S", help=difference)
    add("--offset", type=float, default=0.0, metavar="S", help="seconds added to the stamps of EST; default: 0")
    add("--csv", metavar="FILE", help="write the error of every pair (rpe: of every stretch) as a table")
    add("--plot", metavar="PNG", help="draw the paths, and the error along them and over time")


def run_ate(args: argparse.Namespace, console: Console) -> None:
    """By quick_ate.py where the question and both files are ordinary, else by the library, which loads longer."""
    quick = None
    if _asks_the_usual(args):
        quick = quick_ate(args.reference, args.estimate, args.align, args.max_difference, args.offset)
    if quick is None:
        from ..trajectory_error import evaluate_ate

        return evaluate_ate(args, console)
    for which in ("reference", "estimate"):
        console.note(f"{quick[which]['path']}: {quick[which]['taken']}")
    return console.result(quick, error_text(quick))


def run_rpe(args: argparse.Namespace, console: Console) -> None:
    from ..trajectory_error import evaluate_rpe

    evaluate_rpe(args, console)


def _asks_the_usual(args: argparse.Namespace) -> bool:
    """Whether only options are given that quick_ate takes."""
    unset = (args.align_first, args.format, args.reference_from, args.csv, args.plot) == (None,) * 5
    return unset and (args.association, args.up, args.rate) == ("greedy", "z", 30.0)
