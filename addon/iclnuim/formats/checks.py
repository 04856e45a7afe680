"""Checks that all readers of trajectories share: stamps, frame numbers, positions, rotations, blamed on their line."""

from __future__ import annotations

import numpy as np

from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .table import LARGEST_FRAME, LARGEST_POSITION_M, LARGEST_STAMP_S, Table, blamed


def trajectory_at(table: Table, stamps_s: np.ndarray, poses: SE3) -> Trajectory:
    """The trajectory with stamps in seconds. Raises InputError for one that is absurd, repeats or runs backwards."""
    absurd = np.flatnonzero(~(np.abs(stamps_s) <= LARGEST_STAMP_S))
    if absurd.size:
        found = f"{stamps_s[absurd[0]]:.10g}"
        raise table.error(
            absurd[0],
            f"a stamp in seconds, at most {LARGEST_STAMP_S:g}",
            found,
            "dividing stamps in nanoseconds by 1e9",
        )
    _check_increasing(table, stamps_s, "stamp")
    return Trajectory(stamps_s, poses)


def trajectory_of_frames(
    table: Table, numbers: np.ndarray, poses: SE3, rate_hz: float, hint: str | None = None
) -> Trajectory:
    """The trajectory with stamps number / rate. Raises InputError for one that is none, repeats or runs backwards."""
    bad = np.flatnonzero(~((numbers == np.rint(numbers)) & (numbers >= 0) & (numbers <= LARGEST_FRAME)))
    if bad.size:
        raise table.error(bad[0], f"a frame number, 0 to {LARGEST_FRAME}", f"{numbers[bad[0]]:.10g}", hint)
    _check_increasing(table, numbers, "frame number")
    return Trajectory(numbers / rate_hz, poses)


def poses_of_quaternions(table: Table, positions_m: np.ndarray, quat_xyzw_columns: slice | list[int]) -> SE3:
    """Poses of positions (n, 3) and of the four columns qx qy qz qw. Raises InputError naming the line."""
    _check_positions(table, positions_m)
    return SE3(blamed(table, lambda values: so3.matrix_from_quat_xyzw(values[:, quat_xyzw_columns])), positions_m)


def poses_of_matrices(table: Table, positions_m: np.ndarray, rotation_columns: list[int]) -> SE3:
    """Poses of positions (n, 3) and of the nine columns r00 r01 ... r22. Raises InputError naming the line."""
    _check_positions(table, positions_m)
    rotations = blamed(table, lambda values: so3.nearest_rotation(values[:, rotation_columns].reshape(-1, 3, 3)))
    return SE3(rotations, positions_m)


def _check_positions(table: Table, positions_m: np.ndarray) -> None:
    largest = np.abs(positions_m).max(axis=1)
    absurd = np.flatnonzero(~(largest <= LARGEST_POSITION_M))
    if absurd.size:
        expected = f"a position of at most {LARGEST_POSITION_M:g} m"
        raise table.error(absurd[0], expected, f"{largest[absurd[0]]:g} m", "another unit or another --from")


def _check_increasing(table: Table, values: np.ndarray, what: str) -> None:
    late = np.flatnonzero(np.diff(values) <= 0)
    if late.size:
        row = int(late[0]) + 1
        before, here = values[row - 1], values[row]
        found, hint = f"{here:.15g}", "sorting the lines"
        if here == before:
            found, hint = f"{here:.15g} again", "removing one of the two lines"
        raise table.error(row, f"a {what} above the {before:.15g} of line {table.place(row - 1)[1]}", found, hint)
