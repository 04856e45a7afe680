"""The same work done for many frames on all cores: in forked processes where that is safe, in threads elsewhere.

Threads share Python's lock and take it between any two array operations: four make noise no faster than one, four
processes make it four times as fast.
"""

import contextlib
import ctypes
import multiprocessing
import os
import queue
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from ..errors import IclnuimError, WorkError

_PR_SET_PDEATHSIG = 1


class FramePool:
    """`with FramePool(...) as pool:` `add(number)` frames at any time, `close()` when all are in: `work(number)` runs beside the caller, `finish(result)` on the
    caller's own thread, inside of these calls.

    The first error, of the work or of `finish`, ends it: frames in work are finished, those not begun are dropped, `close` raises it.
    With processes `work` is what it was when the pool was made, and what it returns is pickled; they end with the process that made
    them, whatever ends that.
    """

    def __init__(self, work: Callable[[int], Any], workers: int, finish: Callable[[Any], object]) -> None:
        self._processes = _Processes(work, workers) if _can_fork() else None
        self._work = work if self._processes is None else self._processes.do
        self._finish = finish
        self._threads = ThreadPoolExecutor(workers)
        self._done: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._open: set[Future] = set()
        self.stopped = False  # whether an error or `stop` has ended it
        self._error: BaseException | None = None

    def __enter__(self) -> "FramePool":
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if kind is not None:
            self.stop()
        self.close()

    def add(self, number: int) -> None:
        """Begin a frame; finish those that are done."""
        if not self.stopped:
            future = self._threads.submit(self._work, number)
            self._open.add(future)
            future.add_done_callback(self._done.put)
        self.collect()

    def collect(self) -> None:
        """Finish the frames that are done, without waiting for others."""
        while not self._done.empty():
            self._take()

    @property
    def failed(self) -> bool:
        """Whether an error has ended it."""
        return self._error is not None

    def stop(self) -> None:
        """Drop the frames that were not begun."""
        self.stopped = True
        for future in list(self._open):
            future.cancel()

    def close(self) -> None:
        """Wait for all frames. Raises the first error. Safe to call twice."""
        while self._open:
            self._take()
        self._threads.shutdown()
        if self._processes is not None:
            self._processes.close()
        if self._error is not None:
            raise self._error

    def _take(self) -> None:
        try:
            future = self._done.get()
            self._open.discard(future)
            if not future.cancelled():
                self._finish(future.result())
        except BaseException as error:  # Ctrl-C too: what is in work is finished first
            self._error = self._error or error
            self.stop()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _can_fork() -> bool:
    """Not with other threads about, whose locks a fork would copy as they are, and not with Blender's in the process."""
    return sys.platform == "linux" and "bpy" not in sys.modules and threading.active_count() == 1


class _Processes:
    """Forked processes that do the same work; `do(number)` waits for one that is idle and for its result, on any thread."""

    def __init__(self, work: Callable[[int], Any], count: int) -> None:
        context = multiprocessing.get_context("fork")
        self._idle: queue.SimpleQueue[Connection] = queue.SimpleQueue()
        self._all: list[tuple[multiprocessing.process.BaseProcess, Connection]] = []
        for _ in range(count):
            ours, theirs = context.Pipe()
            process = context.Process(target=_serve, args=(work, theirs, os.getpid()), daemon=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # a fork beside threads of numpy's own library
                process.start()
            theirs.close()
            self._idle.put(ours)
            self._all.append((process, ours))

    def do(self, number: int) -> Any:
        """Raises what the work raised, WorkError where its process was killed."""
        pipe = self._idle.get()
        answer = None
        with contextlib.suppress(
            EOFError, OSError
        ):  # killed; raised below, for an error kept beside another keeps its half-sent message
            pipe.send(number)
            answer = pipe.recv()
        self._idle.put(pipe)
        if answer is None:
            reason = "a process that made images was killed, or memory ran out"
            raise WorkError(f"{reason}; finished frames stay: run the same command again")
        result, error = answer
        if error is not None:
            raise error
        return result

    def close(self) -> None:
        for process, pipe in self._all:
            pipe.close()
            process.terminate()
            process.join()


def _serve(work: Callable[[int], Any], pipe: Connection, parent: int) -> None:
    """In a new process: Ctrl-C is the parent's to hear, and its end is ours."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(130)
    while True:
        number = pipe.recv()
        answer: tuple[Any, Exception | None]
        try:
            answer = (work(number), None)
        except IclnuimError as error:
            answer = (None, error)
        except Exception as error:
            answer = (None, RuntimeError(f"{error!r}\n{traceback.format_exc()}"))
        pipe.send(answer)
