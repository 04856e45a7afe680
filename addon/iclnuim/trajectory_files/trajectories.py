"""Reading and writing trajectory files of any format."""

import os

from ..errors import InputError, StrPath
from ..formats.files import atomic_write_text
from ..geometry.se3 import Poses
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import colmap
from . import formats as trajectory_formats
from .anchored import ANCHORED_WORLD
from .formats import FORMATS, TrajectoryFormat
from .sniffing import sniffed
from .source import FileOptions, LoadedTrajectory, ReadAs
from .writer import TrajectoryWriter

__all__ = ["ANCHORED_WORLD", "FORMATS", "TUM_HEADER", "FileOptions", "LoadedTrajectory", "ReadAs"]
__all__ += [
    "format_for_name",
    "read_trajectory",
    "trajectory_text",
    "write_trajectory",
    "writer_of",
]

TUM_HEADER = trajectory_formats.TUM_HEADER.format(unit="metres")


def read_trajectory(
    path: StrPath,
    format: str | None = None,
    *,
    rate_hz: float = FRAME_RATE_HZ,
    unit_m: float = 1.0,
    positions_suffice: bool = False,
) -> LoadedTrajectory:
    """Read a right-handed trajectory of cv camera poses (camera to world, metres), and how the file
    was read.

    `format` is a name of FORMATS; without it, the format is detected by name and content. `rate_hz`
    is used if a file has frame numbers. `unit_m` is the file's unit of length in metres (0.01 for
    the office's POV-Ray files). `positions_suffice`: also read a file without rotations, whose
    rotations are then the identity.

    Raises InputError with file and line for a file that cannot be read.
    """
    options = FileOptions(rate_hz, unit_m)
    source = colmap.source_of(path)
    format = format or sniffed(source)
    loaded = _known(format).reader.read(format, source, options)
    if not (loaded.read_as.has_rotations or positions_suffice):
        angles = "quaternions instead of angles" if "yaw" in loaded.read_as.sentence else None
        raise InputError("poses with rotations", path=path, found="positions alone", hint=angles)
    return loaded


def write_trajectory(
    path: StrPath,
    trajectory: Trajectory | Poses,
    format: str,
    options: FileOptions | None = None,
) -> None:
    """Write a trajectory file atomically, also of poses or matrices (n, 4, 4) at 30 Hz, the first
    at 1 s.

    Raises InputError if the format cannot represent the trajectory.
    """
    atomic_write_text(path, trajectory_text(Trajectory.of(trajectory), format, options))


def trajectory_text(trajectory: Trajectory, format: str, options: FileOptions | None = None) -> str:
    """The text that write_trajectory writes."""
    return writer_of(format).text(trajectory, options or FileOptions())


def writer_of(format: str) -> TrajectoryWriter:
    """The writer of a format. Raises InputError if the format is unknown or only read."""
    writer = _known(format).writer
    if writer is None:
        writable = ", ".join(name for name, known in FORMATS.items() if known.writer)
        raise InputError(f"a format that can be written ({writable})", found=format)
    return writer


def format_for_name(path: StrPath) -> str:
    """The format of a file to be written, by its name.

    Raises InputError if no format has such names.
    """
    name = os.path.basename(os.fspath(path)).lower()
    for format, known in FORMATS.items():
        if known.writer and known.writer.is_meant_by(name):
            return format
    expected = "a name ending in .tum, .txt, .csv, .kitti, .gt.freiburg or .gt.sim"
    found = os.path.splitext(name)[1] or "no ending"
    raise InputError(expected, path=path, found=found, hint="{to} FORMAT")


def _known(format: str) -> TrajectoryFormat:
    if format not in FORMATS:
        raise InputError(f"a trajectory format ({', '.join(FORMATS)})", found=format)
    return FORMATS[format]
