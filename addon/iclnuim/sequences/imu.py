"""The IMU of a trajectory: on the path of its recipe or of a spline, with the noise of a sensor."""

from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import read_json
from ..geometry.se3 import SE3, Poses
from ..geometry.trajectory import Trajectory
from ..sensor.imu import ImuStream, imu_on
from ..sensor.imu_noise import ImuNoise, imu_noise
from ..settings import refuse_unknown
from ..trajectory_files.paths import path_of

#: Key of a rig's file: the pose of the camera in the IMU, T_BS of EuRoC's cam0.
_T_IMU_CAMERA = "T_imu_cam0"


def imu_of(
    trajectory: Trajectory | Poses | StrPath,
    rate_hz: float = 200.0,
    noise: ImuNoise | str = "none",
    seed: int = 0,
    T_imu_camera: SE3 | np.ndarray | None = None,
) -> ImuStream:
    """The readings (n, 6) of an IMU that moves with the camera of a trajectory: rotation rate in
    rad/s and specific force in m/s^2 along the axes of the IMU, at 100 to 1000 Hz, from 0.1 s before
    the first pose to 0.1 s after the last.

    trajectory: a built-in name, such as `kt2`, or a file; if the recipe beside it makes its poses,
    the readings are exact. Poses (n,), or matrices (n, 4, 4) at 30 Hz, and other files get a spline
    through them. noise: `bmi055`, `adis16448`, or an ImuNoise. seed: of the noise. T_imu_camera: the
    pose of the camera in the IMU, by default the identity. Raises InputError.
    """
    mounted = SE3.identity() if T_imu_camera is None else SE3.of(T_imu_camera)
    exact = imu_on(path_of(trajectory).motion, rate_hz, mounted)
    return imu_noise(noise).apply(exact, seed)


def read_rig(path: StrPath) -> SE3:
    """The pose of the camera in the IMU from a JSON file {"T_imu_cam0": [[..] x 4]}.

    Raises InputError.
    """
    content = read_json(Path(path))
    try:
        refuse_unknown(content, [_T_IMU_CAMERA], "a rig")
        matrix = np.asarray(content.get(_T_IMU_CAMERA), float)
        if matrix.shape != (4, 4):
            raise InputError(f"{_T_IMU_CAMERA} with four rows of four numbers")
        return SE3.from_matrix(matrix)
    except (TypeError, ValueError):
        expected = f"{_T_IMU_CAMERA} with four rows of four numbers"
        raise InputError(expected, path=path) from None
    except InputError as error:
        raise error.at(path) from None
