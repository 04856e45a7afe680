"""`iclnuim evaluate`: the error of an estimated trajectory against the ground truth, absolute (ate) and relative (rpe).

What --json prints and --csv writes is described in error_report.py. Options are words and numbers here and are checked by
the settings of iclnuim.evaluation, so that nothing heavy is imported before it is needed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..console import Console
from ..error_text import error_text
from ..options import action, subcommands
from ..quick_ate import quick_ate


#: Said here again, as words: importing the library for them would take longer than the whole command. A test holds them equal.
ALIGNMENTS = ("none", "origin", "yaw", "se3", "sim3")


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser)
    _configure_ate(actions)
    _configure_rpe(actions)


def _configure_ate(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate ate groundtruth.txt estimate.txt --align sim3 --plot error.png"
    parser = action(actions, "ate", "absolute trajectory error: six statistics, coverage, recall", example, run_ate)
    _files_and_times(parser)
    parser.add_argument(
        "--align",
        choices=ALIGNMENTS,
        default="se3",
        help="how the estimate is laid on the ground truth; yaw: about --up only; sim3: with scale; default: se3",
    )
    parser.add_argument("--align-first", type=int, metavar="N", help="align on the first N pairs only; default: all")
    parser.add_argument(
        "--up", choices=("x", "y", "z"), default="z", help="the axis that yaw turns about; default: z"
    )


def _configure_rpe(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    parser = action(actions, "rpe", "relative pose error: drift over frames, seconds or metres", example, run_rpe)
    _files_and_times(parser)
    parser.add_argument(
        "--delta", default="1", metavar="D", help="30 (frames), 1s (seconds) or 0.5m (metres); default: 1"
    )
    parser.add_argument(
        "--pairs", choices=("all", "consecutive"), default="all", help="from every pose, or end to end; default: all"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.1,
        metavar="SHARE",
        help="how far a stretch may be off delta (seconds, and metres with all pairs); default: 0.1",
    )
    parser.add_argument(
        "--measured-on",
        choices=("reference", "estimate"),
        default="reference",
        help="whose path metres are counted along (evo and the TUM tools: estimate); default: %(default)s",
    )
    parser.add_argument("--correct-scale", action="store_true", help="scale the estimate first as --align sim3 would")


def _files_and_times(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "reference", metavar="GT", help="ground truth, in any format that `iclnuim trajectory info` reads"
    )
    parser.add_argument("estimate", metavar="EST", help="estimated trajectory")
    parser.add_argument(
        "--from", dest="format", metavar="FORMAT", help="format of EST: tum, tum-ids, gt.freiburg, kitti ..."
    )
    parser.add_argument(
        "--reference-from", metavar="FORMAT", help="format of GT; default: by name and content, as for EST"
    )
    parser.add_argument(
        "--rate", type=float, default=30.0, metavar="HZ", help="of files that number their frames; default: 30"
    )
    parser.add_argument(
        "--association",
        choices=("greedy", "nearest"),
        default="greedy",
        help="one-to-one as in the TUM tools, or the nearest ground truth of each estimated pose; default: %(default)s",
    )
    parser.add_argument(
        "--max-difference",
        type=float,
        default=0.02,
        metavar="S",
        help="pairs differ by less than this many seconds; default: %(default)s",
    )
    parser.add_argument(
        "--offset", type=float, default=0.0, metavar="S", help="seconds added to the stamps of EST; default: 0"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the error of every pair as a table")
    parser.add_argument(
        "--plot", type=Path, metavar="PNG", help="draw the paths, and the error along them and over time"
    )


def run_ate(args: argparse.Namespace, console: Console) -> None:
    """By quick_ate.py where the question and both files are ordinary, else by the library, whose import takes longer."""
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
    names = ("align_first", "format", "reference_from", "csv", "plot")
    return all(getattr(args, name) is None for name in names) and (args.association, args.up) == ("greedy", "z")
