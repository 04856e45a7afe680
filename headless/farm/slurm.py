"""Slurm: submits light, arrays of frame tasks and the data set to an existing Slurm cluster with
submitit. Each stage depends on the previous one.
"""

import json
import re
import shutil
import subprocess
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.dataset.run_folder import read_run, refuse_other
from iclnuim.dataset.sequence import read_recipe
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import write_json

from .chunks import Chunk, chunks_of, size_for_seconds
from .estimate import Estimate, estimate
from .estimate import known as known_figures
from .run_plan import RunPlan, SlurmSettings, minutes, read_plan
from .tasks import Task

#: Maximum number of times that a task is requeued at its time limit; each time it has finished some
#: frames.
MAX_TIMEOUTS = 20
#: A task requeues itself this many seconds before its time limit, or at three quarters of a short
#: limit.
NOTICE_S = 60
#: Slurm's default, used if Slurm is not queried.
MAX_ARRAY_SIZE = 1001
#: Record of the submitted jobs, relative to the run folder, next to their logs.
_SUBMITTED = ".farm/slurm/submitted.json"
NAMES = {stage: f"iclnuim-{stage}" for stage in ("light", "frames", "dataset")}

Chunks = tuple[Chunk, ...]


@dataclass(frozen=True)
class Submitted:
    """A submitted job: its number, its stage, and for an array the frames of each task."""

    job: str
    stage: str
    chunks: tuple[tuple[int, ...], ...] = ()

    @property
    def tasks(self) -> dict[str, tuple[int, ...]]:
        """Name of a task in squeue -> its frames."""
        if len(self.chunks) == 1:
            return {self.job: self.chunks[0]}
        return {f"{self.job}_{k}": frames for k, frames in enumerate(self.chunks)} or {self.job: ()}


@dataclass(frozen=True)
class Batch:
    """stages: the jobs to submit, in the order of their dependencies, with the frames of each
    array's tasks. estimate: their expected cost.
    waiting: tasks that already wait or run -> their state.
    """

    stages: list[tuple[str, Chunks]]
    estimate: Estimate
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
    jobs, what = submit(plan, batch), {"light": "light", "dataset": "data set"}
    console.note(f"{plan.job.sequence}: {batch.estimate.text()}")
    for job in jobs:
        frames = f"{sum(map(len, job.chunks))} frames in {len(job.chunks)} task{'s' * (len(job.chunks) != 1)}"
        console.note(f"submitted: {what.get(job.stage, frames)} as job {job.job}")
    console.note(f"next: iclnuim status {plan.out}; iclnuim resume {plan.out}")
    return 0


def _show(plan: RunPlan, console: Console) -> int:
    """Print the job scripts as submitit writes them; this also works without Slurm."""
    try:
        batch = prepare(plan)
    except WorkError as error:
        console.note(f"an empty queue is assumed: {error}")
        batch = prepare(plan, query=False)
    executor, texts = _executor(plan), []
    for (
        stage,
        chunks,
    ) in batch.stages:  # dependencies are shown by stage, as job numbers are unknown
        after = {"light": None, "frames": "afterok:LIGHT", "dataset": "afterany:LIGHT:FRAMES"}[
            stage
        ]
        executor.parameters = {}
        executor.update_parameters(**_parameters(plan.slurm, stage, batch.estimate, after))
        if len(chunks) > 1:
            executor.parameters["map_count"] = len(chunks)
        texts.append(executor._make_submission_file_text(executor._submitit_command_str, stage))
    values = {"scripts": texts, "estimate": asdict(batch.estimate)}
    titled = [f"# job {k} of {len(texts)}\n{text}" for k, text in enumerate(texts, 1)]
    console.result(values, "\n".join([*titled, batch.estimate.text()]))
    return 0


def prepare(plan: RunPlan, query: bool = True) -> Batch:
    """The work that is neither finished nor in the queue.

    `query`: query Slurm, else assume an empty queue. Raises InputError, WorkError.
    """
    _refuse_other_job(plan)
    jobs = recorded(plan.raw) if query else []
    waiting = in_queue(jobs)
    if waiting and plan.has_record():
        _refuse_other_plan(plan)
    taken = {
        n for job in jobs for task, frames in job.tasks.items() if task in waiting for n in frames
    }
    missing = [n for n in plan.missing() if n not in taken]
    known = known_figures(plan.job)
    size = size_for_seconds(60 * plan.slurm.chunk_minutes, known.frame_core_s / plan.slurm.cpus)
    chunks = chunks_of(missing, size)
    answer = re.search(
        r"^MaxArraySize\s*=\s*(\d+)", _query("scontrol", "show", "config") if query else "", re.M
    )
    max_size = max(1, int(answer[1])) if answer else MAX_ARRAY_SIZE  # MaxArraySize counts from 0
    dataset_waits = any(job.stage == "dataset" and job.job in waiting for job in jobs)
    stages: list[tuple[str, Chunks]] = [("light", ())] if chunks else []
    stages += [
        ("frames", part) for part in chunks_of(chunks, max_size)
    ]  # the fewest possible arrays, of similar length
    if plan.sequences is not None and (chunks or not (dataset_waits or complete(plan))):
        stages.append(("dataset", ()))
    return Batch(stages, estimate(plan, [len(frames) for frames in chunks], known), waiting)


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
            executor.parameters = {}
            executor.update_parameters(
                **_parameters(plan.slurm, stage, batch.estimate, _dependency(stage, new, batch))
            )
            given = [
                Task(plan.to_dict(), str(plan.raw.resolve()), stage, frames)
                for frames in chunks or [()]
            ]
            job = executor.submit_array(given)[0]
            new.append(Submitted(job.job_id.split("_")[0], stage, chunks))
            record(plan.raw, still + new)
    except (FailedJobError, FailedSubmissionError, subprocess.SubprocessError) as error:
        with suppress(WorkError):
            if new:
                _query("scancel", *(job.job for job in new))
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
    settings: SlurmSettings, stage: str, expected: Estimate, dependency: str | None
) -> dict:
    """sbatch options under submitit's names.

    The time limit of a task is four times its estimate, at least half an hour.
    """
    task = {
        "light": expected.light_minutes,
        "frames": expected.task_minutes,
        "dataset": expected.dataset_minutes,
    }
    time_min = minutes(settings.time) if settings.time else max(30, ceil(4 * task[stage]))
    setup = [*settings.setup]
    if settings.scratch is not None:  # variables are expanded on the node
        quoted = re.sub(r'(["`\\])', r"\\\1", settings.scratch)
        setup += [f'export ICLNUIM_SCRATCH="{quoted}"', 'mkdir -p "$ICLNUIM_SCRATCH"']
    given = {
        name: getattr(settings, name) for name in ("partition", "account", "qos", "constraint")
    }
    return {
        "job_name": NAMES[stage],
        "time": time_min,
        "mem": settings.memory,
        "cpus_per_task": settings.cpus,
        "signal_delay_s": min(NOTICE_S, 15 * time_min),
        "array_parallelism": settings.at_once,
        "srun_args": [
            f"--cpus-per-task={settings.cpus}"
        ],  # since 22.05 srun does not take it from sbatch
        "wckey": None,
        "setup": setup or None,
        # a task that was preempted, or whose node failed, is requeued; one whose light task failed
        # is cancelled
        "additional_parameters": {"requeue": True, "kill-on-invalid-dep": "yes", **settings.extra},
        **{name: value for name, value in given.items() if value},
        **({"dependency": dependency} if dependency else {}),
    }


def _dependency(stage: str, new: list[Submitted], batch: Batch) -> str | None:
    """Frame tasks depend on the success of the light task.

    The data set runs after all others, successful or not, and reports missing frames.
    """
    if stage == "light":
        return None
    if stage == "frames":
        return f"afterok:{new[0].job}"
    earlier = list(
        dict.fromkeys([*(task.split("_")[0] for task in batch.waiting), *(job.job for job in new)])
    )
    return f"afterany:{':'.join(earlier)}" if earlier else None


def _refuse_other_job(plan: RunPlan) -> None:
    """Raise InputError before submitting, if the folder has a run of another job.

    A worker may have disabled denoising, or chosen path tracing for a scene that moves.
    """
    if not (plan.raw / "sequence.json").is_file():
        return
    begun, requested = read_run(plan.raw).recipe["job"], plan.job.to_dict()
    free = requested["light"] == "auto" or (begun.get("light"), requested["light"]) == (
        "path",
        "baked",
    )
    decided = {"light", "samples"} if free else set()
    names = (
        set(requested) - {"sequence", "scene", "trajectory", "denoise", "schema_version"} - decided
    )
    existing, new = ({name: job.get(name) for name in names} for job in (begun, requested))
    refuse_other("run", plan.raw, existing, new, "another {out}")


def _refuse_other_plan(plan: RunPlan) -> None:
    """Raise InputError if the tasks in the queue were submitted for another job or other sequences."""
    submitted, requested = (
        {**p["job"], **(p["sequences"] or {})}
        for p in (read_plan(plan.raw).to_dict(), plan.to_dict())
    )
    refuse_other(
        "run in the queue", plan.raw, submitted, requested, "another {out}, or `scancel` first"
    )


def in_queue(jobs: list[Submitted]) -> dict[str, str]:
    """Tasks of `jobs` that wait or run -> their state.

    Raises WorkError if Slurm does not answer.
    """
    if not jobs:
        return {}
    lines = _query(
        "squeue", "-h", "-r", "-o", "%i %T", "--name", ",".join(NAMES.values())
    ).splitlines()
    states = dict(line.split()[:2] for line in lines if len(line.split()) > 1)
    ours = {task for job in jobs for task in job.tasks}
    return {task: state for task, state in states.items() if task in ours}


def counted(states: dict[str, str]) -> str:
    """Number of tasks by state, such as `3 running, 10 pending`."""
    return ", ".join(
        f"{n} {state.lower()}"
        for state, n in sorted(Counter(states.values()).items(), reverse=True)
    )


def recorded(raw: Path) -> list[Submitted]:
    """Jobs submitted so far for a run folder; none if nothing is recorded."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = json.loads((raw / _SUBMITTED).read_text("utf-8"))
        return [
            Submitted(j["job"], j["stage"], tuple(map(tuple, j["chunks"]))) for j in content["jobs"]
        ]
    return []


def record(raw: Path, jobs: list[Submitted]) -> None:
    """Record the jobs submitted so far."""
    content = [
        {"job": j.job, "stage": j.stage, "chunks": [list(c) for c in j.chunks]} for j in jobs
    ]
    (raw / _SUBMITTED).parent.mkdir(parents=True, exist_ok=True)
    write_json(raw / _SUBMITTED, {"jobs": content})


def last_error(raw: Path) -> str | None:
    """The error of the task that failed last, from the logs in the run folder."""
    logs = sorted(
        (raw / ".farm/slurm").glob("*_log.err"), key=lambda path: path.stat().st_mtime, reverse=True
    )
    for log in logs:
        if found := re.findall(
            r"^(?:[\w.]*\.)?\w*Error: (.+)$", log.read_text("utf-8", "replace"), re.M
        ):
            return f"{log.name}: {found[-1]}"
    return None


def _query(*command: str) -> str:
    try:
        return subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=True
        ).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        reason = str(error)
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split()) or f"exit code {error.returncode}"
    raise WorkError(f"{command[0]}: {reason}; run this on a machine where Slurm's commands work")
