"""ICL-NUIM's `*.gt.freiburg`: `id tx ty tz qx qy qz qw`, frame numbers, LEFT-handed (y up), anchored at image 1.

T(i) = [I, (0, 0, -2.25)] T_pov(1)^-1 T_pov(i); the office starts at (0, 0, -2.5). Image 0 has no pose.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .checks import poses_of_quaternions, trajectory_of_frames
from .loaded import LoadedTrajectory, ReadOptions, Source, Taken
from .table import read_table
from .tum import pose_columns
from .written import WriteOptions, frame_numbers

COLUMNS = "8 columns: id tx ty tz qx qy qz qw"
ANCHORED_WORLD = "the original's anchored frame made right-handed (the first camera's axes: x right, y down, z forward)"
GOES_TO = "gt.freiburg: frame ids, LEFT-handed y-up poses, moved to the original's start, image 0 left out"
#: Where the official files start: living room, office. Office kt0, whose first image is missing, is 9 mm off.
OFFICIAL_STARTS_Z_M = (-2.25, -2.5)
START_TOLERANCE_M = 0.02

_LINE = "%d %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n"


def sniff(source: Source) -> bool:
    """Named `*.gt.freiburg`, or frame ids and a start as in the official files, unless a header says right-handed.

    Nothing else makes a file left-handed: handedness cannot be seen in poses; whole-number stamps alone decide nothing.
    """
    if source.name.endswith(".gt.freiburg"):
        return True
    if source.columns != 8 or "right-handed" in source.header:
        return False
    try:
        rows = [[float(field) for field in line.split()[:4]] for line in source.first_lines]
    except ValueError:
        return False
    return all(row[0].is_integer() for row in rows) and starts_as_official(np.array(rows[0][1:]))


def starts_as_official(position_m: np.ndarray) -> bool:
    """Whether a first position (3,) is that of the official living-room or office files, each axis to 2 cm."""
    return any(np.abs(position_m - (0.0, 0.0, z)).max() <= START_TOLERANCE_M for z in OFFICIAL_STARTS_Z_M)


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """Left-handed poses become right-handed by axes.mirrored_y; stamp = id / rate."""
    table = read_table(source.path, source.text, (8,), COLUMNS)
    left = poses_of_quaternions(table, table.values[:, 1:4] * options.unit_m, slice(4, 8))
    hint = "--from tum if these are seconds"
    trajectory = trajectory_of_frames(table, table.values[:, 0], axes.mirrored_y(left), options.rate_hz, hint)
    why = "by its name" if source.name.endswith(".gt.freiburg") else "by its start" if sniff(source) else "as told"
    sentence = (
        f"gt.freiburg ({why}): LEFT-handed y-up poses made right-handed by mirroring y, "
        f"stamps id/{options.rate_hz:g} s, in {ANCHORED_WORLD}"
    )
    return LoadedTrajectory(trajectory, Taken("gt.freiburg", "left", ANCHORED_WORLD, sentence))


def write(trajectory: Trajectory, options: WriteOptions) -> str:
    """The text of a gt.freiburg file, anchored as the original by the pose of image 1, or of the first there is."""
    numbers, left = anchored(trajectory, 1, options)
    rows = zip(numbers.tolist(), pose_columns(left, options.unit_m).tolist(), strict=True)
    return "".join([_LINE % (number, *pose) for number, pose in rows])


def anchored(trajectory: Trajectory, anchor: int, options: WriteOptions) -> tuple[np.ndarray, SE3]:
    """(n,) frame numbers from 1 on and their left-handed poses, with the pose of image `anchor` at (0, 0, start_z_m).

    Without that image the first one written serves. Poses that already start as the official files do stay as they are.
    """
    numbers = frame_numbers(trajectory, options.rate_hz)
    kept = numbers >= 1
    if not kept.any():
        raise InputError("poses of image 1 or later (image 0 has none in this format)", found="image 0 alone")
    T = trajectory.T_world_camera
    shown = T[kept]
    if not starts_as_official(shown.translation[0]):
        at_anchor = np.flatnonzero(numbers == anchor)
        reference = T[int(at_anchor[0])] if at_anchor.size else shown[0]
        shown = SE3(np.eye(3), np.array([0.0, 0.0, options.start_z_m])) @ reference.inverse() @ shown
    return numbers[kept], axes.mirrored_y(shown)
