"""Measures on this machine: frames per hour by workers and threads, share of time lost to start-up,
and utilisation of the cores.
"""

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.headless.farm.chunks import own_cores
from iclnuim.headless.farm.rendering import LocalRun, open_run
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.job import RenderJob
from iclnuim.sequences.run_folder import load_trajectory


@dataclass(frozen=True)
class Throughput:
    """Result of one split.

    Start-up ends when every worker has its first frame; rate and busy share are measured after
    that.
    """

    name: str
    light: str
    workers: int
    threads: int
    frames: int
    startup_s: float
    wall_s: float
    frames_an_hour: float
    seconds_a_frame_a_worker: float
    busy_share: float
    startup_share: float


def splits(cores: list[int]) -> list[tuple[int, int]]:
    """(workers, threads) to measure: one worker with two threads, then all splits that use every
    core.
    """
    count = len(cores)
    alone = [(1, min(2, count))]
    whole = [(count // threads, threads) for threads in (count, 2, 1) if count % threads == 0]
    return list(dict.fromkeys(alone + whole))


def min_frames() -> int:
    """Number of frames with which every worker of every split gets chunks of two frames, so that
    frames finish while all workers are busy.
    """
    return 16 * len(own_cores())


def measure(job: RenderJob, workers: int, threads: int, frames: int) -> Throughput:
    """Render `frames` frames of the job, spread over its trajectory, into a folder that is removed.

    The light map must be in the cache.
    """
    own = own_cores()
    count = len(load_trajectory(job))
    cores = [own[k * threads : (k + 1) * threads] for k in range(workers)]
    numbers = tuple(k * count // frames for k in range(frames))
    with tempfile.TemporaryDirectory() as folder:
        plan = RunPlan(job, Path(folder) / "run", numbers)
        with open_run(plan, Console(quiet=True), lambda: False) as run:
            clock = _Clock(run, workers)
            run.render(numbers, clock.frame, cores=cores)
        return clock.result(job, workers, threads, frames)


class _Clock:
    """Called for every frame.

    Records time and processor time when all workers are busy for the first time, and at the last
    frame while they are.
    """

    def __init__(self, run: LocalRun, workers: int) -> None:
        self._run = run
        self._workers = workers
        self._count = 0
        self._begun = time.perf_counter()
        self._first: tuple[float, float, int] | None = None
        self._last: tuple[float, float, int] | None = None

    def frame(self, number: int) -> None:
        self._count += 1
        farm = self._run.farm
        workers = farm.workers if farm else []
        now = time.perf_counter(), sum(_cpu_seconds(w.client.pid) for w in workers), self._count
        if self._first is None and sum(w.rendered > 0 for w in workers) >= self._workers:
            self._first = now
        all_busy = len(workers) == self._workers and all(w.left for w in workers)
        if self._first is not None and all_busy:
            self._last = now  # only while all are busy, as the end of the run would lower the rate

    def result(self, job: RenderJob, workers: int, threads: int, frames: int) -> Throughput:
        wall_s = time.perf_counter() - self._begun
        first, last = self._first, self._last
        if first is None or last is None or last == first:
            expected = f"enough frames to keep {workers} workers busy at the same time"
            raise InputError(expected, found=frames, hint=f"--frames {3 * frames}")
        seconds, cpu_s, count = (b - a for a, b in zip(first, last, strict=True))
        rate = count / seconds
        return Throughput(
            name="baked" if job.light == "baked" else f"path traced, {job.samples} samples",
            light=job.light,
            workers=workers,
            threads=threads,
            frames=frames,
            startup_s=round(first[0] - self._begun, 3),
            wall_s=round(wall_s, 3),
            frames_an_hour=round(3600 * rate, 1),
            seconds_a_frame_a_worker=round(workers / rate, 4),
            busy_share=round(cpu_s / (seconds * workers * threads), 3),
            startup_share=round((first[0] - self._begun) / wall_s, 3),
        )


def _cpu_seconds(pid: int) -> float:
    """User and system time of a process so far; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except OSError:
        return 0.0


def measure_splits(job: RenderJob, frames: int, note: Callable[[str], None]) -> list[Throughput]:
    """Measure every split of this machine's cores."""
    found = []
    for split in splits(own_cores()):
        found.append(measure(job, *split, frames))
        note(row(found[-1]))
    return found


def row(r: Throughput) -> str:
    """The result as one line of text."""
    return (
        f"{r.name}: {r.workers} x {r.threads} threads: {r.frames_an_hour:8.0f} frames per hour, "
        f"cores {100 * r.busy_share:.0f} % busy, "
        f"start-up {r.startup_s:.1f} s ({100 * r.startup_share:.0f} % of {r.wall_s:.0f} s)"
    )
