"""Slurm: submits simulations, light, arrays of frame tasks and the data set to an existing Slurm
cluster with submitit. Each stage depends on the one before it.
"""

import re
import shutil
import subprocess
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.sequences.recipe import read_recipe
from iclnuim.sequences.record import Record
from iclnuim.sequences.run_folder import read_run

from .chunks import Chunk, chunks_of, size_for_seconds
from .estimate import CostEstimate, estimate
from .estimate import known as known_figures
from .farm_settings import SlurmSettings, limit_minutes, minutes
from .run_plan import RunPlan, read_plan
from .slurm_queue import NAMES, Submitted, counted, in_queue, query, record, recorded
from .tasks import SlurmTask

#: Maximum number of times that a task is requeued at its time limit; each time it has finished some
#: frames.
MAX_TIMEOUTS = 20
#: A task requeues itself this many seconds before its time limit, or at three quarters of a short
#: limit.
NOTICE_S = 60
#: Slurm's default, used if Slurm is not queried.
MAX_ARRAY_SIZE = 1001
#: stage -> the one whose success it needs
_NEEDS = {"light": "simulations", "frames": "light"}

Chunks = tuple[Chunk, ...]


@dataclass(frozen=True)
class Batch:
    """stages: the jobs to submit, in the order of their dependencies, with the frames of each
    array's tasks. estimate: their expected cost. waiting: tasks that already wait or run -> their
    state.
    """

    stages: list[tuple[str, Chunks]]
    estimate: CostEstimate
    waiting: dict[str, str]


def run(plan: RunPlan, print_only: bool, console: Console) -> int:
    """Submit the missing work, and print the submitted jobs and the next commands.

    `print_only`: print the job scripts, submit nothing. Raises InputError, WorkError.
    """
    if print_only:
        return _show(plan, console)
    if not all(shutil.which(name) for name in ("sbatch", "srun", "squeue", "scontrol")):
        needed = "sbatch, srun, squeue, scontrol on the PATH"
        raise WorkError(
            f"Slurm is not available here ({needed})", hint="a login node, or {print_only}"
        )
    batch = prepare(plan)
    if not batch.stages:
        queued = f"nothing to submit: all missing work is in the queue ({counted(batch.waiting)})"
        console.note(queued if batch.waiting else "nothing is missing")
        return 0
    jobs = submit(plan, batch)
    console.note(f"{plan.job.sequence}: {batch.estimate.text()}")
    for job in jobs:
        tasks = f"{len(job.chunks)} task{'s' * (len(job.chunks) != 1)}"
        frames = f"{sum(map(len, job.chunks))} frames in {tasks}"
        what = {"frames": frames, "dataset": "data set"}.get(job.stage, job.stage)
        console.note(f"submitted: {what} as job {job.job}")
    console.note(f"next: iclnuim status {plan.out}; iclnuim resume {plan.out}")
    return 0


def _show(plan: RunPlan, console: Console) -> int:
    """Print the job scripts as submitit writes them; this also works without Slurm."""
    try:
        batch = prepare(plan)
    except WorkError as error:
        console.note(f"an empty queue is assumed: {error}")
        batch = prepare(plan, ask=False)
    executor = _executor(plan)
    texts = []
    shown: list[Submitted] = []  # under the name of the stage, as job numbers are unknown
    for stage, chunks in batch.stages:
        executor.parameters = {}
        dependency = _dependency(stage, shown, batch)
        shown.append(Submitted(stage.upper(), stage))
        executor.update_parameters(**_parameters(plan.slurm, stage, batch.estimate, dependency))
        if len(chunks) > 1:
            executor.parameters["map_count"] = len(chunks)
        texts.append(executor._make_submission_file_text(executor._submitit_command_str, stage))
    values = {"scripts": texts, "estimate": asdict(batch.estimate)}
    titled = [f"# job {k} of {len(texts)}\n{text}" for k, text in enumerate(texts, 1)]
    console.result(values, "\n".join([*titled, batch.estimate.text()]))
    return 0


def prepare(plan: RunPlan, ask: bool = True) -> Batch:
    """The work that is neither finished nor in the queue.

    `ask`: ask Slurm, else assume an empty queue. Raises InputError, WorkError.
    """
    _refuse_other_job(plan)
    jobs = recorded(plan.raw) if ask else []
    waiting = in_queue(jobs)
    if waiting and plan.has_record():
        _refuse_other_plan(plan)
    taken: set[int] = set()
    for job in jobs:
        taken.update(*(frames for task, frames in job.tasks.items() if task in waiting))
    missing = [n for n in plan.missing() if n not in taken]
    known = known_figures(plan.job)
    size = size_for_seconds(60 * plan.slurm.chunk_minutes, known.frame_core_s / plan.slurm.cpus)
    chunks = chunks_of(missing, size)
    stages: list[tuple[str, Chunks]] = []
    if chunks:
        stages += [("simulations", ())] * plan.may_simulate
        stages.append(("light", ()))
        # the fewest possible arrays, of similar length
        max_size = _max_array_size() if ask else MAX_ARRAY_SIZE
        stages += [("frames", part) for part in chunks_of(chunks, max_size)]
    dataset_waits = any(job.stage == "dataset" and job.job in waiting for job in jobs)
    if plan.sequences is not None and (chunks or not (dataset_waits or complete(plan))):
        stages.append(("dataset", ()))
    return Batch(stages, estimate(plan, [len(frames) for frames in chunks], known), waiting)


def _max_array_size() -> int:
    answer = re.search(r"^MaxArraySize\s*=\s*(\d+)", query(["scontrol", "show", "config"]), re.M)
    if answer is None:
        return MAX_ARRAY_SIZE
    return max(1, int(answer[1]))  # it counts from 0


def submit(plan: RunPlan, batch: Batch) -> list[Submitted]:
    """Submit the batch; if a job fails to submit, the earlier ones are cancelled.

    Raises WorkError with Slurm's message.
    """
    executor = _executor(plan)
    from submitit.core.utils import FailedJobError, FailedSubmissionError

    plan.write_record()
    still = [job for job in recorded(plan.raw) if any(task in batch.waiting for task in job.tasks)]
    new: list[Submitted] = []
    try:
        for stage, chunks in batch.stages:
            dependency = _dependency(stage, new, batch)
            executor.parameters = {}
            parameters = _parameters(plan.slurm, stage, batch.estimate, dependency)
            executor.update_parameters(**parameters)
            # a bake would begin again
            executor.max_num_timeout = MAX_TIMEOUTS * (stage != "simulations")
            limit_s = 60 * parameters["time"]
            task = SlurmTask(plan.to_dict(), str(plan.raw.resolve()), stage, limit_s)
            job = executor.submit_array([replace(task, frames=f) for f in chunks or [()]])[0]
            new.append(Submitted(job.job_id.split("_")[0], stage, chunks))
            record(plan.raw, still + new)
    except (FailedJobError, FailedSubmissionError, subprocess.SubprocessError) as error:
        with suppress(WorkError):
            if new:
                query(["scancel", *(job.job for job in new)])
        raise WorkError(f"sbatch: {' '.join(str(error).split())}") from None
    return new


def complete(plan: RunPlan) -> bool:
    """Whether the recipe of every sequence is finished and contains all frames of the plan."""
    files = [folder / "recipe.json" for folder in plan.variants()]
    recipes = [read_recipe(file) for file in files if file.is_file()]
    counts = [recipe["frames"]["count"] for recipe in recipes if recipe.get("finished")]
    return len(counts) == len(files) and min(counts, default=0) >= len(plan.numbers)


def _executor(plan: RunPlan) -> Any:
    """submitit's executor, which also writes scripts without Slurm."""
    try:
        from submitit.slurm.slurm import SlurmExecutor
    except ImportError:
        raise WorkError("submitting to Slurm needs submitit", hint="pip install submitit") from None

    class Executor(SlurmExecutor):
        @classmethod
        def affinity(cls) -> int:
            return 2

    folder = plan.raw.resolve() / ".farm/slurm"
    if "%" in str(folder):
        expected = "an output folder without %, which Slurm interprets as a placeholder"
        raise InputError(expected, path=plan.raw, hint="another {out}")
    return Executor(folder, max_num_timeout=MAX_TIMEOUTS, python=plan.slurm.python)


def _parameters(
    settings: SlurmSettings, stage: str, expected: CostEstimate, dependency: str | None
) -> dict[str, Any]:
    """sbatch options under submitit's names.

    The time limit of a task is four times its estimate, at least half an hour.
    """
    task = {
        "simulations": expected.simulations_minutes,
        "light": expected.light_minutes,
        "frames": expected.task_minutes,
        "dataset": expected.dataset_minutes,
    }
    time_min = limit_minutes(task[stage])
    if settings.time:
        time_min = minutes(settings.time)
    parameters = {
        "job_name": NAMES[stage],
        "time": time_min,
        "mem": settings.memory,
        "cpus_per_task": settings.cpus,
        "signal_delay_s": min(NOTICE_S, 15 * time_min),
        "array_parallelism": settings.at_once,
        # since 22.05 srun does not take it from sbatch
        "srun_args": [f"--cpus-per-task={settings.cpus}"],
        "wckey": None,
        "setup": _setup(settings),
        # a task that was preempted, or whose node failed, is requeued; one whose light task failed
        # is cancelled
        "additional_parameters": {"requeue": True, "kill-on-invalid-dep": "yes", **settings.extra},
        "partition": settings.partition,
        "account": settings.account,
        "qos": settings.qos,
        "constraint": settings.constraint,
        "dependency": dependency,
    }
    return {name: value for name, value in parameters.items() if value or name == "wckey"}


def _setup(settings: SlurmSettings) -> list[str]:
    """The shell lines that run first."""
    if settings.scratch is None:
        return [*settings.setup]
    quoted = re.sub(r'(["`\\])', r"\\\1", settings.scratch)  # variables are expanded on the node
    lines = [f'export ICLNUIM_SCRATCH="{quoted}"', 'mkdir -p "$ICLNUIM_SCRATCH"']
    return [*settings.setup, *lines]


def _dependency(stage: str, new: list[Submitted], batch: Batch) -> str | None:
    """Light depends on the success of the simulations, frames on that of the light.

    The data set runs after all others, successful or not, and reports missing frames.
    """
    if stage != "dataset":
        needed = [job.job for job in new if job.stage == _NEEDS.get(stage)]
        return f"afterok:{needed[0]}" if needed else None
    earlier = [task.split("_")[0] for task in batch.waiting]
    earlier += [job.job for job in new]
    if not earlier:
        return None
    return f"afterany:{':'.join(dict.fromkeys(earlier))}"


def _refuse_other_job(plan: RunPlan) -> None:
    """Raise InputError before submitting, if the folder has a run of another job.

    A worker may have disabled denoising, or chosen path tracing for a scene that moves.
    """
    if not (plan.raw / "sequence.json").is_file():
        return
    begun = read_run(plan.raw).recipe["job"]
    requested = plan.job.to_dict()
    ignored = {"sequence", "scene", "trajectory", "denoise", "schema_version"}
    lights = begun.get("light"), requested["light"]
    if requested["light"] == "auto" or lights == ("path", "baked"):
        ignored |= {"light", "samples", "map_size"}
    names = set(requested) - ignored
    record = Record("run", plan.raw, {name: requested[name] for name in names})
    record.refuse_other({name: begun.get(name) for name in names})


def _refuse_other_plan(plan: RunPlan) -> None:
    """Raise InputError if tasks in the queue were submitted for another job or other sequences."""
    hint = "another {out}, or `scancel` first"
    record = Record("run in the queue", plan.raw, _job_and_sequences(plan), hint=hint)
    record.refuse_other(_job_and_sequences(read_plan(plan.raw)))


def _job_and_sequences(plan: RunPlan) -> dict[str, Any]:
    record = plan.to_dict()
    return {**record["job"], **(record["sequences"] or {})}
