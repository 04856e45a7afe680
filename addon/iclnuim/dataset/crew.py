"""The same work done for many frames on all cores: in forked processes where that is safe, in threads elsewhere.

Threads share Python's lock and take it between any two array operations: four make noise no faster than one, four
processes make it four times as fast.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ..errors import WorkError

_PR_SET_PDEATHSIG = 1


class Crew:
    """`with Crew(work, workers) as crew: crew.submit(number)` -> the Future of `work(number)`.

    `work` is what it was when the crew began: processes do not see later changes of its objects, and what it returns is
    pickled. They end with the process that began them, whatever ends that. `result_of(future)` raises what the work raised.
    """

    def __init__(self, work: Callable[[int], Any], workers: int) -> None:
        self._pool = _processes(work, workers) if _can_fork() else ThreadPoolExecutor(workers)
        self._work = _assigned if isinstance(self._pool, ProcessPoolExecutor) else work

    def submit(self, number: int) -> Future:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside the threads of numpy's own library
            return self._pool.submit(self._work, number)

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown(wait=True)


def result_of(done: Future) -> Any:
    """What the work returned. Raises what it raised, WorkError where its process was killed."""
    try:
        return done.result()
    except BrokenProcessPool:
        reason = "a process that made images was killed, or memory ran out"
        raise WorkError(f"{reason}; finished frames stay: run the same command again") from None


def _can_fork() -> bool:
    """Not with other threads about, whose locks a fork would copy as they are, and not with Blender's in the process."""
    return sys.platform == "linux" and "bpy" not in sys.modules and threading.active_count() == 1


def _processes(work: Callable[[int], Any], workers: int) -> Executor:
    context = multiprocessing.get_context("fork")
    return ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(work, os.getpid()))


def _begin(work: Callable[[int], Any], parent: int) -> None:
    """In a new process: Ctrl-C is the parent's to hear, and its end is ours."""
    global _work
    _work = work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(130)


def _assigned(number: int) -> Any:
    return _work(number)


_work: Callable[[int], Any]
