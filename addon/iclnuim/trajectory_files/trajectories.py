"""Reading and writing trajectory files of any format."""

import os
from collections.abc import Sequence

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import atomic_write_text
from ..geometry.axes import world_cv_from_pov
from ..geometry.se3 import SE3, Poses
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from ..shipped import file_or_trajectory
from . import colmap
from . import formats as trajectory_formats
from .formats import FORMATS, TrajectoryFormat
from .icl_nuim import ANCHORED_WORLD, camera_axes
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

Vector = np.ndarray | Sequence[float]

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
    was read. Where there is no such file, `path` may be the name of a built-in trajectory, such as
    `living_room/kt2`.

    `format` is a name of FORMATS; without it, the format is detected by name and content. `rate_hz`
    is used if a file has frame numbers. `unit_m` is the file's unit of length in metres (0.01 for
    the office's POV-Ray files). `positions_suffice`: also read a file without rotations, whose
    rotations are then the identity.

    Raises InputError with file and line for a file that cannot be read.
    """
    options = FileOptions(rate_hz, unit_m)
    path = file_or_trajectory(path)
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
        hint = {"nerf": "convert_sequence", "colmap": "convert_sequence"}.get(format, "")
        raise InputError(f"a format that can be written ({writable})", found=format, hint=hint)
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


def pose_from_pov(
    camera: StrPath | Vector,
    direction: Vector | None = None,
    up: Vector = (0.0, 1.0, 0.0),
    unit_m: float = 1.0,
) -> SE3:
    """The pose, in our world and of the cv camera, of a POV-Ray camera file of ICL-NUIM with
    cam_pos, cam_dir and cam_up, or of the three vectors (3,) themselves, in the left-handed POV
    world, y up.

    unit_m: the unit of the position in metres (1 in the living room, 0.01 in the office). Raises
    InputError for anything else.
    """
    if isinstance(camera, str | os.PathLike):
        if direction is not None:
            raise InputError("a file without a direction, which it contains", found=str(camera))
        loaded = read_trajectory(camera, "pov-cameras", unit_m=unit_m).trajectory
        if len(loaded) != 1:
            hint = "one of its files, or iclnuim.read_trajectory"
            raise InputError("one camera", path=camera, found=f"{len(loaded)}", hint=hint)
        return loaded.T_world_camera[0]
    if direction is None:
        raise InputError("a position with a direction", found="no direction")
    position, ahead, upwards = (_vector(given) for given in (camera, direction, up))
    rotation = camera_axes(ahead, upwards).T
    return world_cv_from_pov(SE3(rotation, unit_m * position))


def _vector(given: Vector) -> np.ndarray:
    vector = np.asarray(given)
    if vector.shape != (3,) or vector.dtype.kind not in "iuf" or not np.isfinite(vector).all():
        raise InputError("a vector of three finite numbers", found=given)
    return vector.astype(float)
