"""`iclnuim render` and `make` with --engine slurm: hand over what is missing, or only show it. The command then ends; the folder tells the rest."""

from __future__ import annotations

import argparse

from iclnuim.errors import InputError, WorkError

from ..console import Console
from . import record, slurm, slurm_queue
from .slurm_settings import SlurmSettings, settings_from
from .tasks import RunPlan


def asked(args: argparse.Namespace) -> bool:
    """Whether the options ask for Slurm."""
    if args.print_only and args.engine != "slurm":
        raise InputError("--print-only with --engine slurm", found=f"--engine {args.engine or 'local'}")
    return args.engine == "slurm"


def run(command: str, plan: RunPlan, args: argparse.Namespace, console: Console) -> int:
    """Submit, and say what and how to go on. Raises InputError, WorkError."""
    settings = settings_from(args)
    if args.print_only:
        _show(plan, settings, console)
        return 0
    if not slurm_queue.there():
        raise WorkError("no Slurm here (sbatch, srun, squeue, scontrol on the PATH); try a login node, or --print-only")
    batch = slurm.prepare(plan, settings)
    if not any(batch.stages()):
        _say_why_nothing(batch, console)
        return 0
    jobs = slurm.submit(plan, settings, record.of(command, args), batch)
    folder = plan.raw if plan.sensor is None else plan.raw.parent
    console.note(f"{plan.job.sequence}: {batch.estimate.text()}")
    console.note("submitted: " + ", ".join(f"{_what(job)} as job {job.job}" for job in jobs))
    console.note(f"go on with: iclnuim status {folder}; iclnuim resume {folder}")
    return 0


def _show(plan: RunPlan, settings: SlurmSettings, console: Console) -> None:
    """Also where there is no Slurm."""
    try:
        batch = slurm.prepare(plan, settings)
    except WorkError as error:
        console.note(f"as for an empty queue: {error}")
        batch = slurm.prepare(plan, settings, ask=False)
    texts = slurm.scripts(plan, settings, batch)
    values = {"scripts": texts, "estimate": batch.estimate.to_dict()}
    titled = [f"# job {k} of {len(texts)}\n{text}" for k, text in enumerate(texts, 1)]
    console.result(values, "\n".join([*titled, batch.estimate.text()]))


def _say_why_nothing(batch: slurm.Batch, console: Console) -> None:
    if batch.waiting:
        console.note(f"nothing to submit: what is missing is in the queue ({slurm_queue.counted(batch.waiting)})")
    else:
        console.note("nothing is missing")


def _what(job: slurm_queue.Submitted) -> str:
    if job.stage != "frames":
        return {"light": "light", "dataset": "data set"}[job.stage]
    return f"{sum(map(len, job.chunks))} frames in {len(job.chunks)} task{'s' * (len(job.chunks) != 1)}"
