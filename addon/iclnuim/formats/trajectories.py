"""The one registry of trajectory formats: told apart by name and content, read, and written where it makes sense."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import tum
from .files import atomic_write_text
from .loaded import LoadedTrajectory, ReadOptions, Source, Taken

__all__ = ["FORMATS", "LoadedTrajectory", "Taken", "read_trajectory", "write_trajectory"]


@dataclass(frozen=True)
class Format:
    """One format: whether a file is of it (by name and content), how it is read, how it is written (None: not at all)."""

    sniff: Callable[[Source], bool]
    read: Callable[[Source, ReadOptions], LoadedTrajectory]
    write: Callable[[Trajectory], str] | None


#: name -> format, in the order in which they are asked whether a file is theirs
FORMATS = {
    "tum": Format(lambda source: len(source.first_line.split()) == 8, tum.read, tum.write),
    "tum-ids": Format(lambda source: False, tum.read_ids, None),
}


def read_trajectory(
    path: str | os.PathLike[str], format: str | None = None, *, rate_hz: float = FRAME_RATE_HZ, unit_m: float = 1.0
) -> LoadedTrajectory:
    """A right-handed trajectory of cv camera poses (camera to world, metres) and how the file was taken.

    `format` is a name of FORMATS; without it name and content decide. `rate_hz` counts where a file has frame numbers or no
    stamps, `unit_m` is the file's unit of length (0.01 for the office's POV-Ray files). Raises InputError for whatever cannot be read.
    """
    source = Source(path)
    return FORMATS[format or sniffed(source)].read(source, ReadOptions(rate_hz, unit_m))


def write_trajectory(path: str | os.PathLike[str], trajectory: Trajectory, format: str) -> None:
    """Write a trajectory file, whole or not at all."""
    atomic_write_text(path, FORMATS[format].write(trajectory))


def sniffed(source: Source) -> str:
    """The name of the format that a file is in. Raises InputError where it is in none."""
    for name, format in FORMATS.items():
        if format.sniff(source):
            return name
    raise InputError("a trajectory", path=source.path, found=source.first_line)
