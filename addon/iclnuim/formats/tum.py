"""TUM trajectories: `timestamp tx ty tz qx qy qz qw`, seconds and metres, right-handed, quaternion scalar last."""

from __future__ import annotations

import numpy as np

from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .loaded import LoadedTrajectory, ReadOptions, Source, Taken
from .table import Table, blamed, check_positions, check_stamps, read_table

COLUMNS = "8 columns: timestamp tx ty tz qx qy qz qw"
HEADER = "# timestamp tx ty tz qx qy qz qw; seconds, metres, right-handed, camera (x right, y down, z forward) to world\n"


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """Stamps are seconds; the poses stay in the file's own world."""
    table = read_table(source.path, source.text, (8,), COLUMNS)
    stamps_s = table.values[:, 0]
    sentence = "TUM: stamps in seconds, right-handed camera-to-world poses in the file's own world"
    if len(stamps_s) > 1 and (np.diff(stamps_s) == 1).all():
        sentence += "; its whole-number stamps are taken as seconds (--from tum-ids takes them as frame numbers)"
    return LoadedTrajectory(_trajectory(table, stamps_s, options), Taken("tum", "right", "the file's own world", sentence))


def read_ids(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """The same with frame numbers for stamps, as odometers run on ICL-NUIM write them: stamp = number / rate."""
    table = read_table(source.path, source.text, (8,), COLUMNS)
    stamps_s = table.values[:, 0] / options.rate_hz
    sentence = f"TUM with frame numbers: stamps number/{options.rate_hz:g} s, right-handed poses in the file's own world"
    return LoadedTrajectory(_trajectory(table, stamps_s, options), Taken("tum-ids", "right", "the file's own world", sentence))


def write(trajectory: Trajectory) -> str:
    """The text of a TUM file, 1e-9 s and 1e-9 m exact."""
    rows = np.column_stack([trajectory.stamps_s, pose_columns(trajectory.T_world_camera)])
    line = "%.9f %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n"
    return HEADER + "".join([line % tuple(row) for row in rows.tolist()])


def pose_columns(T: SE3) -> np.ndarray:
    """(n, 7): tx ty tz qx qy qz qw."""
    return np.concatenate([T.translation, T.quat_xyzw], axis=1)


def poses_from_columns(table: Table, first: int, options: ReadOptions) -> SE3:
    """Poses of the seven columns tx ty tz qx qy qz qw from `first` on. Raises InputError naming the line."""
    positions_m = table.values[:, first : first + 3] * options.unit_m
    check_positions(table, positions_m)
    rotations = blamed(table, lambda v: SE3.from_quat_xyzw(v[:, first + 3 : first + 7], np.zeros((len(v), 3))).rotation)
    return SE3(rotations, positions_m)


def _trajectory(table: Table, stamps_s: np.ndarray, options: ReadOptions) -> Trajectory:
    check_stamps(table, stamps_s)
    return Trajectory(stamps_s, poses_from_columns(table, 1, options))
