"""Renders a run on this machine: one worker process opens its folder and bakes its light, then
several workers render frames.
"""

import itertools
import math
import os
import platform
import queue
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import atomic_write
from iclnuim.job import RenderJob
from iclnuim.sequences.run_folder import RunFolder, load_trajectory, read_run
from iclnuim.worker_client import WorkerClient, worker_command
from iclnuim.worker_events import (
    Baked,
    Baking,
    ChunkDone,
    Event,
    Exited,
    Failed,
    Note,
    Ready,
    Started,
)

from ..isolation import crash_words
from .chunks import chunks_of, granted_cores, local_size, own_cores, split
from .farm_settings import limit_minutes
from .local import Inbox, LocalFarm, RenderOutcome, Worker, WorkerError, not_started
from .lock import OutputLock
from .run_plan import RunPlan

E = TypeVar("E", bound=Event)
_BEGINS_AGAIN = "the same command begins the bake again"


@dataclass
class Workers:
    """Starts the worker processes of a run folder, and prints each of their notes once.

    last: the last frame that they render. shared: tasks on other machines use the folder too. Logs
    and journal are then named after this task, and a worker uses no more cores than the scheduler
    granted. It is bound to them only if the scheduler has bound this process.
    """

    job: RenderJob
    out: Path
    console: Console
    last: int
    shared: bool = False
    requested: Sequence[int] = ()
    _printed: set[str] = field(default_factory=set)
    _count: Iterator[int] = field(default_factory=itertools.count)

    def start(self, cores: list[int], inbox: Inbox) -> WorkerClient:
        """Start a worker on these cores. Raises WorkError."""
        folder = self.out / ".farm"
        folder.mkdir(parents=True, exist_ok=True)
        number = f"{next(self._count):02}"
        if self.shared:
            task = f"{platform.node()}-{os.getpid()}"
            log = folder / f"task-{task}-{number}.log"
            journal = folder / f"finished-{task}.jsonl"
            granted = granted_cores()
        else:
            log = folder / f"worker-{os.getpid()}-{number}.log"
            journal = folder / "finished.jsonl"
            granted = own_cores()
        cores = cores[: len(granted)]
        bound = granted == own_cores()
        options = {
            "job": self.job.to_dict(),
            "cores": cores if bound else [],
            "threads": self.threads(cores),
            "journal": str(journal),
            "asked": self.requested,
            "last": self.last,
        }
        return WorkerClient(worker_command(), options, self.out.resolve(), log.resolve(), inbox)

    def threads(self, cores: list[int]) -> int:
        """Number of threads of a worker on these cores."""
        if self.shared:
            return max(2, len(cores))
        return len(cores)

    def on_event(self, event: Event) -> None:
        """Print a note that was not printed before."""
        if isinstance(event, Note) and event.text not in self._printed:
            self._printed.add(event.text)
            self.console.note(f"note: {event.text}")


class LocalRun:
    """A run folder on this machine, as a context manager. One worker process makes or resumes it,
    bakes its simulations, and then its light. Then several workers render, or only the first one if
    it uses all cores.

    run, job: as decided by the worker, for example without baked light if the scene moves. shared:
    see Workers. limit_s: the time for a bake of simulations.
    """

    def __init__(
        self,
        plan: RunPlan,
        console: Console,
        should_stop: Callable[[], bool],
        shared: bool = False,
        limit_s: float = math.inf,
    ) -> None:
        self.plan = plan
        self.console = console
        self.should_stop = should_stop
        self.farm: LocalFarm | None = None
        self.limit_s = limit_s
        last = max(plan.numbers)
        self._workers = Workers(plan.job, plan.raw, console, last, shared, plan.numbers)
        self._lost: list[str] = []  # by an interruption
        self._inbox: Inbox = queue.SimpleQueue()

    def __enter__(self) -> "LocalRun":
        self._client = self._workers.start(own_cores(), self._inbox)
        try:
            self._wait(Started)
            self._lost = []
            self.run: RunFolder = read_run(self.plan.raw)
            self.job = self.run.job
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """End the process; safe to call twice."""
        client = self._client
        client.stop()
        end = time.monotonic() + 2.0
        while client.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        clean = client.returncode == 0
        client.kill()
        client.close(keep_log=not clean)

    def bake(self) -> bool:
        """Bake the light of the job into the cache, if the job uses baked light; returns whether it
        was baked now.
        """
        if self.job.light != "baked":
            return False
        self._lost = [_BEGINS_AGAIN]
        self._client.send({"bake": True})
        baked = self._wait(Baked)
        self._lost = []
        self._wait(ChunkDone)
        return baked.made

    def render(
        self,
        numbers: Sequence[int],
        on_frame: Callable[[int], None] = lambda number: None,
        should_stop: Callable[[], bool] | None = None,
        cores: list[list[int]] | None = None,
        blend: Path | None = None,
    ) -> RenderOutcome:
        """Render the missing frames of `numbers`. Raises InputError, WorkError; the outcome lists
        frames that were given up.

        cores: the cores of each worker, if not decided by the plan's number of workers. blend: also
        save the prepared scene to this file.
        """
        stop = should_stop or self.should_stop
        missing = self.run.missing(numbers)
        if numbers:
            self._note_missing(len(missing))
        baked = False
        if missing:
            self.run.check_space(len(missing))
            baked = self.bake()
        if blend is not None:
            saved = (self.plan.raw / ".farm/scene.blend").resolve()
            self._client.send({"blend": str(saved)})
            self._wait(ChunkDone)
            atomic_write(blend, lambda temporary: shutil.move(saved, temporary))
        cores = (cores or split(self.plan.farm.workers))[: len(missing)]
        # after a bake, the worker would keep the memory of the bake
        reuse_worker = blend is None and not baked and cores[:1] == [own_cores()] and not stop()
        if not reuse_worker:
            self.__exit__()
        if not missing or stop():
            return RenderOutcome(stopped=stop())
        self._workers.job = self.job
        self.farm = self._farm(len(missing), cores, on_frame, stop, reuse_worker)
        return self.farm.run(chunks_of(missing, local_size(len(numbers), len(cores))))

    def _note_missing(self, missing: int) -> None:
        total = len(self.plan.numbers)
        count = f"{missing} of {total} frames to render"
        if finished := total - missing:
            count += f", {finished} are there"
        self.console.note(f"{self.job.sequence}: {count}, in {self.plan.raw}")

    def _farm(
        self,
        frames: int,
        cores: list[list[int]],
        on_frame: Callable[[int], None],
        should_stop: Callable[[], bool],
        reuse_worker: bool,
    ) -> LocalFarm:
        """Workers that render `frames` frames, with a progress display."""
        total = len(self.plan.numbers)
        progress = self.console.progress(total, self.job.sequence, there=total - frames)

        def done(number: int) -> None:
            progress.advance()
            on_frame(number)

        def listen(worker: Worker, event: Event) -> None:
            self._workers.on_event(event)
            if isinstance(event, Ready):
                progress.begin()

        return LocalFarm(
            self._workers.start,
            cores,
            done,
            on_event=listen,
            should_stop=should_stop,
            settings=self.plan.farm,
            first=(self._client, self._inbox) if reuse_worker else None,
        )

    def _wait(self, kind: type[E]) -> E:
        """Wait for one event; an error of the worker is raised here.

        A request to stop ends the wait at once: at most a bake is lost.
        """
        while not self.should_stop():
            try:
                client, event = self._inbox.get(timeout=0.2)
            except queue.Empty:
                continue
            self._workers.on_event(event)
            if isinstance(event, kind):
                return event
            if isinstance(event, Baking):
                self._begin_bake(event.seconds)
            if isinstance(event, Failed) and not event.bug:
                raise WorkerError(event)
            if isinstance(event, Exited) and event.code < 0:
                crashed = crash_words(self._workers.job.scene, -event.code)
                raise WorkError(f"{crashed}; its log: {client.log}")
            if isinstance(event, Exited):
                raise not_started(client, event.code)
        raise KeyboardInterrupt(*self._lost)

    def _begin_bake(self, seconds: float) -> None:
        """Raises WorkError for a bake of simulations that its time limit would end."""
        self._lost = [_BEGINS_AGAIN]
        if seconds > self.limit_s:
            minutes = seconds / 60
            found = f"a bake of {minutes:.0f} minutes in a task of {self.limit_s / 60:.0f}"
            again = f"iclnuim resume {self.plan.out} --time {limit_minutes(minutes)}"
            raise WorkError(f"{self.plan.job.scene}: {found}; try: {again}")


@contextmanager
def open_run(
    plan: RunPlan, console: Console, should_stop: Callable[[], bool]
) -> Iterator[LocalRun]:
    """Make or resume the run of `plan`, locked for this command.

    Raises InputError, or WorkError that names another process using the folder.
    """
    started = len(split(plan.farm.workers))
    if started < (plan.farm.workers or 0):
        asked = f"{plan.farm.workers} workers on {len(own_cores())} cores"
        console.note(f"note: {asked}: {started} are started, more would not be faster")
    load_trajectory(plan.job)
    worker_command()
    out = plan.raw
    existed = out.exists()
    if existed and not out.is_dir():
        raise InputError("a folder", path=out, found="a file", hint="another {out}")
    try:
        with OutputLock(out / ".farm"), LocalRun(plan, console, should_stop) as run:
            yield run
    except NotADirectoryError:
        found = "a file in its path"
        raise InputError("a folder", path=out, found=found, hint="another {out}") from None
    except OSError as error:
        raise WorkError(f"{out}: {error.strerror or error}", hint="another {out}") from None
    finally:
        if not (out / "sequence.json").is_file() and not (out / ".farm/lock").exists():
            shutil.rmtree(out / ".farm", ignore_errors=True)
            if not existed and out.is_dir() and not any(out.iterdir()):
                out.rmdir()


def report(outcome: RenderOutcome, console: Console) -> int:
    """Report the outcome; returns the exit code. Raises WorkError if frames failed."""
    if outcome.black:
        first = min(outcome.black)
        of = f"{len(outcome.black)} of {len(outcome.done)} frames are black, the first is {first}"
        console.note(f"note: {of}: {outcome.black[first]}")
    if outcome.stopped:
        console.note("stopped: all finished frames are valid; the same command resumes the run")
        return 130
    if outcome.deaths:
        console.note(f"{outcome.deaths} workers ended unexpectedly and were replaced")
    if outcome.failed:
        listed = "; ".join(f"frame {n}: {log}" for n, log in sorted(outcome.failed.items())[:10])
        count = f"{len(outcome.failed)} frames failed and were given up, all others are done"
        raise WorkError(f"{count}; logs of the failed: {listed}")
    return 0


@contextmanager
def stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Handle Ctrl-C and SIGTERM: the first requests a stop after the current frame, the second ends
    the process at once. Frames stay valid.
    """
    received: list[int] = []

    def note(number: int, _frame: object) -> None:
        received.append(number)
        if len(received) > 1:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
