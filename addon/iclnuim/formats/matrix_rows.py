"""Poses as rows of 3x4 matrices: KITTI (right-handed) and the POV-world files of ICL-NUIM's renderings (LEFT-handed).

12 columns r00 r01 r02 tx r10 ... tz, or 13 with the frame number first. POV-world where name or header says pov.
"""

from __future__ import annotations

import numpy as np

from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .checks import poses_of_matrices, trajectory_of_frames
from .loaded import OUR_WORLD, OWN_WORLD, LoadedTrajectory, ReadOptions, Source, Taken, unit_warning
from .table import read_table
from .written import WriteOptions, frame_numbers

COLUMNS = "12 columns of a 3x4 matrix, or 13 with the frame number first"
ROTATION, POSITION = [0, 1, 2, 4, 5, 6, 8, 9, 10], [3, 7, 11]
GOES_TO_KITTI = "KITTI: 12 columns, right-handed camera-to-world poses, world as it was; stamps are not kept"
GOES_TO_POV = "pov-matrix: frame numbers, LEFT-handed poses in the POV world (y up)"
POV_HEADER = (
    "# frame r00 r01 r02 tx r10 r11 r12 ty r20 r21 r22 tz ; T_pov_cam, LEFT-handed POV-Ray world (y up), "
    "camera x right y up z forward, {unit}\n"
)


def sniff_pov(source: Source) -> bool:
    return source.columns in (12, 13) and ("pov" in source.name or "pov" in source.header)


def sniff_kitti(source: Source) -> bool:
    return source.columns in (12, 13)


def read_kitti(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """The poses stay in the file's own world; stamp = frame / rate."""
    trajectory = _read(source, options)
    sentence = f"KITTI rows: right-handed camera-to-world poses in {OWN_WORLD}, stamps frame/{options.rate_hz:g} s"
    return LoadedTrajectory(trajectory, Taken("kitti", "right", OWN_WORLD, sentence))


def read_pov(source: Source, options: ReadOptions) -> LoadedTrajectory:
    """POV world -> our world by axes.world_cv_from_pov; stamp = frame / rate."""
    pov = _read(source, options)
    trajectory = Trajectory(pov.stamps_s, axes.world_cv_from_pov(pov.T_world_camera))
    sentence = (
        f"pov-matrix: LEFT-handed poses in the POV world (y up), turned into {OUR_WORLD}, "
        f"stamps frame/{options.rate_hz:g} s"
    )
    return LoadedTrajectory(trajectory, Taken("pov-matrix", "left", OUR_WORLD, sentence + unit_warning(trajectory)))


def write_kitti(trajectory: Trajectory, options: WriteOptions) -> str:
    rows = matrix_columns(trajectory.T_world_camera, options.unit_m)
    return "".join([_ROW % tuple(row) for row in rows.tolist()])


def write_pov(trajectory: Trajectory, options: WriteOptions) -> str:
    numbers = frame_numbers(trajectory, options.rate_hz)
    rows = matrix_columns(axes.pov_from_world_cv(trajectory.T_world_camera), options.unit_m)
    unit = {1.0: "metres", 0.01: "centimetres"}.get(options.unit_m, f"units of {options.unit_m:g} m")
    lines = [f"{number} " + _ROW % tuple(row) for number, row in zip(numbers.tolist(), rows.tolist(), strict=True)]
    return POV_HEADER.format(unit=unit) + "".join(lines)


def matrix_columns(T: SE3, unit_m: float) -> np.ndarray:
    """(n, 12): r00 r01 r02 tx r10 ... tz. Adding 0.0 turns -0.0 into 0.0."""
    columns = np.empty((len(T), 12))
    columns[:, ROTATION] = T.rotation.reshape(-1, 9)
    columns[:, POSITION] = T.translation / unit_m
    return columns + 0.0


_ROW = " ".join((["%.12f"] * 3 + ["%.9f"]) * 3) + "\n"


def _read(source: Source, options: ReadOptions) -> Trajectory:
    table = read_table(source.path, source.text, (12, 13), COLUMNS)
    first = table.values.shape[1] - 12
    numbers = table.values[:, 0] if first else np.arange(float(len(table.values)))
    positions_m = table.values[:, [first + c for c in POSITION]] * options.unit_m
    poses = poses_of_matrices(table, positions_m, [first + c for c in ROTATION])
    return trajectory_of_frames(table, numbers, poses, options.rate_hz)
