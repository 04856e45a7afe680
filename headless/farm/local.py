"""The local farm: chunks of a plan to worker processes; dead and stuck ones are replaced, their frames tried again."""

from __future__ import annotations

import queue
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from iclnuim.errors import WorkError

from .plan import Chunk
from .worker_process import WorkerError, WorkerProcess

#: Starts in a row that die before their first frame end the run.
MOST_DEAD_STARTS = 3


@dataclass(frozen=True)
class Care:
    """When a worker is given up or replaced: seconds without any event once the scene stands, and before that; seconds without
    a finished frame, for signs of life may outlive the renderer; frames, megabytes.
    """

    silent_s: float = 120.0
    starting_s: float = 1800.0
    frame_s: float = 3600.0
    attempts: int = 3
    most_frames: int = 2000
    most_mb: float = 6000.0


@dataclass
class Outcome:
    """Frames done in this run; frames given up, with the log that says why; whether somebody asked for a stop."""

    done: set[int] = field(default_factory=set)
    failed: dict[int, Path] = field(default_factory=dict)
    stopped: bool = False
    deaths: int = 0


class LocalFarm:
    """Renders chunks with one worker for each set of cores. `start(cores)` makes a worker, `on_frame(number)` hears of each frame once.

    `on_event(event)` hears all events of all workers.
    """

    def __init__(
        self,
        start: Callable[[list[int], queue.SimpleQueue], WorkerProcess],
        cores: list[list[int]],
        on_frame: Callable[[int], None],
        on_event: Callable[[dict], None] = lambda event: None,
        should_stop: Callable[[], bool] = lambda: False,
        care: Care | None = None,
    ) -> None:
        self._start, self._free, self._care = start, list(cores), care or Care()
        self._on_frame, self._on_event, self._should_stop = on_frame, on_event, should_stop
        self._heard: queue.SimpleQueue = queue.SimpleQueue()
        self._workers: dict[WorkerProcess, list[int]] = {}
        self._tries: Counter[int] = Counter()
        self._todo: deque[Chunk] = deque()
        self._dead_starts = 0
        self._outcome = Outcome()

    @property
    def workers(self) -> list[WorkerProcess]:
        """Those that live."""
        return list(self._workers)

    def run(self, chunks: list[Chunk]) -> Outcome:
        """Until every frame is done or given up, or a stop is asked for. Raises WorkerError, WorkError."""
        self._todo = deque(chunks)
        try:
            while not self._should_stop() and (self._todo or any(w.busy for w in self._workers)):
                self._staff()
                self._hear(0.2)
                self._look_after()
            self._outcome.stopped = self._should_stop()
            self._dismiss()
        finally:
            for worker in self._workers:
                worker.kill()
                worker.finish(clean=False)
        return self._outcome

    def _staff(self) -> None:
        """A worker for every set of cores while there is work, a chunk for every idle worker."""
        for worker in self._workers:
            if self._todo and not worker.busy and not worker.asked_to_stop:
                worker.give(self._todo.popleft())
        while self._todo and self._free:
            cores = self._free.pop(0)
            worker = self._start(cores, self._heard)
            self._workers[worker] = cores
            worker.give(self._todo.popleft())

    def _hear(self, wait_s: float) -> None:
        try:
            worker, event = self._heard.get(timeout=wait_s)
            while True:
                self._take(worker, event)
                worker, event = self._heard.get_nowait()
        except queue.Empty:
            pass

    def _take(self, worker: WorkerProcess, event: dict) -> None:
        worker.last_heard_s = time.monotonic()
        self._on_event(event)
        kind = event["event"]
        if kind == "ready":
            worker.ready, worker.last_frame_s = True, worker.last_heard_s
        elif kind == "frame":
            worker.rendered += 1
            self._dead_starts = 0
            self._frame(worker, event["frame"])
        elif kind == "chunk":
            for number in list(worker.left):  # found finished, by a worker that died before it could say so
                self._frame(worker, number)
            worker.chunk = None
            self._retire(worker, event.get("rss_mb", 0.0))
        elif kind == "error" and not event.get("bug"):
            raise WorkerError(event)
        elif kind == "exit":
            self._buried(worker, event["code"])

    def _frame(self, worker: WorkerProcess, number: int) -> None:
        worker.left.remove(number)
        worker.last_frame_s = time.monotonic()
        self._outcome.done.add(number)
        self._on_frame(number)

    def _retire(self, worker: WorkerProcess, rss_mb: float) -> None:
        """After enough frames, or grown too big: the next one takes its cores once it is gone."""
        if worker.rendered >= self._care.most_frames or rss_mb > self._care.most_mb:
            worker.ask_to_stop()

    def _look_after(self) -> None:
        """Kill whoever has said nothing for too long."""
        now = time.monotonic()
        for worker in self._workers:
            patience = self._care.silent_s if worker.ready else self._care.starting_s
            since_frame_s = now - worker.last_frame_s if worker.ready else 0.0
            if worker.busy and (now - worker.last_heard_s > patience or since_frame_s > self._care.frame_s):
                worker.kill()

    def _buried(self, worker: WorkerProcess, code: int) -> None:
        """A worker has ended: its cores are free, its frames are tried again."""
        self._free.append(self._workers.pop(worker))
        clean = worker.asked_to_stop and not worker.left
        worker.finish(clean)
        if clean or self._outcome.stopped:
            return
        self._outcome.deaths += 1
        if not worker.rendered and not worker.ready:
            self._dead_starts += 1
            if self._dead_starts >= MOST_DEAD_STARTS:
                raise WorkError(f"a worker does not start (code {code}): {worker.last_words()}; its log: {worker.log}")
        self._try_again(worker)

    def _try_again(self, worker: WorkerProcess) -> None:
        """At most two frames were in work, closed one and rendered one: those alone, so that the guilty one is found; the rest together."""
        suspects, rest = (worker.left[:2], worker.left[2:]) if worker.ready else ([], worker.left)
        alone = len(worker.left) == 1
        for number in suspects:
            self._tries[number] += alone or number == suspects[0]
        again = [(n,) for n in suspects if self._tries[n] < self._care.attempts]
        self._outcome.failed.update({n: worker.log for n in suspects if self._tries[n] >= self._care.attempts})
        self._todo.extendleft(reversed([Chunk(-1, frames) for frames in [*again, tuple(rest)] if frames]))

    def _dismiss(self, patience_s: float = 60.0) -> None:
        """All end after the frame in work."""
        for worker in self._workers:
            worker.ask_to_stop()
        end = time.monotonic() + patience_s
        while self._workers and time.monotonic() < end:
            self._hear(0.2)
