"""Readings of an IMU with poses of the camera as evidence: how much they differ, and how much after
changes.

Nothing is differentiated. Between two poses the gyroscope is integrated; over two such intervals
the second difference of the positions is the mean of the acceleration, weighted by a triangle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..geometry import so3
from ..geometry.continuous import SplineMotion
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..sensor.imu import GRAVITY_M_S2, ImuStream
from .change import Change
from .fit import Limits
from .imu_time import ComparedRates, scales_of
from .time_axis import TimeAxis

#: Poses are compared at least this far apart: nearer ones have more noise than motion.
_STEP_S = 1 / 31
#: Intervals that are compared at least, and those of one block: every other block is a half.
_MIN_INTERVALS = 30
_BLOCK = 15
#: Between stamps this far apart hands that tremble turn straight, to 1e-5 rad.
_DENSE_S = 0.002
#: No sensor reads more, whatever its unit; squares of larger numbers may overflow.
_LARGEST = 1e6
#: What constant biases may be: of sensors that people own.
_GYRO_BIAS_RAD_S = 0.1
_ACCEL_BIAS_M_S2 = 0.5
#: Of rad/s and m/s^2, RMS. Rounding: smaller differences are none. Right readings of poses at 30 Hz
#: that tremble differ by less than `worth`; an explanation leaves at most `largest`.
LIMITS = Limits(
    rounding=np.array([0.001, 0.01]),
    worth=np.array([0.005, 0.06]),
    largest=np.array([0.1, 1.0]),
    bearable=np.array([np.inf, np.inf]),
)


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """The motion of the camera, and its rotation at dense stamps: quaternions (n, 4), between which
    straight lines are near enough.
    """

    spline: SplineMotion
    stamps_s: np.ndarray
    quat_xyzw: np.ndarray

    @classmethod
    def of(cls, poses: Trajectory) -> "CameraMotion":
        spline = SplineMotion(poses)
        first_s, last_s = poses.stamps_s[[0, -1]].tolist()
        stamps_s = np.linspace(first_s, last_s, 2 + int((last_s - first_s) / _DENSE_S))
        quat_xyzw = spline.states(stamps_s).T_world_body.quat_xyzw
        turned = np.where((quat_xyzw[1:] * quat_xyzw[:-1]).sum(-1) < 0, -1.0, 1.0)
        quat_xyzw[1:] *= np.cumprod(turned)[:, None]
        return cls(spline, stamps_s, quat_xyzw)

    def rotations(self, stamps_s: np.ndarray) -> np.ndarray:
        """(m, 3, 3) at stamps (m,)."""
        columns = [np.interp(stamps_s, self.stamps_s, column) for column in self.quat_xyzw.T]
        quat_xyzw = np.stack(columns, -1)
        quat_xyzw /= np.linalg.norm(quat_xyzw, axis=1, keepdims=True)
        return so3.matrix_from_quat_xyzw(quat_xyzw)


@dataclass(frozen=True, eq=False)
class MountedReadings:
    """Readings (n, 6) in rad/s and m/s^2 at stamps (n,), the pose of the camera in the IMU, gravity
    (3,) in the world, and the motion of the camera.
    """

    stamps_s: np.ndarray
    readings: np.ndarray
    T_imu_camera: SE3
    motion: CameraMotion
    gravity_m_s2: np.ndarray = field(default_factory=lambda: np.array(GRAVITY_M_S2))

    @cached_property
    def R_world_camera(self) -> np.ndarray:
        """(n, 3, 3) at the stamps."""
        return self.motion.rotations(self.stamps_s)

    @property
    def R_world_imu(self) -> np.ndarray:
        """(n, 3, 3) at the stamps."""
        return self.R_world_camera @ self.T_imu_camera.rotation.T

    @cached_property
    def offset(self) -> TimeAxis:
        """The offset with which the rates read are most like those of the camera."""
        return self._compared_rates.best((1.0,))

    @cached_property
    def scaled(self) -> TimeAxis:
        """The scale of the stamps about their middle, and the offset, with which they are."""
        return self._compared_rates.best(scales_of(float(np.ptp(self.stamps_s))))

    @property
    def _compared_rates(self) -> ComparedRates:
        rates = self.readings[:, :3]
        return ComparedRates.of(self.stamps_s, rates, self.T_imu_camera, self.motion.spline)

    def with_(self, **changed: Any) -> "MountedReadings":
        """With other values, and the rotations at the stamps if those are the same."""
        other = replace(self, **changed)
        if other.stamps_s is self.stamps_s:
            other.__dict__["R_world_camera"] = self.R_world_camera
        return other

    def with_stamps(self, axis: TimeAxis) -> "MountedReadings":
        return self.with_(stamps_s=axis.of(self.stamps_s))

    def multiplied(self, gyro: np.ndarray, accel: np.ndarray) -> "MountedReadings":
        """Readings of both sensors multiplied by matrices (3, 3)."""
        readings = np.hstack([self.readings[:, :3] @ gyro.T, self.readings[:, 3:] @ accel.T])
        return self.with_(readings=readings)

    def with_gravity(self, share: float) -> "MountedReadings":
        """With this share of what gravity adds to the specific force."""
        added = -share * self.gravity_m_s2 @ self.R_world_imu
        return self.with_(readings=self.readings + np.pad(added, ((0, 0), (3, 0))))


class ImuHypothesis(NamedTuple):
    """fit: the change of MountedReadings that undoes a mistake, None if there is none."""

    kind: str
    fit: Callable[["ImuEvidence"], Change | None]


@dataclass(frozen=True, eq=False)
class ImuEvidence:
    """Readings and poses as evidence (competition.py). half: every other block of intervals, 0 or
    1; None: all.
    """

    poses: Trajectory
    imu: MountedReadings
    half: int | None = None
    limits: Limits = LIMITS

    @classmethod
    def of(cls, imu: ImuStream, poses: Trajectory) -> "ImuEvidence | None":
        """None with too few poses, or readings."""
        kept = [0]
        for k, stamp_s in enumerate(poses.stamps_s.tolist()):
            if stamp_s - poses.stamps_s[kept[-1]] >= _STEP_S - 1e-9:
                kept.append(k)
        if len(kept) <= _MIN_INTERVALS or len(imu) <= _MIN_INTERVALS:
            return None
        motion = CameraMotion.of(poses)
        values = imu.readings.clip(-_LARGEST, _LARGEST)
        readings = MountedReadings(imu.stamps_s, values, imu.T_imu_camera, motion)
        return cls(poses[np.array(kept)], readings)

    @property
    def parts(self) -> list["ImuEvidence"]:
        """All, and each half."""
        return [self, replace(self, half=0), replace(self, half=1)]

    @cached_property
    def _used(self) -> np.ndarray:
        """(m,) which inner poses have readings around them on both sides."""
        stamps_s = self.poses.stamps_s
        place = np.searchsorted(self.imu.stamps_s, stamps_s)
        inside = (place > 0) & (place < len(self.imu.stamps_s))
        dense = np.diff(place) > 0
        used = inside[:-2] & inside[1:-1] & inside[2:] & dense[:-1] & dense[1:]
        if self.half is not None:
            used &= np.arange(len(used)) // _BLOCK % 2 == self.half
        return used

    @cached_property
    def rates(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 3) rad/s along the axes of the IMU around the used poses: of the poses, and read."""
        used, steps_s = self._used, np.diff(self.poses.stamps_s)
        R_world_imu = self.poses.T_world_camera.rotation @ self.imu.T_imu_camera.rotation.T
        turned = so3.log(np.swapaxes(R_world_imu[:-1], -1, -2) @ R_world_imu[1:])
        read = np.diff(self._integral(self.imu.readings[:, :3]), axis=0)
        both = [(each / steps_s[:, None])[:-1][used] for each in (turned, read)]
        return both[0], both[1]

    @cached_property
    def accelerations(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 3) m/s^2 in the world at the used poses: of the poses, and of the readings."""
        arm = self.imu.T_imu_camera.inverse().translation
        positions = self.poses.T_world_camera.apply(arm)
        force = np.einsum("nij,nj->ni", self.imu.R_world_imu, self.imu.readings[:, 3:])
        moved = self._integral(force + self.imu.gravity_m_s2, twice=True)
        both = [self._second_differences(each)[self._used] for each in (positions, moved)]
        return both[0], both[1]

    @cached_property
    def R_used(self) -> np.ndarray:
        """(m, 3, 3) R_world_imu of the used poses."""
        R = self.poses.T_world_camera.rotation[1:-1][self._used]
        return R @ self.imu.T_imu_camera.rotation.T

    def _integral(self, values: np.ndarray, twice: bool = False) -> np.ndarray:
        """(k, 3) integral of values (n, 3) between the stamps of the readings, up to each pose."""
        t = self.imu.stamps_s
        h = np.maximum(np.diff(t), 1e-9)[:, None]
        once = np.zeros_like(values)
        once[1:] = np.cumsum(h * (values[1:] + values[:-1]) / 2, axis=0)
        place = np.clip(np.searchsorted(t, self.poses.stamps_s, "right") - 1, 0, len(t) - 2)
        d = (self.poses.stamps_s - t[place])[:, None]
        slope = (values[place + 1] - values[place]) / h[place]
        if not twice:
            return once[place] + d * values[place] + d**2 / 2 * slope
        change = np.diff(values, axis=0)
        double = np.zeros_like(values)
        double[1:] = np.cumsum(h * once[:-1] + h**2 * (values[:-1] / 2 + change / 6), axis=0)
        return double[place] + d * once[place] + d**2 / 2 * values[place] + d**3 / 6 * slope

    def _second_differences(self, positions: np.ndarray) -> np.ndarray:
        """(k - 2, 3) m/s^2 of positions (k, 3) at the poses."""
        steps_s = np.diff(self.poses.stamps_s)[:, None]
        velocities = np.diff(positions, axis=0) / steps_s
        return 2 * np.diff(velocities, axis=0) / (steps_s[1:] + steps_s[:-1])

    @cached_property
    def errors(self) -> Sequence[float]:
        """RMS differences in rad/s and m/s^2, but for constant biases."""
        if np.count_nonzero(self._used) < _MIN_INTERVALS / 3:
            return tuple(self.limits.failed.tolist())
        turned, read = self.rates
        rate = _without_bias(read - turned, _GYRO_BIAS_RAD_S)
        moved, felt = self.accelerations
        force = (np.swapaxes(self.R_used, -1, -2) @ (felt - moved)[..., None])[..., 0]
        force = _without_bias(force, _ACCEL_BIAS_M_S2)
        return tuple(float(np.sqrt((e**2).sum(-1).mean())) for e in (rate, force))

    def after(self, changes: Sequence[Change]) -> "ImuEvidence":
        imu = self.imu
        for change in changes:
            imu = change.apply(imu)
        return replace(self, imu=imu)

    def fitted(self, chain: Sequence[ImuHypothesis]) -> tuple[Change, ...] | None:
        found: tuple[Change, ...] = ()
        for one in chain:
            change = one.fit(self.after(found))
            if change is None:
                return None
            found = (*found, change)
        return found

    @property
    def cost(self) -> float:
        """Logarithm of the product of the errors."""
        return float(np.log(np.maximum(self.errors, self.limits.rounding)).sum())


def _without_bias(differences: np.ndarray, largest: float) -> np.ndarray:
    bias = differences.mean(0)
    return differences - bias * min(1.0, largest / max(float(np.linalg.norm(bias)), 1e-12))
