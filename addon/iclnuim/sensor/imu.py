"""The readings of an IMU: what a gyroscope and an accelerometer measure on a body that moves as
MotionStates say.

The columns of readings (n, 6) are the rotation rate in rad/s and the specific force in m/s^2, both
along the axes of the IMU: an accelerometer at rest measures +9.81 m/s^2 upwards. The stamps are
whole nanoseconds. These are the signs, units and columns of EuRoC and Kalibr.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..geometry.continuous import ContinuousMotion, MotionStates, RecipeMotion, SplineMotion
from ..geometry.handheld import Recipe
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..settings import Settings, parameter

#: The world is z up.
GRAVITY_M_S2 = (0.0, 0.0, -9.81)
#: Rates from those of phones to those of industrial IMUs.
RATES_HZ = (100.0, 1000.0)
#: What readings cover before the first and after the last pose: three frames of 30 Hz, so that
#: there are readings on both sides of each exposure, and of stamps that are off by a frame.
MARGIN_S = 0.1


@dataclass(frozen=True)
class ImuOnCamera(Settings):
    """An IMU that moves with the camera of a job. recipe: that of the path from which the poses were
    taken; {}: a spline through the poses.
    """

    group: ClassVar[str] = "an IMU"

    rate_hz: float = parameter(0.0, "readings per second; 0: no IMU", low=0.0, high=RATES_HZ[1])
    T_imu_camera: tuple[float, ...] = parameter((), "pose of the camera in the IMU, row by row")
    recipe: dict[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return self.rate_hz > 0

    @property
    def mount(self) -> SE3:
        """T_imu_camera; by default the axes of the camera. Raises InputError for another number of
        values than 16.
        """
        if not self.T_imu_camera:
            return SE3.identity()
        if len(self.T_imu_camera) != 16:
            raise InputError("T_imu_camera of 16 numbers", found=len(self.T_imu_camera))
        return SE3.from_matrix(np.reshape(self.T_imu_camera, (4, 4)))

    def motion(self, poses: Trajectory) -> ContinuousMotion:
        """The motion through the poses of the job. Raises InputError for an invalid recipe."""
        return RecipeMotion(Recipe.from_dict(self.recipe)) if self.recipe else SplineMotion(poses)


@dataclass(frozen=True, eq=False)
class ImuStream:
    """The readings (n, 6) of an IMU: rotation rate in rad/s and specific force in m/s^2 along its
    axes. stamps_ns (n,): whole nanoseconds. rate_hz: nominal readings per second. T_imu_camera: the
    pose of the camera in the IMU. biases (n, 6): what of the readings is bias; None if nobody knows.
    noise: densities and walks of the noise (`ImuNoise.figures`); empty if unknown.
    """

    stamps_ns: np.ndarray
    readings: np.ndarray
    rate_hz: float
    T_imu_camera: SE3 = field(default_factory=SE3.identity)
    biases: np.ndarray | None = None
    noise: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        stamps_ns = np.asarray(self.stamps_ns)
        shape = np.shape(self.readings)
        if stamps_ns.dtype.kind != "i" or shape != (len(stamps_ns), 6):
            found = f"{stamps_ns.dtype} and {shape}"
            raise InputError("whole stamps (n,) and readings (n, 6)", found=found)
        if (np.diff(stamps_ns) <= 0).any() or not np.isfinite(self.readings).all():
            raise InputError("increasing stamps and finite readings of an IMU")

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __repr__(self) -> str:
        return f"ImuStream({len(self)} readings at {self.rate_hz:g} Hz)"

    @property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds."""
        return self.stamps_ns / 1e9

    def around(self, first_s: float, last_s: float) -> "ImuStream":
        """The readings from MARGIN_S before the first to MARGIN_S after the last of these times."""
        stamps_s = self.stamps_s
        kept = (stamps_s > first_s - MARGIN_S - 1e-6) & (stamps_s < last_s + MARGIN_S + 1e-6)
        biases = None if self.biases is None else self.biases[kept]
        readings = self.readings[kept]
        return replace(self, stamps_ns=self.stamps_ns[kept], readings=readings, biases=biases)


def check_rate(rate_hz: float) -> None:
    """Raises InputError for a rate outside 100 to 1000 Hz."""
    low, high = RATES_HZ
    if not low <= rate_hz <= high:
        raise InputError(f"an IMU at {low:g} to {high:g} Hz", found=rate_hz)


def true_readings(states: MotionStates) -> np.ndarray:
    """The readings (n, 6) without noise of an IMU with these states: rotation rate, and the
    acceleration minus gravity along the axes of the IMU.
    """
    R_world_imu = states.T_world_body.rotation
    force_world = states.acceleration_m_s2 - np.array(GRAVITY_M_S2)
    force = np.einsum("nji,nj->ni", R_world_imu, force_world)
    return np.hstack([states.rate_rad_s, force])


def imu_on(motion: ContinuousMotion, rate_hz: float, T_imu_camera: SE3 | None = None) -> ImuStream:
    """The readings without noise of an IMU on a moving camera. One falls on the first pose, and they
    begin before it and end after the last, but not before 0 s.

    Raises InputError for a rate outside 100 to 1000 Hz.
    """
    check_rate(rate_hz)
    T_imu_camera = T_imu_camera or SE3.identity()
    first_s, last_s = motion.stamps_s[[0, -1]]
    before = math.floor(min(MARGIN_S, max(first_s, 0.0)) * rate_hz + 1e-6)
    after = math.ceil((last_s - first_s + MARGIN_S) * rate_hz)
    numbers = np.arange(-before, after + 1)
    stamps_ns = np.rint(1e9 * (first_s + numbers / rate_hz)).astype(np.int64)
    states = motion.states(stamps_ns / 1e9).of_mounted(T_imu_camera.inverse())
    biases = np.zeros((len(numbers), 6))
    return ImuStream(stamps_ns, true_readings(states), rate_hz, T_imu_camera, biases)
