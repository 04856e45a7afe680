"""Divides a run: missing frames into chunks, and the cores of a machine among workers.

Only the output folder decides what is finished.
"""

import os
import re
from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise
from math import ceil
from typing import TypeVar

from iclnuim.errors import InputError

T = TypeVar("T")
#: Frames that are given to a worker together.
Chunk = tuple[int, ...]


def chunks_of(frames: Sequence[T], size: int) -> list[tuple[T, ...]]:
    """Chunks of at most `size` frames (or other items), in the given order and as even as possible.

    No frames give no chunks.
    """
    if size < 1:
        raise InputError("chunks of at least 1 frame", found=size)
    if not frames:
        return []
    count = ceil(len(frames) / size)
    bounds = [len(frames) * k // count for k in range(count + 1)]
    return [tuple(frames[a:b]) for a, b in pairwise(bounds)]


def size_for_seconds(seconds: float, seconds_a_frame: float) -> int:
    """Number of frames that take `seconds`.

    On a cluster, chunks take several minutes, as starting a worker costs half a minute.
    """
    if seconds <= 0 or seconds_a_frame <= 0:
        raise InputError("times above 0 s", found=f"{seconds} s, {seconds_a_frame} s per frame")
    return max(1, min(100_000, round(seconds / seconds_a_frame)))


def local_size(frames: int, workers: int) -> int:
    """Chunk size on one machine: with several workers, each gets at least eight chunks, so that all
    end at a similar time.

    At its end, a chunk waits until its last frame is closed, so a single worker gets long ones.
    """
    share = frames if workers == 1 else frames // (8 * workers)
    return max(1, min(25, share))


def split(workers: int | None = None, cores: list[int] | None = None) -> list[list[int]]:
    """The cores of each worker. Without a number of workers, each has two cores (`iclnuim bench
    farm` measures this).

    A worker never has a single core, on which it would busy-wait: with more workers than pairs of
    cores, two workers share a pair. There are no more of them than that.
    """
    if cores is None:
        cores = own_cores()
    pairs = max(1, len(cores) // 2)
    workers = min(workers or pairs, 2 * pairs)
    sets = min(workers, pairs)
    shares = [cores[len(cores) * k // sets : len(cores) * (k + 1) // sets] for k in range(sets)]
    return [shares[k % sets] for k in range(workers)]


def own_cores() -> list[int]:
    """The cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def granted_cores() -> list[int]:
    """The cores of a scheduler's task: as many as were granted of all that it may use."""
    own = own_cores()
    return own[: int(os.environ.get("SLURM_CPUS_PER_TASK") or len(own))]


def numbers_from(text: str) -> tuple[int, ...]:
    """Frame numbers of `0-24,30`, both ends included, in order. Raises InputError."""
    numbers: set[int] = set()
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if found is None:
            raise InputError("frame numbers such as 0-24,30", setting="numbers", found=text)
        numbers.update(range(int(found[1]), int(found[2] or found[1]) + 1))
    return tuple(sorted(numbers))


def numbers_text(numbers: Iterable[int]) -> str:
    """The shortest text from which numbers_from returns these numbers."""
    in_a_row = groupby(enumerate(sorted(numbers)), lambda pair: pair[1] - pair[0])
    parts = []
    for _, row in in_a_row:
        first, *rest = (number for _, number in row)
        parts.append(f"{first}-{rest[-1]}" if rest else f"{first}")
    return ",".join(parts)
