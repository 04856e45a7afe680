"""The IMU of a trajectory or a sequence: on the path of a recipe or of a spline, with the noise of a
sensor; its files imu.csv and imu.json.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, StrPath, within
from ..formats.files import atomic_write_text, is_file, read_json, write_json
from ..formats.imu_files import imu_text, read_imu
from ..geometry.continuous import ContinuousMotion
from ..geometry.se3 import SE3, Poses
from ..geometry.trajectory import Trajectory, frame_rate_hz
from ..sensor.imu import GRAVITY_M_S2, ImuOnCamera, ImuStream, imu_on
from ..sensor.imu_noise import FIGURES, ImuNoise, imu_noise
from ..settings import refuse_unknown
from ..trajectory_files.paths import EXACT, SPLINE, path_of

#: The readings of a sequence in EuRoC's columns, and what else is known of them.
READINGS = "imu.csv"
ABOUT = "imu.json"
#: Key of a rig's file: the pose of the camera in the IMU, T_BS of EuRoC's cam0.
_T_IMU_CAMERA = "T_imu_cam0"


@dataclass(frozen=True, eq=False)
class SequenceImu:
    """The readings of the IMU of a sequence. motion: that of the camera, if it is known between the
    poses. about: where the readings are from, in a sentence; "" if unknown. said_rate_hz: the rate
    that a file gives besides the stamps.
    """

    stream: ImuStream
    motion: ContinuousMotion | None = None
    about: str = ""
    said_rate_hz: float | None = None

    @classmethod
    def of_job(cls, imu: ImuOnCamera, poses: Trajectory) -> "SequenceImu | None":
        """The readings without noise along all poses of a job; None without an IMU."""
        if not imu:
            return None
        motion = imu.motion(poses)
        about = EXACT if imu.recipe else SPLINE
        return cls(imu_on(motion, imu.rate_hz, imu.mount), motion, about)

    def noisy(self, noise: ImuNoise, seed: int) -> "SequenceImu":
        """With noise on all readings, which so is the same whichever frames are written."""
        if noise == ImuNoise():
            return self
        return replace(self, stream=noise.apply(self.stream, seed))

    def around(self, stamps_s: np.ndarray) -> "SequenceImu":
        """The readings around frames with these stamps (n,)."""
        stream = self.stream.around(float(stamps_s.min()), float(stamps_s.max()))
        return replace(self, stream=stream)

    def states_of(self, poses: Trajectory) -> tuple[Trajectory, np.ndarray, np.ndarray]:
        """Of poses of the camera, those of the IMU with its velocities (n, 3) in m/s in the world,
        by differences of the positions where the motion is unknown, and biases (n, 6).
        """
        stream = self.stream
        T_world_imu = poses.T_world_camera @ stream.T_imu_camera.inverse()
        own = Trajectory(poses.stamps_s, T_world_imu)
        if self.motion is not None:
            moved = self.motion.states(own.stamps_s).of_mounted(stream.T_imu_camera.inverse())
            velocities = moved.velocity_m_s
        else:
            velocities = velocities_of(own)
        biases = np.zeros((len(own), 6))
        if stream.biases is not None:
            columns = [np.interp(own.stamps_s, stream.stamps_s, c) for c in stream.biases.T]
            biases = np.stack(columns, -1)
        return own, velocities, biases


def velocities_of(poses: Trajectory) -> np.ndarray:
    """(n, 3) m/s, by differences of the positions."""
    if len(poses) < 2:
        return np.zeros((len(poses), 3))
    return np.gradient(poses.positions_m, poses.stamps_s, axis=0)


def write_imu(folder: Path, imu: SequenceImu) -> None:
    """Write imu.csv and imu.json."""
    stream = imu.stream
    atomic_write_text(folder / READINGS, imu_text(stream.stamps_ns, stream.readings))
    about: dict[str, Any] = {
        "rate_hz": stream.rate_hz,
        _T_IMU_CAMERA: stream.T_imu_camera.matrix.tolist(),
        "gravity_m_s2": list(GRAVITY_M_S2),
        **stream.noise,
    }
    if imu.about:
        about["about"] = imu.about
    write_json(folder / ABOUT, about)


def read_imu_files(folder: Path) -> SequenceImu | None:
    """The readings of imu.csv, and what imu.json says of them; None without imu.csv.

    Raises InputError.
    """
    file = folder / READINGS
    if not is_file(file):
        return None
    about = read_json(folder / ABOUT) if is_file(folder / ABOUT) else {}
    with within(folder / ABOUT):
        T_imu_camera = _pose(about[_T_IMU_CAMERA]) if _T_IMU_CAMERA in about else SE3.identity()
    return sequence_imu(file, about, T_imu_camera)


def sequence_imu(file: Path, about: dict[str, Any], T_imu_camera: SE3) -> SequenceImu:
    """The readings of a file; about: the densities and walks of their noise, if they are known, by
    their names in Kalibr's imu.yaml, their rate, and where they are from. Raises InputError.
    """
    stamps_ns, readings = read_imu(file)
    found = {name: _positive(about.get(name)) for name in FIGURES}
    noise = {name: value for name, value in found.items() if value is not None}
    text = about.get("about", "")
    rate_hz = frame_rate_hz((stamps_ns - stamps_ns[0]) / 1e9)
    stream = ImuStream(stamps_ns, readings, rate_hz, T_imu_camera, noise=noise)
    text = text if isinstance(text, str) else ""
    said_rate_hz = _positive(about.get("rate_hz", about.get("update_rate")))
    return SequenceImu(stream, about=text, said_rate_hz=said_rate_hz)


def _positive(value: object) -> float | None:
    """The number of JSON or YAML, None if it is none."""
    try:
        number = float(value) if isinstance(value, int | float | str) else -1.0
    except (ValueError, OverflowError):
        return None
    return number if 0 <= number < np.inf else None


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
    with within(path):
        refuse_unknown(content, [_T_IMU_CAMERA], "a rig")
        return _pose(content.get(_T_IMU_CAMERA))


def _pose(rows: object) -> SE3:
    """The pose of a matrix of JSON. Raises InputError."""
    try:
        matrix = np.asarray(rows, float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4):
        raise InputError(f"{_T_IMU_CAMERA} with four rows of four numbers")
    return SE3.from_matrix(matrix)
