"""Sequences as a worker is told of them, in plain values: the same frames clean and noisy, folder by folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..geometry.trajectory import Trajectory
from ..sensor.models import depth_model, rgb_model
from .frames import frames_of_run
from .run_folder import RunFolder
from .sequence import SequenceSettings, SequenceWriter


def begin_variants(run: RunFolder, truth: Trajectory, numbers: Sequence[int], wanted: dict) -> SequenceWriter:
    """The writer of sequences of frames that may still have to be rendered; folders and recipes are made now.

    `wanted`: {"dialects": [...], "variants": {FOLDER: {"depth": model, "rgb": model, "seed": n}}}. Raises InputError, WorkError.
    """
    variants = {
        Path(folder): SequenceSettings(depth_model(v["depth"]), rgb_model(v["rgb"]), v["seed"])
        for folder, v in wanted["variants"].items()
    }
    return SequenceWriter(frames_of_run(run, truth, numbers), variants, wanted["dialects"])


def write_unless(writer: SequenceWriter, on_frame: Callable[[int], None], should_stop: Callable[[], bool]) -> bool:
    """Write them; False when stopped between two frames. What is written stays. Raises InputError, WorkError."""

    def written(number: int) -> None:
        on_frame(number)
        if should_stop():
            raise _StoppedError

    try:
        writer.write(on_frame=written)
    except _StoppedError:
        return False
    return True


class _StoppedError(Exception):
    """Leaves the writer between two frames."""
