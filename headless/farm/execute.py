"""A plan carried out: rendered here, with sequences made of finished frames meanwhile, or handed over to Slurm."""

from collections.abc import Callable
from pathlib import Path

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.dataset.sequence import SequenceWriter
from iclnuim.errors import InputError

from ..console import Console
from . import slurm
from .chunks import own_cores
from .rendering import LocalRun, open_run, report, stop_on_signals
from .run_plan import RunPlan
from .sequences import SequenceStage


def execute(plan: RunPlan, console: Console, print_only: bool = False, blend: Path | None = None) -> int:
    """What is missing of the plan; the exit code. Raises InputError, WorkError.

    print_only: show Slurm's job scripts instead. blend: also save the prepared scene there.
    """
    if print_only and plan.farm.engine != "slurm":
        raise InputError("{print_only} with {engine} slurm", found=f"{plan.farm.engine}")
    variants = plan.variants()
    if plan.farm.engine == "slurm":
        if blend is not None:
            raise InputError("{blend} on this machine alone", hint="{engine} local")
        return slurm.run(plan, print_only, console)
    with stop_on_signals() as stopped, open_run(plan, console, stopped) as run:
        plan.write_record()
        if not variants:
            return report(run.render(plan.numbers, blend=blend), console)
        source = frames_of_run(run.run, load_trajectory(plan.job), list(plan.numbers))
        return _render_and_write(run, SequenceWriter(source, variants, plan.formats), stopped)


def _render_and_write(run: LocalRun, writer: SequenceWriter, stopped: Callable[[], bool]) -> int:
    """Pairs are made of finished frames while others are being rendered."""
    plan = run.plan
    stage = SequenceStage(writer, run.run, len(own_cores()), plan.keep_raw)
    try:
        missing = stage.add_finished(plan.numbers)
        outcome = run.render(missing, stage.add, lambda: stopped() or stage.broken)
    finally:
        stage.close()
    code = report(outcome, run.console)
    if code == 0:
        stage.complete()
        run.console.note(f"{plan.out}/clean and {plan.out}/noisy hold {len(plan.numbers)} frames each")
    return code
