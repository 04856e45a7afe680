"""The one registry of trajectory formats: recognised by name and content, read, and written where it makes sense."""

import os

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import pov, trajectory_file
from .columns import COLUMNS
from .files import atomic_write_text
from .trajectory_file import LoadedTrajectory, ReadAs, ReadOptions, Source, WriteOptions, check_writable

__all__ = ["FORMATS", "LoadedTrajectory", "ReadAs", "ReadOptions", "WriteOptions"]
__all__ += ["format_for_name", "read_trajectory", "trajectory_text", "write_trajectory"]

#: name -> format, in the order in which they are asked whether a file is theirs
FORMATS = {**pov.FORMATS, **{columns.name: columns.format for columns in COLUMNS}}


def read_trajectory(
    path: str | os.PathLike[str], format: str | None = None, *, rate_hz: float = FRAME_RATE_HZ, unit_m: float = 1.0
) -> LoadedTrajectory:
    """A right-handed trajectory of cv camera poses (camera to world, metres) and how the file was read.

    `format` is a name of FORMATS; without it name and content decide. `rate_hz` counts where a file numbers its frames,
    `unit_m` is the file's unit of length (0.01 for the office's POV-Ray files).

    Raises InputError, naming file and line, for what cannot be read.
    """
    options, source = ReadOptions(rate_hz, unit_m), Source(path)
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
    raise InputError(expected, path=source.path, line=source.first_line_number, found=found, hint="{from} FORMAT")


def format_for_name(path: str | os.PathLike[str]) -> str:
    """The format that a file to be written has by its name. Raises InputError where the name says nothing."""
    name = os.path.basename(os.fspath(path)).lower()
    for format, known in FORMATS.items():
        texts = (".txt", ".sh") if format == "pov-commands" else (".txt",)
        if name.endswith(known.endings) or (known.word and known.word in name and name.endswith(texts)):
            return format
    endings = ".tum, .txt, .csv, .kitti, .gt.freiburg or .gt.sim"
    found = os.path.splitext(name)[1] or "no ending"
    raise InputError(f"a name ending in {endings}", path=path, found=found, hint="{to} FORMAT")


def _known(format: str) -> trajectory_file.TrajectoryFormat:
    if format not in FORMATS:
        raise InputError(f"a trajectory format ({', '.join(FORMATS)})", found=format)
    return FORMATS[format]
