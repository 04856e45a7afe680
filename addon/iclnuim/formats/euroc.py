"""EuRoC ground truth: CSV, stamps in nanoseconds, position, quaternion scalar FIRST.

More columns (velocity, biases) may follow. The pose world <- body is taken as the camera's.
"""

from __future__ import annotations

import numpy as np

from ..geometry.trajectory import Trajectory
from .checks import poses_of_quaternions, trajectory_at
from .loaded import OWN_WORLD, LoadedTrajectory, ReadOptions, Source, Taken
from .table import read_table
from .written import WriteOptions

COLUMNS = "8 or 17 columns parted by commas: stamp in ns, x, y, z, qw, qx, qy, qz"
HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
GOES_TO = "EuRoC: nanoseconds, right-handed camera-to-world poses (as world <- body), world as it was"
QUAT_XYZW = [5, 6, 7, 4]


def sniff(source: Source) -> bool:
    return any("," in line for line in source.first_lines)


def read(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """Stamps ns -> s; the poses stay in the file's own world."""
    table = read_table(source.path, source.text, (8, 17), COLUMNS, delimiter=",")
    poses = poses_of_quaternions(table, table.values[:, 1:4] * options.unit_m, QUAT_XYZW)
    trajectory = trajectory_at(table, table.values[:, 0] / 1e9, poses)
    sentence = f"EuRoC: stamps in nanoseconds, world <- body taken as right-handed camera-to-world poses in {OWN_WORLD}"
    return LoadedTrajectory(trajectory, Taken("euroc", "right", OWN_WORLD, sentence))


def write(trajectory: Trajectory, options: WriteOptions) -> str:
    """The text of an EuRoC file with 8 columns."""
    T = trajectory.T_world_camera
    rows = np.concatenate([T.translation / options.unit_m, T.quat_wxyz], axis=1) + 0.0
    stamps_ns = np.rint(trajectory.stamps_s * 1e9).astype(np.int64).tolist()
    line = "%d,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n"
    return HEADER + "".join([line % (stamp, *row) for stamp, row in zip(stamps_ns, rows.tolist(), strict=True)])
