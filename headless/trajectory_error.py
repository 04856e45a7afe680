"""What `iclnuim evaluate ate` and `rpe` do: read two trajectories, let the library compare them, deliver the report."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.associate import AssociationSettings
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.evaluation.stretches import StretchSettings
from iclnuim.formats.files import atomic_write_text
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.report.trajectory_report import AbsoluteReport, RelativeReport, Report, Source
from iclnuim.report.trajectory_text import error_text

from .console import Console


def evaluate_ate(args: argparse.Namespace, console: Console) -> None:
    """args as commands/evaluate.py declares them."""
    alignment = AlignmentSettings(args.align, args.align_first, args.up)
    settings = AbsoluteErrorSettings(_association(args), alignment)
    reference, estimate = _read(args, console)
    with _named(args.estimate):
        result = absolute_error(reference.loaded.trajectory, estimate.loaded.trajectory, settings)
    _deliver(AbsoluteReport(reference, estimate, settings, result), args, console)


def evaluate_rpe(args: argparse.Namespace, console: Console) -> None:
    """args as commands/evaluate.py declares them."""
    delta, unit = StretchSettings.parse_delta(args.delta)
    stretch = StretchSettings(delta, unit, args.pairs == "all", args.tolerance, args.measured_on)
    settings = RelativeErrorSettings(stretch, _association(args), args.correct_scale)
    reference, estimate = _read(args, console)
    with _named(args.estimate):
        result = relative_error(reference.loaded.trajectory, estimate.loaded.trajectory, settings)
    _deliver(RelativeReport(reference, estimate, settings, result), args, console)


def _association(args: argparse.Namespace) -> AssociationSettings:
    return AssociationSettings(args.association, args.max_difference, args.offset)


def _read(args: argparse.Namespace, console: Console) -> tuple[Source, Source]:
    """Both files; how each was taken is said in a line."""
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
        from iclnuim.report.charts import save
        from iclnuim.report.trajectory_plots import error_figure

        save(error_figure(report), args.plot)
    values = report.to_dict()
    console.result(values, error_text(values))


@contextmanager
def _named(path: str) -> Iterator[None]:
    """What cannot be compared is said of the estimate's file."""
    try:
        yield
    except InputError as error:
        if error.path is not None:
            raise
        raise InputError(error.expected, path=path, found=error.found, hint=error.hint) from None
