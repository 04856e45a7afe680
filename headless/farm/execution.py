"""Executes a plan: what is missing is rendered on this machine, or submitted to Slurm."""

from contextlib import ExitStack
from pathlib import Path

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.sequences.run_folder import trajectory_file
from iclnuim.trajectory_files.trajectories import read_trajectory

from . import held_out, slurm
from .chunks import own_cores
from .rendering import open_run, report, stop_on_signals
from .run_plan import RunPlan
from .tasks import SequenceStage


def execute(
    plan: RunPlan, console: Console, print_only: bool = False, blend: Path | None = None
) -> int:
    """Execute the missing parts of the plan, then those of its held-out views; returns the exit
    code. Raises InputError, WorkError.

    print_only: show the job scripts for Slurm instead. blend: also save the prepared scene to this
    file.
    """
    refuse_print_only(plan, print_only)
    read_as = read_trajectory(trajectory_file(plan.job)).read_as
    if read_as.repeated or read_as.lost:
        console.note(f"{plan.job.trajectory}: {read_as.sentence}")
    if not plan.held_out:
        return _run(plan, console, print_only, blend)
    held_out.prepare(plan, console)
    code = _run(plan, console, print_only, blend)
    return code or _run(held_out.views_plan(plan), console)


def refuse_print_only(plan: RunPlan, print_only: bool) -> None:
    """Raises InputError if job scripts are requested of another engine than Slurm."""
    if print_only and plan.farm.engine != "slurm":
        raise InputError("{print_only} with {engine} slurm", found=f"{plan.farm.engine}")


def _run(
    plan: RunPlan, console: Console, print_only: bool = False, blend: Path | None = None
) -> int:
    plan.variants()  # raises for unknown noise models before any work begins
    if plan.farm.engine == "slurm":
        if blend is not None:
            raise InputError("{blend} only on this machine", hint="{engine} local")
        return slurm.run(plan, print_only, console)
    if plan.sequences is None:
        return _render(plan, console, blend)
    return _make(plan, console)


def _render(plan: RunPlan, console: Console, blend: Path | None) -> int:
    with stop_on_signals() as stopped, open_run(plan, console, stopped) as run:
        plan.write_record()
        return report(run.render(plan.numbers, blend=blend), console)


def _make(plan: RunPlan, console: Console) -> int:
    """Frames of the sequences are written from finished frames while others are being rendered."""
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_signals())
        stage = stack.enter_context(SequenceStage(plan, len(own_cores())))
        run = stack.enter_context(open_run(plan, console, stopped))
        if not plan.has_record():
            plan.write_record()
        stage.begin(run.run)
        plan.write_record()  # that of an accepted command
        try:
            missing = stage.add_finished(plan.numbers)
            outcome = run.render(missing, stage.add, lambda: stopped() or stage.broken)
        finally:
            stage.close()
        code = report(outcome, console)
        if code == 0:
            stage.complete(console.note)
            folders = " and ".join(map(str, plan.variants()))
            console.note(f"{folders}: all {len(plan.numbers)} requested frames are complete")
            if len(plan.formats) == 1:
                console.note(f"to look at them: iclnuim view {next(reversed(plan.variants()))}")
        return code
