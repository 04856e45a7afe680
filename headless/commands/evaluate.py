"""`iclnuim evaluate`: the error of an estimated trajectory against the ground truth, absolute (ate) and relative (rpe).

What --json prints and --csv writes is described in error_report.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.evaluation import align, associate
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.evaluation.stretches import MEASURED_ON, StretchSettings
from iclnuim.formats.files import atomic_write, atomic_write_text
from iclnuim.formats.trajectories import read_trajectory

from ..console import Console
from ..error_report import AbsoluteReport, RelativeReport, Report, Source
from ..options import action, subcommands

#: What Matplotlib can draw a chart into; --plot is checked before any work.
PLOT_ENDINGS = (".png", ".pdf", ".svg")


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
        choices=align.METHODS,
        default="se3",
        help="how the estimate is laid on the ground truth; yaw: about --up only; sim3: with scale; default: se3",
    )
    parser.add_argument("--align-first", type=int, metavar="N", help="align on the first N pairs only; default: all")
    parser.add_argument(
        "--up", choices=tuple(align.AXES), default="z", help="the axis that yaw turns about; default: z"
    )


def _configure_rpe(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    parser = action(actions, "rpe", "relative pose error: drift over frames, seconds or metres", example, run_rpe)
    _files_and_times(parser)
    usual = StretchSettings()
    parser.add_argument(
        "--delta", default="1", metavar="D", help="30 (frames), 1s (seconds) or 0.5m (metres); default: 1"
    )
    parser.add_argument(
        "--pairs", choices=("all", "consecutive"), default="all", help="from every pose, or end to end; default: all"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=usual.tolerance,
        metavar="SHARE",
        help="how far a stretch may be off delta (seconds, and metres with all pairs); default: %(default)s",
    )
    parser.add_argument(
        "--measured-on",
        choices=MEASURED_ON,
        default=usual.measured_on,
        help="whose path metres are counted along (evo and the TUM tools: estimate); default: %(default)s",
    )
    parser.add_argument("--correct-scale", action="store_true", help="scale the estimate first as --align sim3 would")


def _files_and_times(parser: argparse.ArgumentParser) -> None:
    usual = associate.AssociationSettings()
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
        choices=associate.METHODS,
        default=usual.method,
        help="one-to-one as in the TUM tools, or the nearest ground truth of each estimated pose; default: %(default)s",
    )
    parser.add_argument(
        "--max-difference",
        type=float,
        default=usual.max_difference_s,
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
    alignment = align.AlignmentSettings(args.align, args.align_first, args.up)
    settings = AbsoluteErrorSettings(_association(args), alignment)
    reference, estimate = _read(args, console)
    with _named(args.estimate):
        result = absolute_error(reference.loaded.trajectory, estimate.loaded.trajectory, settings)
    _deliver(AbsoluteReport(reference, estimate, settings, result), args, console)


def run_rpe(args: argparse.Namespace, console: Console) -> None:
    delta, unit = StretchSettings.parse_delta(args.delta)
    stretch = StretchSettings(delta, unit, args.pairs == "all", args.tolerance, args.measured_on)
    settings = RelativeErrorSettings(stretch, _association(args), args.correct_scale)
    reference, estimate = _read(args, console)
    with _named(args.estimate):
        result = relative_error(reference.loaded.trajectory, estimate.loaded.trajectory, settings)
    _deliver(RelativeReport(reference, estimate, settings, result), args, console)


def _association(args: argparse.Namespace) -> associate.AssociationSettings:
    return associate.AssociationSettings(args.association, args.max_difference, args.offset)


def _read(args: argparse.Namespace, console: Console) -> tuple[Source, Source]:
    """Both files; how each was taken is said in a line. The name of a chart is checked here, before any work."""
    if args.plot and args.plot.suffix.lower() not in PLOT_ENDINGS:
        raise InputError(
            f"a chart named {', '.join(PLOT_ENDINGS)}", path=args.plot, found=args.plot.suffix or "no ending"
        )
    sources = []
    for path, format in ((args.reference, args.reference_from), (args.estimate, args.format)):
        loaded = read_trajectory(path, format, rate_hz=args.rate)
        console.note(f"{path}: {loaded.taken.sentence}")
        sources.append(Source(path, loaded))
    return sources[0], sources[1]


def _deliver(report: Report, args: argparse.Namespace, console: Console) -> None:
    if args.csv:
        atomic_write_text(args.csv, report.csv())
    if args.plot:
        from ..error_plots import draw

        atomic_write(args.plot, lambda temporary: draw(report, temporary))
    console.result(report.to_dict(), report.text())


@contextmanager
def _named(path: str) -> Iterator[None]:
    """What cannot be compared is said of the estimate's file."""
    try:
        yield
    except InputError as error:
        if error.path is not None:
            raise
        raise InputError(error.expected, path=path, found=error.found, hint=error.hint) from None
