"""Slurm: light, arrays of frame tasks and the data set, handed over to an existing Slurm by submitit, each after the one before."""

import subprocess
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

from iclnuim.dataset.recipe import read_recipe, refuse_other
from iclnuim.dataset.run_folder import read_run
from iclnuim.errors import InputError, WorkError

from ..console import Console
from . import slurm_queue
from .chunks import Chunk, chunks_of, size_for_seconds
from .estimate import Estimate, estimate
from .estimate import known as known_figures
from .run_plan import RunPlan
from .slurm_queue import Submitted
from .slurm_settings import SlurmSettings
from .tasks import Task

#: A task may be put back into the queue this often because its time was up; each time it has done some frames.
MAX_TIMEOUTS = 20
#: Seconds before the end of its time at which a task puts itself back; of a short time a quarter.
NOTICE_S = 60

Chunks = tuple[Chunk, ...]


@dataclass(frozen=True)
class Batch:
    """Jobs to be submitted: the frames of each array's tasks, and what they are expected to take; tasks that wait or run already."""

    arrays: tuple[Chunks, ...]
    light: bool
    dataset: bool
    estimate: Estimate
    waiting: dict[str, str]

    def stages(self) -> Iterable[tuple[str, Chunks]]:
        """In the order in which they depend on each other."""
        if self.light:
            yield "light", ()
        for chunks in self.arrays:
            yield "frames", chunks
        if self.dataset:
            yield "dataset", ()


def run(plan: RunPlan, print_only: bool, console: Console) -> int:
    """Submit, and print what was submitted and how to go on; `print_only`: the job scripts, nothing is submitted. Raises InputError, WorkError."""
    if print_only:
        _show(plan, console)
        return 0
    if not slurm_queue.there():
        needed = "sbatch, srun, squeue, scontrol on the PATH"
        raise WorkError(f"no Slurm here ({needed})", hint="a login node, or {print_only}")
    batch = prepare(plan)
    if not any(batch.stages()):
        queued = f"nothing to submit: what is missing is in the queue ({slurm_queue.counted(batch.waiting)})"
        console.note(queued if batch.waiting else "nothing is missing")
        return 0
    jobs = submit(plan, batch)
    console.note(f"{plan.job.sequence}: {batch.estimate.text()}")
    console.note("submitted: " + ", ".join(f"{_what(job)} as job {job.job}" for job in jobs))
    console.note(f"go on with: iclnuim status {plan.out}; iclnuim resume {plan.out}")
    return 0


def _show(plan: RunPlan, console: Console) -> None:
    """Also where there is no Slurm."""
    try:
        batch = prepare(plan)
    except WorkError as error:
        console.note(f"as for an empty queue: {error}")
        batch = prepare(plan, ask=False)
    texts = scripts(plan, batch)
    values = {"scripts": texts, "estimate": asdict(batch.estimate)}
    titled = [f"# job {k} of {len(texts)}\n{text}" for k, text in enumerate(texts, 1)]
    console.result(values, "\n".join([*titled, batch.estimate.text()]))


def _what(job: Submitted) -> str:
    if job.stage != "frames":
        return {"light": "light", "dataset": "data set"}[job.stage]
    return f"{sum(map(len, job.chunks))} frames in {len(job.chunks)} task{'s' * (len(job.chunks) != 1)}"


def prepare(plan: RunPlan, ask: bool = True) -> Batch:
    """What is neither done nor in the queue. `ask` Slurm, else suppose an empty queue. Raises InputError, WorkError."""
    _refuse_other_job(plan)
    jobs = slurm_queue.recorded(plan.raw) if ask else []
    waiting = slurm_queue.in_queue(jobs)
    taken = {n for job in jobs for task, frames in job.tasks.items() if task in waiting for n in frames}
    missing = [n for n in plan.missing() if n not in taken]
    known = known_figures(plan.job)
    size = size_for_seconds(60 * plan.slurm.chunk_minutes, known.frame_core_s / plan.slurm.cpus)
    chunks = tuple(chunks_of(missing, size))
    most = slurm_queue.max_array_size() if ask else slurm_queue.MAX_ARRAY_SIZE
    dataset_waits = any(job.stage == "dataset" and job.job in waiting for job in jobs)
    return Batch(  # as few arrays as the limit allows, of even length
        arrays=tuple(tuple(chunks[k] for k in part) for part in chunks_of(range(len(chunks)), most)),
        light=bool(chunks),
        dataset=plan.sequences is not None and (bool(chunks) or not (dataset_waits or complete(plan))),
        estimate=estimate(plan, [len(frames) for frames in chunks], known),
        waiting=waiting,
    )


def submit(plan: RunPlan, batch: Batch) -> list[Submitted]:
    """Submit the batch; what was submitted before a failure is cancelled. Raises WorkError with Slurm's message."""
    executor = _executor(plan)
    from submitit.core.utils import FailedJobError, FailedSubmissionError

    plan.write_record()
    still = [job for job in slurm_queue.recorded(plan.raw) if any(task in batch.waiting for task in job.tasks)]
    new: list[Submitted] = []
    try:
        for stage, chunks in batch.stages():
            executor.parameters = {}
            executor.update_parameters(**_parameters(plan.slurm, stage, batch.estimate, _dependency(stage, new, batch)))
            given = [Task(plan.to_dict(), str(plan.raw.resolve()), stage, frames) for frames in chunks or [()]]
            job = executor.submit_array(given)[0]
            new.append(Submitted(job.job_id.split("_")[0], stage, chunks))
            slurm_queue.record(plan.raw, still + new)
    except (FailedJobError, FailedSubmissionError, subprocess.SubprocessError) as error:
        slurm_queue.cancel(new)
        raise WorkError(f"sbatch: {' '.join(str(error).split())}") from None
    return new


def scripts(plan: RunPlan, batch: Batch) -> list[str]:
    """The job scripts as submitit writes them; those that wait for others name them by stage."""
    executor, texts = _executor(plan), []
    for stage, chunks in batch.stages():
        after = {"light": None, "frames": "afterok:LIGHT", "dataset": "afterany:LIGHT:FRAMES"}[stage]
        executor.parameters = {}
        executor.update_parameters(**_parameters(plan.slurm, stage, batch.estimate, after))
        if len(chunks) > 1:
            executor.parameters["map_count"] = len(chunks)
        texts.append(executor._make_submission_file_text(executor._submitit_command_str, stage))
    return texts


def complete(plan: RunPlan) -> bool:
    """Whether the recipe of every sequence is finished, with all frames asked for."""
    files = [folder / "recipe.json" for folder in plan.variants()]
    recipes = [read_recipe(file) for file in files if file.is_file()]
    counts = [recipe["frames"]["count"] for recipe in recipes if recipe.get("finished")]
    return len(counts) == len(files) and min(counts, default=0) >= len(plan.numbers)


def _executor(plan: RunPlan) -> Any:
    """submitit's; it also writes scripts where there is no Slurm."""
    try:
        from submitit.slurm.slurm import SlurmExecutor
    except ImportError:
        raise WorkError("submitting to Slurm needs submitit", hint="pip install 'iclnuim[slurm]'") from None

    class Executor(SlurmExecutor):
        @classmethod
        def affinity(cls) -> int:
            return 2

    folder = plan.raw.resolve() / ".farm/slurm"
    if "%" in str(folder):
        expected = "an output folder without %, which Slurm reads as its own"
        raise InputError(expected, path=plan.raw, hint="another {out}")
    return Executor(folder, max_num_timeout=MAX_TIMEOUTS, python=plan.slurm.python)


def _parameters(settings: SlurmSettings, stage: str, expected: Estimate, dependency: str | None) -> dict:
    """sbatch options under submitit's names; a task gets four times the time expected of it, and half an hour at least."""
    task = {"light": expected.light_minutes, "frames": expected.task_minutes, "dataset": expected.dataset_minutes}
    time_min = settings.time_min or max(30, ceil(4 * task[stage]))
    given = {name: getattr(settings, name) for name in ("partition", "account", "qos", "constraint")}
    return {
        "job_name": slurm_queue.NAMES[stage],
        "time": time_min,
        "mem": settings.memory,
        "cpus_per_task": settings.cpus,
        "signal_delay_s": min(NOTICE_S, 15 * time_min),
        "array_parallelism": settings.at_once,
        "srun_args": [f"--cpus-per-task={settings.cpus}"],  # since 22.05 srun does not take it from sbatch
        "wckey": None,
        "setup": [*settings.setup, *_scratch(settings.scratch)] or None,
        # a task that was preempted, or whose node died, goes back into the queue; one whose light failed goes
        "additional_parameters": {"requeue": True, "kill-on-invalid-dep": "yes", **settings.extra},
        **{name: value for name, value in given.items() if value},
        **({"dependency": dependency} if dependency else {}),
    }


def _scratch(folder: str | None) -> list[str]:
    """Shell lines; the node's own variables are filled in there."""
    if folder is None:
        return []
    quoted = folder.replace("\\", "\\\\").replace('"', '\\"').replace("`", "\\`")
    return [f'export ICLNUIM_SCRATCH="{quoted}"', 'mkdir -p "$ICLNUIM_SCRATCH"']


def _dependency(stage: str, new: list[Submitted], batch: Batch) -> str | None:
    """Frames after the light if it was good; the data set after all others, successful or not: it reports what is missing."""
    if stage == "light":
        return None
    if stage == "frames":
        return f"afterok:{new[0].job}"
    earlier = list(dict.fromkeys([*(task.split("_")[0] for task in batch.waiting), *(job.job for job in new)]))
    return f"afterany:{':'.join(earlier)}" if earlier else None


def _refuse_other_job(plan: RunPlan) -> None:
    """Refused before submitting, not by a log hours later. A worker may settle for no denoising, and for path tracing where things move."""
    if not (plan.raw / "sequence.json").is_file():
        return
    there, asked = read_run(plan.raw).recipe["job"], plan.job.to_dict()
    settled = {"light", "samples"} if (there.get("light"), asked["light"]) == ("path", "baked") else set()
    names = set(asked) - {"sequence", "scene", "trajectory", "denoise", "schema_version"} - settled
    begun, wanted = ({name: job.get(name) for name in names} for job in (there, asked))
    refuse_other("run", plan.raw, begun, wanted, "another {out}")
