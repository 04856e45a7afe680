"""The one registry of trajectory formats: told apart by name and content, read, and written where it makes sense."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import euroc, freiburg, matrix_rows, pov_cameras, pov_commands, sim, tum
from .files import atomic_write_text
from .loaded import LoadedTrajectory, ReadOptions, Source, Taken
from .written import WriteOptions, check_writable

__all__ = [
    "FORMATS",
    "LoadedTrajectory",
    "ReadOptions",
    "Taken",
    "WriteOptions",
    "format_for_name",
    "read_trajectory",
    "trajectory_text",
    "write_trajectory",
]


@dataclass(frozen=True)
class Format:
    """One format: whether a file is of it (by name and content), how it is read, how it is written (None: not)."""

    sniff: Callable[[Source], bool]
    read: Callable[[Source, ReadOptions], LoadedTrajectory]
    write: Callable[[Trajectory, WriteOptions], str] | None = None
    goes_to: str = ""


def _only_when_told(source: Source) -> bool:
    return False


#: name -> format, in the order in which they are asked whether a file is theirs
FORMATS = {
    "pov-cameras": Format(pov_cameras.sniff, pov_cameras.read),
    "gt.freiburg": Format(freiburg.sniff, freiburg.read, freiburg.write, freiburg.GOES_TO),
    "gt.sim": Format(sim.sniff, sim.read, sim.write, sim.GOES_TO),
    "pov-commands": Format(pov_commands.sniff, pov_commands.read, pov_commands.write, pov_commands.GOES_TO),
    "euroc": Format(euroc.sniff, euroc.read, euroc.write, euroc.GOES_TO),
    "pov-matrix": Format(matrix_rows.sniff_pov, matrix_rows.read_pov, matrix_rows.write_pov, matrix_rows.GOES_TO_POV),
    "kitti": Format(
        matrix_rows.sniff_kitti, matrix_rows.read_kitti, matrix_rows.write_kitti, matrix_rows.GOES_TO_KITTI
    ),
    "tum": Format(tum.sniff, tum.read, tum.write, tum.GOES_TO),
    "tum-ids": Format(_only_when_told, tum.read_ids),
}


def read_trajectory(
    path: str | os.PathLike[str], format: str | None = None, *, rate_hz: float = FRAME_RATE_HZ, unit_m: float = 1.0
) -> LoadedTrajectory:
    """A right-handed trajectory of cv camera poses (camera to world, metres) and how the file was taken.

    `format` is a name of FORMATS; without it name and content decide. `rate_hz` counts where a file numbers its frames,
    `unit_m` is the file's unit of length (0.01 for the office's POV-Ray files).

    Raises InputError, naming file and line, for what cannot be read.
    """
    options = ReadOptions(rate_hz, unit_m)
    source = Source(path)
    return _known(format or sniffed(source)).read(source, options)


def write_trajectory(
    path: str | os.PathLike[str], trajectory: Trajectory, format: str, options: WriteOptions | None = None
) -> None:
    """Write a trajectory file, whole or not at all. Raises InputError where the format cannot hold the trajectory."""
    atomic_write_text(path, trajectory_text(trajectory, format, options))


def trajectory_text(trajectory: Trajectory, format: str, options: WriteOptions | None = None) -> str:
    """The text that write_trajectory writes."""
    write = _known(format).write
    if write is None:
        writable = ", ".join(name for name, known in FORMATS.items() if known.write)
        raise InputError(f"a format that can be written ({writable})", found=format)
    check_writable(trajectory)
    return write(trajectory, options or WriteOptions())


def sniffed(source: Source) -> str:
    """The name of the format that a file or folder is in. Raises InputError where it is in none."""
    for name, format in FORMATS.items():
        if format.sniff(source):
            return name
    expected = (
        "a trajectory: 8 columns (TUM), 12 or 13 (matrix rows), blocks of 3 lines with 4, POV-Ray commands or CSV"
    )
    if not source.columns:
        raise InputError(expected, path=source.path, found="comments alone")
    found = f"{source.columns} columns"
    raise InputError(expected, path=source.path, line=source.first_line_number, found=found, hint="--from FORMAT")


def format_for_name(path: str | os.PathLike[str]) -> str:
    """The format that a file to be written has by its name. Raises InputError where the name says nothing."""
    name = os.path.basename(os.fspath(path)).lower()
    endings = {".gt.freiburg": "gt.freiburg", ".gt.sim": "gt.sim", ".csv": "euroc", ".kitti": "kitti", ".tum": "tum"}
    for ending, format in endings.items():
        if name.endswith(ending):
            return format
    if name.endswith((".txt", ".sh")) and "command" in name:
        return "pov-commands"
    if name.endswith(".txt"):
        return "pov-matrix" if "pov" in name else "kitti" if "kitti" in name else "tum"
    expected = "a name ending in .tum, .txt, .csv, .kitti, .gt.freiburg or .gt.sim"
    raise InputError(expected, path=path, found=os.path.splitext(name)[1] or "no ending", hint="--to FORMAT")


def _known(format: str) -> Format:
    if format not in FORMATS:
        raise InputError(f"a trajectory format ({', '.join(FORMATS)})", found=format)
    return FORMATS[format]
