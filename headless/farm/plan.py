"""The plan of a farm: frames still missing -> chunks. Pure data; the truth of what is done is the output folder alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

from iclnuim.dataset.run_folder import RunFolder
from iclnuim.errors import InputError


@dataclass(frozen=True)
class Chunk:
    """Frames that one worker renders in one go. `number` counts from 0 within its plan."""

    number: int
    frames: tuple[int, ...]

    def to_json(self) -> str:
        """The command line of a worker for this chunk (addon/iclnuim/blender/child.py)."""
        return json.dumps({"frames": self.frames})


def chunks_of(frames: Sequence[int], size: int) -> list[Chunk]:
    """Chunks of at most `size` frames, in the order given, as even as they can be. No frames, no chunks."""
    if size < 1:
        raise InputError("chunks of at least 1 frame", found=size)
    count = ceil(len(frames) / size)
    bounds = [len(frames) * k // count for k in range(count + 1)] if count else [0]
    return [Chunk(k, tuple(frames[a:b])) for k, (a, b) in enumerate(zip(bounds, bounds[1:], strict=False))]


def missing_chunks(run: RunFolder, numbers: Sequence[int], size: int) -> list[Chunk]:
    """What is still to be rendered of `numbers`: every frame file is read back before it counts as done."""
    return chunks_of(run.missing(numbers), size)


def size_for_seconds(seconds: float, seconds_a_frame: float, most: int = 100_000) -> int:
    """Frames that fill `seconds`: chunks of several minutes on a cluster, where starting a worker costs half a minute."""
    if seconds <= 0 or seconds_a_frame <= 0:
        raise InputError("times above 0 s", found=f"{seconds} s, {seconds_a_frame} s a frame")
    return max(1, min(most, round(seconds / seconds_a_frame)))


def local_size(frames: int, workers: int, most: int = 25) -> int:
    """Chunk size on one machine: small enough that all workers end together, at least eight chunks for each."""
    return max(1, min(most, frames // (8 * max(1, workers))))
