"""TUM trajectories: `timestamp tx ty tz qx qy qz qw`, seconds and metres, right-handed, quaternion scalar last."""

from __future__ import annotations

import numpy as np

from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .checks import poses_of_quaternions, trajectory_at, trajectory_of_frames
from .loaded import OWN_WORLD, LoadedTrajectory, ReadOptions, Source, Taken
from .table import Table, read_table
from .written import WriteOptions

COLUMNS = "8 columns: timestamp tx ty tz qx qy qz qw"
HEADER = (
    "# timestamp tx ty tz qx qy qz qw; seconds, metres, right-handed, camera (x right, y down, z forward) to world\n"
)
GOES_TO = "TUM: seconds, right-handed camera-to-world poses, world as it was"


def sniff(source: Source) -> bool:
    """Eight columns that no other format claims."""
    return source.columns == 8


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """Stamps are seconds; the poses stay in the file's own world."""
    table = read_table(source.path, source.text, (8,), COLUMNS)
    stamps_s = table.values[:, 0]
    sentence = f"TUM: stamps in seconds, right-handed camera-to-world poses in {OWN_WORLD}"
    if len(stamps_s) > 1 and (stamps_s == np.rint(stamps_s)).all():
        sentence += "; its whole numbers are taken as seconds (--from tum-ids takes them as frame numbers)"
    return LoadedTrajectory(
        trajectory_at(table, stamps_s, _poses(table, options)), Taken("tum", "right", OWN_WORLD, sentence)
    )


def read_ids(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """The same with frame numbers for stamps, as odometers run on ICL-NUIM write them: stamp = number / rate."""
    table = read_table(source.path, source.text, (8,), COLUMNS)
    trajectory = trajectory_of_frames(table, table.values[:, 0], _poses(table, options), options.rate_hz, "--from tum")
    sentence = f"TUM with frame numbers: stamps number/{options.rate_hz:g} s, right-handed poses in {OWN_WORLD}"
    return LoadedTrajectory(trajectory, Taken("tum-ids", "right", OWN_WORLD, sentence))


def write(trajectory: Trajectory, options: WriteOptions) -> str:
    """The text of a TUM file, exact to 1e-9 s and 1e-9 m."""
    rows = np.column_stack([trajectory.stamps_s, pose_columns(trajectory.T_world_camera, options.unit_m)])
    line = "%.9f %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n"
    return HEADER + "".join([line % tuple(row) for row in rows.tolist()])


def pose_columns(T: SE3, unit_m: float = 1.0) -> np.ndarray:
    """(n, 7): tx ty tz qx qy qz qw. Adding 0.0 turns -0.0 into 0.0."""
    return np.concatenate([T.translation / unit_m, T.quat_xyzw], axis=1) + 0.0


def _poses(table: Table, options: ReadOptions) -> SE3:
    return poses_of_quaternions(table, table.values[:, 1:4] * options.unit_m, slice(4, 8))
