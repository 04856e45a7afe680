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
from iclnuim.worker_client import WorkerClient
from iclnuim.worker_events import ChunkDone, Event, Exited, Failed, FrameDone, Ready

from .chunks import Chunk
from .run_plan import FarmSettings

#: The run ends after this number of consecutive workers that end before their first frame.
MAX_FAILED_STARTS = 3

Inbox = queue.SimpleQueue[tuple[WorkerClient, Event]]


class WorkerError(IclnuimError):
    """The error reported by a worker, with its message and exit code."""

    def __init__(self, failed: Failed) -> None:
        super().__init__(failed.template or failed.text)
        if failed.code is not None:
            self.exit_code = failed.code

    def worded(self, name_of: Callable[[str], str] = str) -> str:
        return named(self.message, name_of)


def not_started(client: WorkerClient, code: int) -> WorkError:
    """The error for a worker that ended with exit code `code` before it was ready."""
    return WorkError(
        f"a worker failed to start (code {code}): {client.log_end()}; its log: {client.log}"
    )


@dataclass
class RenderOutcome:
    """done: frames rendered in this run. failed: frames that were given up -> log of the worker.
    stopped: whether a stop was requested. deaths: number of workers that ended unexpectedly.
    black: frames that are entirely black -> likely cause.
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
        self.busy = True
        self.left = list(chunk)
        self.last_frame_s = time.monotonic()
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
        self._start = start
        self._free = list(cores)
        self._on_frame = on_frame
        self._on_event = on_event
        self._should_stop = should_stop
        self._settings = settings or FarmSettings()
        self._inbox: Inbox = queue.SimpleQueue()
        self._workers: dict[WorkerClient, Worker] = {}
        if first:
            client, self._inbox = first
            self._workers[client] = Worker(client, self._free.pop(0))
        self._tries: Counter[int] = Counter()
        self._todo: deque[Chunk] = deque()
        self._failed_starts = 0
        self._outcome = RenderOutcome()

    @property
    def workers(self) -> list[Worker]:
        """The running workers."""
        return list(self._workers.values())

    def run(self, chunks: list[Chunk]) -> RenderOutcome:
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
                worker.ready = True
                worker.last_frame_s = time.monotonic()
            case FrameDone():
                if event.black is not None:
                    self._outcome.black[event.frame] = event.black
                worker.rendered += 1
                self._failed_starts = 0
                self._count(worker, event.frame)
            case ChunkDone():
                # what is left was finished by a worker that ended before it could report this
                for number in list(worker.left):
                    self._count(worker, number)
                worker.busy = False
                worn_out = worker.rendered >= self._settings.max_frames
                if worn_out or (event.rss_mb or 0.0) > self._settings.max_mb:
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
            timeout_s = settings.start_timeout_s
            hangs = False
            if worker.ready:
                timeout_s = settings.worker_timeout_s
                hangs = time.monotonic() - worker.last_frame_s > settings.frame_timeout_s
            if worker.busy and (hangs or worker.client.silent_s > timeout_s):
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
        self._try_again(worker)

    def _try_again(self, worker: Worker) -> None:
        """Queue the remaining frames of a worker that ended.

        At most two frames were in work (one rendered, one closed): each is tried alone to find the
        cause, and given up after some attempts; the rest stays together.
        """
        in_work = 2 if worker.ready else 0
        suspects = worker.left[:in_work]
        again = [tuple(worker.left[in_work:])]
        for number in reversed(suspects):
            if number == suspects[0]:
                self._tries[number] += 1
            if self._tries[number] < self._settings.attempts:
                again.insert(0, (number,))
            else:
                self._outcome.failed[number] = worker.client.log
        self._todo.extendleft(frames for frames in reversed(again) if frames)
