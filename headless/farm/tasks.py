"""The tasks of a render by a scheduler: simulations, light, some frames, the data set. They share a
run folder without locks on frames.

A frame file is complete or absent, and has the same bytes on every machine, so two tasks may render
the same frame. Only the data set, whose journals have one writer, holds the lock of the folder.
"""

import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from iclnuim.console import Console
from iclnuim.errors import WorkError
from iclnuim.formats.files import locked
from iclnuim.sequences.frame_images import FrameMaker
from iclnuim.sequences.frame_pool import FramePool
from iclnuim.sequences.frame_source import frames_of_run
from iclnuim.sequences.journal import JournalEntry
from iclnuim.sequences.run_folder import RunFolder, read_run
from iclnuim.sequences.writer import SequenceWriter, images_of
from iclnuim.worker_events import Event, FrameDone, Ready

from . import estimate
from .chunks import chunks_of, granted_cores, local_size, split
from .local import LocalFarm, RenderOutcome, Worker
from .lock import STALE_S, OutputLock
from .rendering import LocalRun, Workers, report
from .run_plan import RunPlan


class SequenceStage:
    """Writes the sequences of a plan from finished frames, while other frames are still being
    rendered.

    Create it before the run is opened: it forks its processes, while there are no threads
    (frame_pool.py). Call `begin(run)` when the run exists, then `add(number)` for each rendered
    frame; `complete()` waits for all frames, then writes lists and recipes.

    Images are made on `workers` cores. Journals are written, image pairs read back, and raw frames
    removed on the caller's thread, during its calls. The first error ends the stage; `close` and
    `complete` raise it.
    """

    def __init__(
        self, plan: RunPlan, workers: int, on_frame: Callable[[int], None] = lambda number: None
    ) -> None:
        self._plan = plan
        self._on_frame = on_frame
        self._pool = FramePool(_LateFrameMaker(plan).make, workers, self._made)
        self._locks = ExitStack()

    def __enter__(self) -> "SequenceStage":
        return self

    def __exit__(self, *error: object) -> None:
        with self._locks:
            self.close()

    def begin(self, raw: RunFolder) -> None:
        """Begin or resume the sequences of this run.

        Raises InputError if a folder contains other sequences, WorkError if another process is
        writing them.
        """
        plan = self._plan
        self._raw = raw
        frames = frames_of_run(raw, plan.numbers)
        self._writer = SequenceWriter(frames, plan.variants(), plan.formats)
        for out in plan.variants():
            self._locks.enter_context(locked(out))
        self._lacking = set(self._writer.missing)

    def add(self, number: int) -> None:
        """Add a frame whose raw file exists; if the sequences already contain it, its raw file is
        removed.
        """
        if number in self._lacking:
            self._lacking.remove(number)
            self._pool.add(number)
        else:
            self._drop(number)

    def add_finished(self, numbers: Iterable[int]) -> list[int]:
        """Add those of `numbers` that are already rendered; returns the frames that are still
        missing.
        """
        there = sorted(set(self._raw.frame_numbers()).intersection(numbers))
        finished = set(there).difference(self._raw.missing(there))
        for number in sorted(finished):
            self.add(number)
        return [n for n in self._writer.missing if n not in finished]

    @property
    def broken(self) -> bool:
        """Whether an error has ended the stage."""
        self._pool.collect()
        return self._pool.failed

    def close(self) -> None:
        """Finish the added frames; raises the first error. Safe to call twice."""
        self._pool.close()

    def complete(self, note: Callable[[str], object] = lambda text: None) -> None:
        """After all frames: write lists and recipes, then bags.

        `note` receives what is lost in the formats. Raises InputError, WorkError.
        """
        self.close()
        for sentence in self._writer.losses():
            note(sentence)
        for out, written in zip(self._plan.variants(), self._writer.complete(), strict=True):
            self._plan.logs.write(written.folders[0], out, note)

    def _made(self, entries: list[JournalEntry | None]) -> None:
        number = self._writer.note(entries)
        self._drop(number)
        self._on_frame(number)

    def _drop(self, number: int) -> None:
        if not self._plan.keep_raw and self._writer.is_complete(number):
            self._raw.frame_file(number).unlink(missing_ok=True)


class _LateFrameMaker:
    """Makes the images of a frame.

    Each process reads the run and the sequences at its first frame, when they exist.
    """

    def __init__(self, plan: RunPlan) -> None:
        self._plan = plan

    def make(self, number: int) -> list[JournalEntry | None]:
        return self._maker.make(number)

    @cached_property
    def _maker(self) -> FrameMaker:
        plan = self._plan
        frames = frames_of_run(read_run(plan.raw), plan.numbers)
        return FrameMaker(frames, images_of(frames, plan.variants(), plan.formats))


def simulations(
    plan: RunPlan, console: Console, should_stop: Callable[[], bool], limit_s: float
) -> None:
    """The first task of a scene that may have simulations: make the run folder, and bake them into
    the cache.

    Raises InputError; WorkError if they take longer than `limit_s`.
    """
    if plan.may_simulate:
        with LocalRun(plan, console, should_stop, shared=True, limit_s=limit_s):
            pass


def light(plan: RunPlan, console: Console, should_stop: Callable[[], bool] = lambda: False) -> None:
    """The next task: make the run folder with its recipe, and bake the light map into the cache.

    Raises InputError, WorkError.
    """
    with LocalRun(plan, console, should_stop, shared=True) as run:
        run.bake()


def frames(
    plan: RunPlan,
    console: Console,
    on_frame: Callable[[int], None],
    should_stop: Callable[[], bool] = lambda: False,
) -> RenderOutcome:
    """The next task: render the missing frames of the plan.

    Raises InputError, WorkError; the outcome lists frames that were given up.
    """
    if not (plan.raw / "sequence.json").is_file():
        light(plan, console, should_stop)
    missing = plan.missing()
    if not missing:
        return RenderOutcome()
    read_run(plan.raw).check_space(len(missing))
    cores = split(None, granted_cores())[: len(missing)]
    workers = Workers(plan.job, plan.raw, console, max(missing), shared=True)
    times = _Times(workers)
    farm = LocalFarm(workers.start, cores, on_frame, times.on_event, should_stop, plan.farm)
    outcome = farm.run(chunks_of(missing, local_size(len(missing), len(cores))))
    estimate.keep(plan.job, estimate.measured(times.frames_core_s, times.starts_s, len(cores[0])))
    return outcome


def dataset(plan: RunPlan, on_frame: Callable[[int], None], patience_s: float = 2 * STALE_S) -> int:
    """The last task: write both sequences; returns their number of frames.

    Raises WorkError if frames are missing, after all others are written.
    """
    run = read_run(plan.raw)
    with ExitStack() as stack:
        stage = stack.enter_context(SequenceStage(plan, len(granted_cores()), on_frame))
        end = time.monotonic() + patience_s
        while True:  # if the holder ended on another machine, wait until its heartbeat is stale
            try:
                stack.enter_context(OutputLock(plan.raw / ".farm"))
                break
            except WorkError:
                if time.monotonic() > end:
                    raise
            time.sleep(2.0)
        stage.begin(run)
        try:
            lacking = stage.add_finished(plan.numbers)
        finally:
            stage.close()
        if lacking:
            count = f"{len(lacking)} of {len(plan.numbers)} frames are not rendered"
            raise WorkError(
                f"{plan.out}: {count} (the first is {lacking[0]}); try: iclnuim resume {plan.out}"
            )
        stage.complete()
    return len(plan.numbers)


def run(
    stage: str,
    plan: RunPlan,
    console: Console,
    on_frame: Callable[[int], None],
    should_stop: Callable[[], bool] = lambda: False,
    limit_s: float = math.inf,
) -> int:
    """Run the task `simulations`, `light`, `frames` or `dataset`; returns its exit code. limit_s:
    its time limit.

    Raises InputError, WorkError.
    """
    match stage:
        case "simulations":
            simulations(plan, console, should_stop, limit_s)
        case "light":
            light(plan, console, should_stop)
        case "frames":
            return report(frames(plan, console, on_frame, should_stop), console)
        case _:
            dataset(plan, on_frame)
    return 0


@dataclass(frozen=True)
class SlurmTask:
    """One task that Slurm runs: a stage of the plan in `record`, for the run folder `raw`. frames:
    those of a frame task. limit_s: its time limit.
    """

    record: Mapping[str, Any]
    raw: str
    stage: str
    limit_s: float
    frames: tuple[int, ...] = ()

    def __call__(self) -> int:
        """Run the task on a node; returns the exit code 0.

        Errors are raised, so that Slurm counts the task as failed.
        """
        console = Console()
        plan = RunPlan.from_dict(self.record, Path(self.raw))
        if self.frames:
            plan = replace(plan, numbers=self.frames)
        label = f"{plan.job.sequence}, frame {plan.numbers[0]} and on"
        progress = console.progress(len(plan.numbers), label)

        def on_frame(number: int) -> None:
            progress.advance()

        return run(self.stage, plan, console, on_frame, limit_s=self.limit_s)

    def checkpoint(self) -> object:
        """Called by submitit before the time limit, or at a preemption: submits the same task
        again, which skips finished frames.
        """
        from submitit.helpers import DelayedSubmission

        logging.getLogger("submitit").info("requeued; finished frames are kept")
        return DelayedSubmission(self)


@dataclass
class _Times:
    """Times of frames and of starts of workers, for estimates."""

    workers: Workers
    frames_core_s: list[float] = field(default_factory=list)
    starts_s: list[float] = field(default_factory=list)

    def on_event(self, worker: Worker, event: Event) -> None:
        self.workers.on_event(event)
        if isinstance(event, Ready):
            self.starts_s.append(time.monotonic() - worker.started_s)
        if isinstance(event, FrameDone) and event.cycles is not None:
            # a frame is closed while Cycles renders the next one
            seconds = max(event.cycles, event.close or 0.0)
            self.frames_core_s.append(self.workers.threads(worker.cores) * seconds)
