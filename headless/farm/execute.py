"""A plan carried out: rendered here, with sequences made of finished frames meanwhile, or handed over to Slurm."""

from pathlib import Path

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.dataset.sequence import SequenceWriter
from iclnuim.errors import InputError

from ..console import Console
from . import slurm
from .chunks import own_cores
from .rendering import open_run, report, stop_on_signals
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
        writer = SequenceWriter(source, variants, plan.formats)
        stage = SequenceStage(writer, run.run, len(own_cores()), plan.keep_raw)
        try:  # pairs are made of finished frames while others are being rendered
            missing = stage.add_finished(plan.numbers)
            outcome = run.render(missing, stage.add, lambda: stopped() or stage.broken)
        finally:
            stage.close()
        code = report(outcome, console)
        if code == 0:
            stage.complete()
            console.note(f"{plan.out}/clean and {plan.out}/noisy hold {len(plan.numbers)} frames each")
        return code
