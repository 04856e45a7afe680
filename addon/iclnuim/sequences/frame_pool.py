"""A worker pool that processes frames on all cores: in forked processes where that is safe, else in
threads.

Threads need Python's global lock between array operations: four threads compute noise no faster
than one, four processes four times as fast.
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
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextvars import ContextVar
from typing import Any

import numpy as np

from ..errors import IclnuimError, WorkError

_PR_SET_PDEATHSIG = 1
#: In a forked process: the function called for each frame. It is inherited by the fork and need not
#: be pickled.
_WORK: ContextVar[Callable[[int], Any]] = ContextVar("work")


class FramePool:
    """`with FramePool(...) as pool:` call `add(number)` for frames at any time, and `close()` after
    the last one. `work(number)` runs in the pool, `finish(result)` in the caller's thread, inside
    `add`, `collect` and `close`.

    The first error of `work` or `finish` stops the pool: frames in progress are finished, those not
    started are dropped, and `close` raises the error. Processes use `work` in the state it had when
    the pool was made, and its results are pickled. They end when the process that made them ends,
    for any reason.
    """

    def __init__(
        self, work: Callable[[int], Any], workers: int, finish: Callable[[Any], object]
    ) -> None:
        self._work = work
        self._executor: Executor = ThreadPoolExecutor(workers)
        if _can_fork():
            self._executor = _forked(work, workers)
            self._work = _in_fork
        self._finish = finish
        self._done: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._open: set[Future] = set()
        self.stopped = False  # whether an error or `stop` has stopped the pool
        self._error: BaseException | None = None

    def __enter__(self) -> "FramePool":
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if kind is not None:
            self.stop()
        self.close()

    def add(self, number: int) -> None:
        """Start a frame, and finish those that are done."""
        with self._ending():
            if not self.stopped:
                future = self._executor.submit(self._work, number)
                self._open.add(future)
                future.add_done_callback(self._done.put)
        self.collect()

    def collect(self) -> None:
        """Finish the frames that are done, without waiting for the others."""
        while not self._done.empty():
            self._take()

    @property
    def failed(self) -> bool:
        """Whether an error has stopped the pool."""
        return self._error is not None

    def stop(self) -> None:
        """Drop the frames that were not started."""
        self.stopped = True
        for future in list(self._open):
            future.cancel()

    def close(self) -> None:
        """Wait for all frames. Raises the first error. It may be called twice."""
        while self._open:
            self._take()
        self._executor.shutdown()
        if self._error is not None:
            raise self._error

    def _take(self) -> None:
        with self._ending():
            future = self._done.get()
            self._open.discard(future)
            if not future.cancelled():
                self._finish(future.result())

    @contextlib.contextmanager
    def _ending(self) -> Iterator[None]:
        """Stop the pool after an error or Ctrl-C; frames in progress are finished."""
        try:
            yield
        except BaseException as error:
            if isinstance(error, BrokenProcessPool):
                reason = "a worker process of the frame pool was killed, or memory ran out"
                error = WorkError(f"{reason}; finished frames stay: run the same command again")
            self._error = self._error or error
            self.stop()


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next array. After a large block was freed, glibc does
    not return freed blocks up to that size to the system, so they need not be requested again page
    by page: noise takes two thirds of the time. No effect with other C libraries.
    """
    np.empty(30 << 20, np.uint8)


def _can_fork() -> bool:
    """Whether a fork is safe: on Linux, without other threads, whose locks a fork would copy in
    their current state, and without Blender.
    """
    return sys.platform == "linux" and "bpy" not in sys.modules and threading.active_count() == 1


def _forked(work: Callable[[int], Any], workers: int) -> Executor:
    context = multiprocessing.get_context("fork")
    executor = ProcessPoolExecutor(workers, context, _begin, (work, os.getpid()))
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # numpy's library may have started threads
        executor.submit(os.getpid)  # this starts all processes now, while there is no other thread
    return executor


def _begin(work: Callable[[int], Any], parent: int) -> None:
    """Initialise a forked process: it ignores Ctrl-C, which the parent handles, and it ends when
    the parent ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(130)
    _WORK.set(work)


def _in_fork(number: int) -> Any:
    """Call the work in a forked process.

    An error that may not be picklable is raised as RuntimeError with its text.
    """
    try:
        return _WORK.get()(number)
    except IclnuimError:
        raise
    except Exception as error:
        raise RuntimeError(f"{error!r}\n{traceback.format_exc()}") from None
