"""`iclnuim evaluate`: the error of an estimated trajectory against the ground truth, absolute (ate) and relative (rpe),
and of a reconstructed surface (surface). iclnuim.report.trajectory_report says what --json prints and --csv writes.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.associate import AssociationSettings
from iclnuim.evaluation.relative_error import RelativeErrorSettings, parse_delta
from iclnuim.formats.files import atomic_write_text
from iclnuim.report.trajectory_report import AbsoluteReport, RelativeReport, Report, Source, error_text

from .. import surface_evaluation
from ..console import Console
from ..options import action, add_settings, settings_from, subcommands


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
    from iclnuim.dataset.images import find_truth

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
    add_settings(parser, AlignmentSettings)


def _configure_rpe(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    parser = action(actions, "rpe", "relative pose error: drift over frames, seconds or metres", example, run_rpe)
    _files_and_times(parser)
    add = parser.add_argument
    add("--delta", default="1", metavar="D", help="30 (frames), 1s (seconds) or 0.5m (metres); default: 1")
    pairs = "a pair from every pose (default), or each from the end of the last"
    add("--pairs", choices=("all", "consecutive"), default="all", help=pairs)
    add_settings(parser, RelativeErrorSettings)


def _files_and_times(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("reference", metavar="GT", help="ground truth, in any format that `iclnuim trajectory info` reads")
    add("estimate", metavar="EST", help="estimated trajectory")
    add("--from", dest="format", metavar="FORMAT", help="format of EST: tum, tum-ids, gt.freiburg, kitti ...")
    add("--reference-from", metavar="FORMAT", help="format of GT; default: by name and content, as for EST")
    add("--rate", type=float, default=30.0, metavar="HZ", help="of files that number their frames; default: 30")
    add_settings(parser, AssociationSettings)
    add("--csv", metavar="FILE", help="write the error of every pair as a table")
    add("--plot", metavar="FILE", help="draw the trajectories, and the error along them and over time")


def run_ate(args: argparse.Namespace, console: Console) -> None:
    association, alignment = settings_from(args, AssociationSettings()), settings_from(args, AlignmentSettings())
    settings = AbsoluteErrorSettings(association, alignment)
    _deliver(AbsoluteReport.of(*_sources(args, console), settings), args, console)


def run_rpe(args: argparse.Namespace, console: Console) -> None:
    delta, unit = parse_delta(args.delta)
    association = settings_from(args, AssociationSettings())
    base = RelativeErrorSettings(delta, unit, args.pairs == "all", association=association)
    settings = settings_from(args, base, ("tolerance", "measured_on", "correct_scale"))
    _deliver(RelativeReport.of(*_sources(args, console), settings), args, console)


def _sources(args: argparse.Namespace, console: Console) -> tuple[Source, Source]:
    """Ground truth and estimate; how each was read is noted."""
    reference = Source.read(args.reference, args.reference_from, args.rate)
    console.note(f"{reference.path}: {reference.loaded.taken.sentence}")
    estimate = Source.read(args.estimate, args.format, args.rate)
    console.note(f"{estimate.path}: {estimate.loaded.taken.sentence}")
    return reference, estimate


def _deliver(report: Report, args: argparse.Namespace, console: Console) -> None:
    if args.csv:
        atomic_write_text(args.csv, report.csv())
    if args.plot:
        from iclnuim.report.charts import save
        from iclnuim.report.trajectory_plots import error_figure

        save(error_figure(report), args.plot)
    values = report.to_dict()
    console.result(values, error_text(values))
