"""Measures the cells of an experiment on all cores, in forked processes with one thread each."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from iclnuim.errors import IclnuimError
from iclnuim.sequences.frame_pool import FramePool, cores

#: Advances a progress display by a number of steps.
Advance = Callable[[int], object]
_THREADS = ("NUMBA", "OMP", "OPENBLAS", "MKL", "IGL")


@dataclass(frozen=True, eq=False)
class Job:
    """Cells that are measured together, on the same frames. measure(advance) measures and stores
    them; steps: how often it advances.
    """

    name: str
    measure: Callable[[Advance], object]
    steps: int


def processes(bytes_each: int) -> int:
    """The number of processes for which there are cores and memory."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return cores()
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max(1, min(cores(), memory // bytes_each))


def run_jobs(
    jobs: Sequence[Job],
    workers: int,
    advance: Advance,
    on_problem: Callable[[str], object] | None = None,
) -> None:
    """Measure the jobs. With one worker they are measured in this process, which Ctrl-C ends at
    once.

    A job that fails does not end the others if there is on_problem(sentence); else its error is
    raised.
    """
    count = min(workers, len(jobs))
    if count > 1:
        _run_forked(jobs, count, advance, on_problem)
        return
    for job in jobs:
        _finish(_problem(job, advance, on_problem is not None), on_problem)


def compile_first(jobs: Sequence[Job], workers: int) -> None:
    """Measure a few frames in a process of its own, so that several workers find compiled code."""
    if workers > 1:
        _run_forked(jobs, 1, lambda steps: None, lambda problem: None)


def _problem(job: Job, advance: Advance, caught: bool) -> str:
    """Measure one job; returns why it failed, if such errors are to be caught."""
    left = job.steps

    def counted(steps: int) -> None:
        nonlocal left
        some = min(steps, left)
        left -= some
        advance(some)

    problem = ""
    try:
        job.measure(counted)
    except (IclnuimError, OSError) as error:
        if not caught:
            raise
        problem = f"{job.name} failed: {error}"
    counted(left)
    return problem


def _finish(problem: str, on_problem: Callable[[str], object] | None) -> None:
    if problem and on_problem:
        on_problem(problem)


def _run_forked(
    jobs: Sequence[Job],
    workers: int,
    advance: Advance,
    on_problem: Callable[[str], object] | None,
) -> None:
    """Steps come through a pipe, as a job may take many minutes."""
    one_thread()
    reads, writes = os.pipe()

    def report(steps: int) -> None:
        os.write(writes, bytes(min(steps, 4096)))

    def forward() -> None:
        while steps := len(os.read(reads, 65536)):
            advance(steps)

    forwarding = threading.Thread(target=forward, daemon=True)
    try:
        with (
            _interruptible(),
            FramePool(
                lambda k: _problem(jobs[k], report, on_problem is not None),
                workers,
                lambda problem: _finish(problem, on_problem),
            ) as pool,
        ):
            forwarding.start()
            for k in range(len(jobs)):
                pool.add(k)
    finally:
        os.close(writes)
        if forwarding.ident:
            forwarding.join()
        os.close(reads)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C kills the processes, whose jobs may take many minutes: no half cell is left."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def kill(number: int, frame: object) -> None:
        for process in multiprocessing.active_children():
            process.kill()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, kill)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def one_thread() -> None:
    """Limit libraries to one thread, as processes share the cores.

    Before they are forked: a fork would wait for threads of OpenCV that it does not have.
    """
    import cv2
    import numba

    for name in _THREADS:
        os.environ.setdefault(f"{name}_NUM_THREADS", "1")
    try:
        numba.core.config.reload_config()
    except RuntimeError:  # its threads run already, and it would refuse to compile
        del os.environ["NUMBA_NUM_THREADS"]
    cv2.setNumThreads(1)
