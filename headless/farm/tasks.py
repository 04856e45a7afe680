"""The tasks into which a scheduler's render falls: light, some frames, the data set. They share a run folder without locks on frames.

Frames are whole or absent and of equal bytes whoever renders them, so two tasks at the same frame do no harm. Only the data set, whose
journals have one writer, is made under the folder's lock.
"""

from __future__ import annotations

import os
import platform
import queue
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import load_trajectory, read_run
from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter
from iclnuim.errors import WorkError
from iclnuim.job import RenderJob

from ..console import Console
from . import figures, progress
from .cores import own_cores, split
from .local import LocalFarm, Outcome
from .lock import STALE_S, OutputLock
from .plan import chunks_of, local_size
from .rendering import LocalRun
from .sequences import SequenceStage
from .worker_process import WorkerProcess, worker_command

STAGES = ("light", "frames", "dataset")


@dataclass(frozen=True)
class RunPlan:
    """All of a run: frames `numbers` of `job` into the run folder `raw`, and with `sensor` the sequences clean/ and noisy/ beside it."""

    job: RenderJob
    raw: Path
    numbers: tuple[int, ...]
    sensor: SequenceSettings | None = None
    keep_raw: bool = True

    @property
    def variants(self) -> dict[Path, SequenceSettings]:
        """Folder -> settings of the sequences."""
        if self.sensor is None:
            return {}
        return {
            self.raw.parent / "clean": SequenceSettings(seed=self.sensor.seed),
            self.raw.parent / "noisy": self.sensor,
        }

    def missing(self) -> list[int]:
        """Frames that are neither finished nor turned into pairs, as the folder alone says."""
        if not (self.raw / "sequence.json").is_file():
            return list(self.numbers)
        made = progress.standing(self.raw, self.numbers) if self.sensor is not None else set()
        return read_run(self.raw).missing([n for n in self.numbers if n not in made])


@dataclass
class TaskRun(LocalRun):
    """A run folder shared with tasks on other machines: no lock, logs and journal of its own, no more cores than the scheduler gave."""

    frame_core_s: list[float] = field(default_factory=list)
    starts_s: list[float] = field(default_factory=list)
    _begun: list[float] = field(default_factory=list)

    def light(self) -> None:
        """Make the folder; find or bake the light."""
        try:
            self.open()
            if self.job.light == "baked":
                self._opener.send({"bake": True})
                self._wait(self._opener_heard, "baked")
        finally:
            self.close()

    def frames(self, missing: Sequence[int], on_frame: Callable[[int], None]) -> Outcome:
        """Render these. Raises InputError, WorkError; frames given up are in the outcome."""
        self.run = read_run(self.out)
        self.run.check_space(len(missing))
        cores = split(self.job.light, self.workers, granted_cores())[: len(missing)]
        farm = LocalFarm(self._start, cores, on_frame, self._event, self.should_stop, self.care)
        outcome = farm.run(chunks_of(missing, local_size(len(missing), len(cores)))) if missing else Outcome()
        figures.keep(self.job, figures.measured(self.frame_core_s, self.starts_s, len(cores[0]) if cores else 1))
        return outcome

    def _start(self, cores: list[int], heard: queue.SimpleQueue) -> WorkerProcess:
        name = f"{platform.node()}-{os.getpid()}"
        log = self.own_folder / f"task-{name}-{next(self._count):02}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        cores = cores[: len(granted_cores())]
        options = {
            "job": self.job.to_dict(),
            "cores": cores if bound() else [],
            "threads": max(2, len(cores)),
            "journal": str(self.own_folder / f"finished-{name}.jsonl"),
        }
        self._threads = options["threads"]
        self._begun.append(time.monotonic())
        return WorkerProcess(worker_command(), options, self.out.resolve(), log.resolve(), heard)

    def _event(self, event: dict) -> None:
        super()._event(event)
        if event["event"] == "ready" and self._begun:
            self.starts_s.append(time.monotonic() - self._begun.pop(0))
        if event["event"] == "frame" and "cycles" in event:
            # a frame is closed while the next is in Cycles
            self.frame_core_s.append(self._threads * max(event["cycles"], event.get("close", 0.0)))


def granted_cores() -> list[int]:
    """Cores of this task: of all that it may use, as many as the scheduler counts for it."""
    own = own_cores()
    return own[: int(os.environ.get("SLURM_CPUS_PER_TASK") or len(own))]


def bound() -> bool:
    """Whether the scheduler has tied this task to its cores. Where it has not, the first ones are everybody's: no pinning."""
    return len(granted_cores()) == len(own_cores())


def light(plan: RunPlan, console: Console, should_stop: Callable[[], bool]) -> None:
    """The first task: a run folder with its recipe, and the light map in the cache. Raises InputError, WorkError."""
    _task(plan, console, should_stop).light()


def frames(
    plan: RunPlan,
    numbers: Iterable[int],
    console: Console,
    should_stop: Callable[[], bool],
    on_frame: Callable[[int], None],
) -> Outcome:
    """The task between: those of `numbers` that are missing. Raises InputError, WorkError."""
    if not (plan.raw / "sequence.json").is_file():
        light(plan, console, should_stop)
    missing = replace(plan, numbers=tuple(numbers)).missing()
    return _task(plan, console, should_stop).frames(missing, on_frame)


def dataset(plan: RunPlan, on_frame: Callable[[int], None], patience_s: float = 2 * STALE_S) -> int:
    """The last task: both sequences; how many frames they hold. Raises WorkError where frames are missing, once all others are in."""
    run, trajectory = read_run(plan.raw), load_trajectory(plan.job)
    with ExitStack() as held:
        _hold(held, OutputLock(plan.raw / ".farm"), patience_s)
        writer = SequenceWriter(frames_of_run(run, trajectory, list(plan.numbers)), plan.variants)
        stage = SequenceStage(writer, run, len(granted_cores()), plan.keep_raw, on_frame)
        try:
            there = sorted(set(run.frame_numbers()).intersection(plan.numbers))
            finished = set(there).difference(run.missing(there))
            for number in sorted(finished):
                stage.add(number)
        finally:
            stage.close()
        lacking = [n for n in writer.missing if n not in finished]
        if lacking:
            raise WorkError(
                f"{plan.raw.parent}: {len(lacking)} of {len(plan.numbers)} frames are not rendered (the first is {lacking[0]}); "
                f"try: iclnuim resume {plan.raw.parent}"
            )
        stage.complete()
    return len(plan.numbers)


def _task(plan: RunPlan, console: Console, should_stop: Callable[[], bool]) -> TaskRun:
    return TaskRun(plan.job, plan.raw, load_trajectory(plan.job), console, should_stop)


def _hold(held: ExitStack, lock: OutputLock, patience_s: float) -> None:
    """A holder that died on another machine is waited for until its heartbeat is old."""
    end = time.monotonic() + patience_s
    while True:
        try:
            held.enter_context(lock)
            return
        except WorkError:
            if time.monotonic() > end:
                raise
        time.sleep(2.0)
