"""The tasks into which a scheduler's render falls: light, some frames, the data set. They share a run folder without locks on frames.

Frames are whole or absent and of equal bytes whoever renders them, so two tasks at the same frame do no harm. Only the data set, whose
journals have one writer, is made under the folder's lock.
"""

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import load_trajectory, read_run
from iclnuim.dataset.sequence import SequenceWriter
from iclnuim.errors import WorkError
from iclnuim.worker_events import Event, FrameDone, Ready

from ..console import Console
from . import estimate
from .chunks import chunks_of, granted_cores, local_size, split
from .local import LocalFarm, Outcome, Worker
from .lock import STALE_S, OutputLock
from .rendering import Opener, Workers, report
from .run_plan import RunPlan
from .sequences import SequenceStage

STAGES = ("light", "frames", "dataset")


def light(plan: RunPlan, console: Console, should_stop: Callable[[], bool] = lambda: False) -> None:
    """The first task: a run folder with its recipe, and the light map in the cache. Raises InputError, WorkError."""
    with Opener(Workers(plan.job, plan.raw, console, shared=True), should_stop) as opener:
        opener.bake()


def frames(
    plan: RunPlan,
    numbers: Iterable[int],
    console: Console,
    on_frame: Callable[[int], None],
    should_stop: Callable[[], bool] = lambda: False,
) -> Outcome:
    """The task between: those of `numbers` that are missing. Raises InputError, WorkError; frames given up are in the outcome."""
    if not (plan.raw / "sequence.json").is_file():
        light(plan, console, should_stop)
    missing = replace(plan, numbers=tuple(numbers)).missing()
    if not missing:
        return Outcome()
    read_run(plan.raw).check_space(len(missing))
    cores = split(None, granted_cores())[: len(missing)]
    workers = Workers(plan.job, plan.raw, console, shared=True)
    times = _Times(workers)
    farm = LocalFarm(workers.start, cores, on_frame, times.on_event, should_stop, plan.farm)
    outcome = farm.run(chunks_of(missing, local_size(len(missing), len(cores))))
    estimate.keep(plan.job, estimate.measured(times.frames_core_s, times.starts_s, len(cores[0])))
    return outcome


def dataset(plan: RunPlan, on_frame: Callable[[int], None], patience_s: float = 2 * STALE_S) -> int:
    """The last task: both sequences; how many frames they hold. Raises WorkError where frames are missing, once all others are in."""
    run, trajectory = read_run(plan.raw), load_trajectory(plan.job)
    with ExitStack() as held:
        _lock(held, OutputLock(plan.raw / ".farm"), patience_s)
        source = frames_of_run(run, trajectory, list(plan.numbers))
        writer = SequenceWriter(source, plan.variants(), plan.formats)
        stage = SequenceStage(writer, run, len(granted_cores()), plan.keep_raw, on_frame)
        try:
            lacking = stage.add_finished(plan.numbers)
        finally:
            stage.close()
        if lacking:
            raise WorkError(
                f"{plan.out}: {len(lacking)} of {len(plan.numbers)} frames are not rendered (the first is {lacking[0]}); "
                f"try: iclnuim resume {plan.out}"
            )
        stage.complete()
    return len(plan.numbers)


@dataclass(frozen=True)
class Task:
    """One task as Slurm runs it: a stage of the plan recorded in `record` for the run folder `raw`; `frames` of a frame task."""

    record: Mapping[str, Any]
    raw: str
    stage: str
    frames: tuple[int, ...] = ()

    def __call__(self) -> int:
        """Runs on a node; returns the exit code 0. Raises what failed, so that Slurm counts the task as failed."""
        console, plan = Console(), RunPlan.from_dict(self.record, Path(self.raw))
        if self.stage == "light":
            light(plan, console)
        elif self.stage == "frames":
            progress = console.progress(len(self.frames), f"{plan.job.sequence}, frame {self.frames[0]} and on")
            return report(frames(plan, self.frames, console, lambda number: progress.advance()), console)
        else:
            progress = console.progress(len(plan.numbers), plan.job.sequence, "pairs")
            dataset(plan, lambda number: progress.advance())
        return 0

    def checkpoint(self) -> object:
        """submitit asks before time is up, or when a task must make room: the same task again, frames that are finished are skipped."""
        from submitit.helpers import DelayedSubmission

        logging.getLogger("submitit").info("back into the queue; finished frames stand")
        return DelayedSubmission(self)


@dataclass
class _Times:
    """What frames and starts of workers took, for estimates."""

    workers: Workers
    frames_core_s: list[float] = field(default_factory=list)
    starts_s: list[float] = field(default_factory=list)

    def on_event(self, worker: Worker, event: Event) -> None:
        self.workers.on_event(event)
        if isinstance(event, Ready):
            self.starts_s.append(time.monotonic() - worker.started_s)
        if isinstance(event, FrameDone) and event.cycles is not None:
            seconds = max(event.cycles, event.close or 0.0)  # a frame is closed while the next is in Cycles
            self.frames_core_s.append(self.workers.threads(worker.cores) * seconds)


def _lock(held: ExitStack, lock: OutputLock, patience_s: float) -> None:
    """Where the holder died on another machine, wait until its heartbeat is old."""
    end = time.monotonic() + patience_s
    while True:
        try:
            held.enter_context(lock)
            return
        except WorkError:
            if time.monotonic() > end:
                raise
        time.sleep(2.0)
