"""A run rendered on this machine: lock, light, plan, workers, one line of progress."""

from __future__ import annotations

import itertools
import os
import queue
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from iclnuim.dataset.run_folder import RunFolder, load_trajectory, read_run
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.job import RenderJob

from ..console import Console
from ..isolation import crash_words
from .cores import own_cores, split
from .local import Care, LocalFarm, Outcome
from .lock import OutputLock
from .plan import local_size, missing_chunks
from .worker_process import WorkerError, WorkerProcess, worker_command


@dataclass
class LocalRun:
    """A run folder held by this command. Make one with `taken_up`. `cores` instead of `workers`: exactly these for each."""

    job: RenderJob
    out: Path
    trajectory: Trajectory
    console: Console
    should_stop: Callable[[], bool]
    workers: int | None = None
    care: Care = field(default_factory=Care)
    run: RunFolder | None = None
    cores: list[list[int]] | None = None
    farm: LocalFarm | None = None
    _told: set[str] = field(default_factory=set)
    _count: Iterator[int] = field(default_factory=itertools.count)

    @property
    def own_folder(self) -> Path:
        return self.out / ".farm"

    def open(self) -> RunFolder:
        """Make the folder or take up the one that is there, and bake what light it needs, in a process that ends before frames begin."""
        heard: queue.SimpleQueue = queue.SimpleQueue()
        self._opener = self._start(own_cores(), heard)
        self._wait(heard, "start")
        self.run = read_run(self.out)
        self.job = RenderJob.from_dict(
            self.run.recipe["job"]
        )  # as the worker settled it: no baked light where things move
        self._opener_heard = heard
        return self.run

    def render(self, numbers: Sequence[int], on_frame: Callable[[int], None] = lambda number: None) -> Outcome:
        """The frames of `numbers` that are missing. Raises InputError, WorkError; frames given up are in the outcome."""
        cores = self.cores or split(self.job.light, self.workers)
        chunks = missing_chunks(self.run, numbers, local_size(len(numbers), len(cores)))
        missing = sum(len(chunk.frames) for chunk in chunks)
        if numbers:
            self.console.note(f"{self.job.sequence}: {missing} of {len(numbers)} frames to render, in {self.out}")
        if missing:
            self.run.check_space(missing)
        if missing and self.job.light == "baked":
            self._opener.send({"bake": True})
            self._wait(self._opener_heard, "baked")
        self._close_opener()
        if not missing or self.should_stop():
            return Outcome(stopped=self.should_stop())
        progress = self.console.progress(missing, self.job.sequence)

        def done(number: int) -> None:
            progress.advance()
            on_frame(number)

        def heard(event: dict) -> None:
            self._event(event)
            if event["event"] == "ready":
                progress.begin()

        self.farm = LocalFarm(self._start, cores[:missing], done, heard, self.should_stop, self.care)
        return self.farm.run(chunks)

    def close(self) -> None:
        """End what still runs."""
        self._close_opener()

    def _start(self, cores: list[int], heard: queue.SimpleQueue) -> WorkerProcess:
        log = self.own_folder / f"worker-{os.getpid()}-{next(self._count):02}.log"
        options = {
            "job": self.job.to_dict(),
            "cores": cores,
            "threads": len(cores),
            "journal": str(self.own_folder / "finished.jsonl"),
        }
        return WorkerProcess(worker_command(), options, self.out.resolve(), log.resolve(), heard)

    def _wait(self, heard: queue.SimpleQueue, kind: str) -> None:
        """For one event of the opener; its errors are ours. A stop asked for meanwhile ends it at once: nothing is lost."""
        while not self.should_stop():
            try:
                worker, event = heard.get(timeout=0.2)
            except queue.Empty:
                continue
            self._event(event)
            if event["event"] == kind:
                return
            if event["event"] == "error" and not event.get("bug"):
                raise WorkerError(event)
            if event["event"] == "exit" and event["code"] < 0:
                raise WorkError(f"{crash_words(self.job.scene, -event['code'])}; its log: {worker.log}")
            if event["event"] == "exit":
                raise WorkError(
                    f"a worker does not start (code {event['code']}): {worker.last_words()}; its log: {worker.log}"
                )
        raise KeyboardInterrupt

    def _close_opener(self) -> None:
        worker, self._opener = getattr(self, "_opener", None), None
        if worker is None:
            return
        worker.ask_to_stop()
        end = time.monotonic() + 2.0
        while worker.process.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        clean = worker.process.poll() == 0
        worker.kill()
        worker.finish(clean)

    def _event(self, event: dict) -> None:
        if event["event"] == "note" and event["text"] not in self._told:
            self._told.add(event["text"])
            self.console.note(f"note: {event['text']}")


@contextmanager
def taken_up(
    job: RenderJob,
    out: Path,
    console: Console,
    should_stop: Callable[[], bool],
    workers: int | None = None,
    care: Care | None = None,
) -> Iterator[LocalRun]:
    """The run in `out`, held by this command alone. Raises InputError, WorkError; says who else works there."""
    split(job.light, workers)
    trajectory, out = load_trajectory(job), Path(out)
    worker_command()
    stood = out.exists()
    if stood and not out.is_dir():
        raise InputError("a folder", path=out, found="a file", hint="another --out")
    try:
        with OutputLock(out / ".farm"):
            held = LocalRun(job, out, trajectory, console, should_stop, workers, care or Care())
            try:
                held.open()
                yield held
            finally:
                held.close()
    except NotADirectoryError:
        raise InputError("a folder", path=out, found="a file on the way there", hint="another --out") from None
    except OSError as error:
        raise WorkError(f"{out}: {error.strerror or error}; try another --out") from None
    finally:
        if not (out / "sequence.json").is_file() and not (out / ".farm/lock").exists():
            shutil.rmtree(out / ".farm", ignore_errors=True)
            if not stood and out.is_dir() and not any(out.iterdir()):
                out.rmdir()


def report(outcome: Outcome, console: Console) -> int:
    """What became of the frames, in words; the exit code."""
    if outcome.stopped:
        console.note("stopped: the frames so far are valid; the same command goes on from here")
        return 130
    if outcome.deaths:
        console.note(f"{outcome.deaths} workers ended before their time and were replaced")
    if outcome.failed:
        listed = "; ".join(f"frame {n}: {log}" for n, log in sorted(outcome.failed.items())[:10])
        raise WorkError(
            f"{len(outcome.failed)} frames failed and were given up, the rest is done; their logs: {listed}"
        )
    return 0
