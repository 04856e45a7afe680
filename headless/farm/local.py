"""The local farm: distributes the chunks of a plan to worker processes.

Crashed and hanging workers are replaced, and their frames are tried again.
"""

import queue
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from iclnuim.errors import IclnuimError, WorkError, named
from iclnuim.worker_events import ChunkDone, Event, Exited, Failed, FrameDone, Ready, WorkerClient

from .chunks import Chunk
from .run_plan import FarmSettings

#: The run ends after this number of consecutive workers that end before their first frame.
MAX_FAILED_STARTS = 3

Inbox = queue.SimpleQueue[tuple[WorkerClient, Event]]


class WorkerError(IclnuimError):
    """The error reported by a worker, with its message and exit code."""

    def __init__(self, failed: Failed) -> None:
        super().__init__(failed.template or failed.text)
        self.exit_code = 3 if failed.code is None else failed.code

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        return named(self.message, name_of)


def not_started(client: WorkerClient, code: int) -> WorkError:
    """The error for a worker that ended with exit code `code` before it was ready."""
    return WorkError(
        f"a worker failed to start (code {code}): {client.log_end()}; its log: {client.log}"
    )


@dataclass
class Outcome:
    """done: frames rendered in this run. failed: frames that were given up -> log of the worker.
    stopped: whether a stop was requested.
    deaths: number of workers that ended unexpectedly. black: frames that are entirely black ->
    likely cause.
    """

    done: set[int] = field(default_factory=set)
    failed: dict[int, Path] = field(default_factory=dict)
    stopped: bool = False
    deaths: int = 0
    black: dict[int, str] = field(default_factory=dict)


@dataclass(eq=False)
class Worker:
    """A worker process of the farm, and the remaining frames of its chunk.

    Times are those of time.monotonic().
    """

    client: WorkerClient
    cores: list[int]
    busy: bool = False
    left: list[int] = field(default_factory=list)
    rendered: int = 0
    ready: bool = False
    started_s: float = field(default_factory=time.monotonic)
    last_frame_s: float = 0.0

    def give(self, chunk: Chunk) -> None:
        """Give the worker a chunk to render."""
        self.busy, self.left, self.last_frame_s = True, list(chunk), time.monotonic()
        self.client.send({"frames": self.left})


class LocalFarm:
    """Renders chunks with one worker per set of cores. `start(cores, inbox)` starts a worker
    process.

    `on_frame(number)` is called once for each frame, `on_event(worker, event)` for all events of
    all workers. `first`: an idle worker that already runs on the first set of cores, and the inbox
    of its events.
    """

    def __init__(
        self,
        start: Callable[[list[int], Inbox], WorkerClient],
        cores: list[list[int]],
        on_frame: Callable[[int], None],
        on_event: Callable[[Worker, Event], None] = lambda worker, event: None,
        should_stop: Callable[[], bool] = lambda: False,
        settings: FarmSettings | None = None,
        first: tuple[WorkerClient, Inbox] | None = None,
    ) -> None:
        self._start, self._free, self._settings = start, list(cores), settings or FarmSettings()
        self._on_frame, self._on_event, self._should_stop = on_frame, on_event, should_stop
        self._inbox: Inbox = first[1] if first else queue.SimpleQueue()
        self._workers = {first[0]: Worker(first[0], self._free.pop(0))} if first else {}
        self._tries: Counter[int] = Counter()
        self._todo: deque[Chunk] = deque()
        self._failed_starts = 0
        self._outcome = Outcome()

    @property
    def workers(self) -> list[Worker]:
        """The running workers."""
        return list(self._workers.values())

    def run(self, chunks: list[Chunk]) -> Outcome:
        """Render until every frame is done or given up, or a stop is requested.

        Raises WorkerError, WorkError.
        """
        self._todo = deque(chunks)
        try:
            while not self._should_stop() and (self._todo or any(w.busy for w in self.workers)):
                self._assign()
                self._receive(0.2)
                self._kill_silent()
            self._outcome.stopped = self._should_stop()
            for worker in self.workers:  # all end after their current frame
                worker.client.stop()
            end = time.monotonic() + 60.0
            while self._workers and time.monotonic() < end:
                self._receive(0.2)
        finally:
            for worker in self.workers:
                worker.client.kill()
                worker.client.close()
        return self._outcome

    def _assign(self) -> None:
        """Give a chunk to every idle worker, and start a worker on every free set of cores while
        there is work.
        """
        for worker in self.workers:
            if self._todo and not worker.busy and not worker.client.asked_to_stop:
                worker.give(self._todo.popleft())
        while self._todo and self._free:
            cores = self._free.pop(0)
            worker = Worker(self._start(cores, self._inbox), cores)
            self._workers[worker.client] = worker
            worker.give(self._todo.popleft())

    def _receive(self, wait_s: float) -> None:
        try:
            client, event = self._inbox.get(timeout=wait_s)
            while True:
                self._handle(self._workers[client], event)
                client, event = self._inbox.get_nowait()
        except queue.Empty:
            pass

    def _handle(self, worker: Worker, event: Event) -> None:
        self._on_event(worker, event)
        match event:
            case Ready():
                worker.ready, worker.last_frame_s = True, time.monotonic()
            case FrameDone():
                if event.black is not None:
                    self._outcome.black[event.frame] = event.black
                worker.rendered += 1
                self._failed_starts = 0
                self._count(worker, event.frame)
            case ChunkDone():
                for number in list(
                    worker.left
                ):  # finished earlier, by a worker that ended before it could report this
                    self._count(worker, number)
                worker.busy = False
                if (
                    worker.rendered >= self._settings.max_frames
                    or (event.rss_mb or 0.0) > self._settings.max_mb
                ):
                    worker.client.stop()  # the next worker gets its cores when it has ended
            case Failed(bug=False):
                raise WorkerError(event)
            case Exited():
                self._replace(worker, event.code)

    def _count(self, worker: Worker, number: int) -> None:
        worker.left.remove(number)
        worker.last_frame_s = time.monotonic()
        self._outcome.done.add(number)
        self._on_frame(number)

    def _kill_silent(self) -> None:
        """Kill the workers whose timeout has passed."""
        settings = self._settings
        for worker in self.workers:
            timeout_s = settings.worker_timeout_s if worker.ready else settings.start_timeout_s
            since_frame_s = time.monotonic() - worker.last_frame_s if worker.ready else 0.0
            if worker.busy and (
                worker.client.silent_s > timeout_s or since_frame_s > settings.frame_timeout_s
            ):
                worker.client.kill()

    def _replace(self, worker: Worker, code: int) -> None:
        """Handle the end of a worker: free its cores, and queue its remaining frames again."""
        client = worker.client
        del self._workers[client]
        self._free.append(worker.cores)
        clean = client.asked_to_stop and not worker.left
        client.close(keep_log=not clean)
        if clean or self._outcome.stopped:
            return
        self._outcome.deaths += 1
        if not worker.rendered and not worker.ready:
            self._failed_starts += 1
            if self._failed_starts >= MAX_FAILED_STARTS:
                raise not_started(client, code)
        # at most two frames were in work (one rendered, one closed): each is tried alone to find
        # the cause; the rest stays together
        suspects, rest = (worker.left[:2], worker.left[2:]) if worker.ready else ([], worker.left)
        alone, attempts = len(worker.left) == 1, self._settings.attempts
        for number in suspects:
            self._tries[number] += alone or number == suspects[0]
        again = [(n,) for n in suspects if self._tries[n] < attempts]
        self._outcome.failed.update({n: client.log for n in suspects if self._tries[n] >= attempts})
        self._todo.extendleft(reversed([frames for frames in [*again, tuple(rest)] if frames]))
