"""Camera motion as a function of time, with exact velocity, acceleration and rotation rate: the
path of a recipe of hand-held motion, or a C2 spline through the poses of a trajectory.

A jet (3, n, d) is a function of time at n times with its first and second derivative.
"""

from dataclasses import dataclass
from functools import reduce
from typing import Protocol

import numpy as np

from ..errors import InputError
from .handheld import Parts, Recipe, make
from .handheld_parts import NaturalSpline
from .se3 import SE3
from .trajectory import FIRST_STAMP_S, Trajectory

#: Keys of the camera per frame: at 5 m/s^2 a line of 1/960 s is 0.7 micrometres beside the path.
_KEYS = 32
#: Rotation of the cv camera of yaw, pitch and roll 0, which looks along x of the world, z up.
_LEVEL_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
#: Coefficients of sin(a/2) / a and of cos(a/2) as power series in a^2, exact to a = 10 rad.
_TERMS = np.arange(24)
_FACTORIALS = np.cumprod(np.concatenate([[1.0], np.arange(1.0, 50.0)]))
_SINE = 0.5 * (-0.25) ** _TERMS / _FACTORIALS[2 * _TERMS + 1]
_COSINE = (-0.25) ** _TERMS / _FACTORIALS[2 * _TERMS]


@dataclass(frozen=True, eq=False)
class MotionStates:
    """The motion of a body at stamps (n,) in seconds: its poses T_world_body (n,), velocity and
    acceleration (n, 3) in m/s and m/s^2 along the axes of the world, rotation rate and its change
    (n, 3) in rad/s and rad/s^2 along those of the body.
    """

    stamps_s: np.ndarray
    T_world_body: SE3
    velocity_m_s: np.ndarray
    acceleration_m_s2: np.ndarray
    rate_rad_s: np.ndarray
    rate_change_rad_s2: np.ndarray

    @classmethod
    def of_jets(
        cls, stamps_s: np.ndarray, position_m: np.ndarray, quat_xyzw: np.ndarray
    ) -> "MotionStates":
        """From jets of the position (3, n, 3) and of a quaternion (3, n, 4) of any length."""
        q, dq, ddq = quat_xyzw
        conjugate = q * np.array([-1.0, -1.0, -1.0, 1.0])
        squared = (q * q).sum(-1, keepdims=True)
        # with q* dq = |q|^2 (rate / 2) + a real part, the derivative of which has dq* dq, also real
        rate = 2.0 * _product(conjugate, dq)[:, :3] / squared
        growth = 2.0 * (q * dq).sum(-1, keepdims=True) / squared
        change = 2.0 * _product(conjugate, ddq)[:, :3] / squared - growth * rate
        poses = SE3.from_quat_xyzw(q / np.sqrt(squared), position_m[0])
        return cls(stamps_s, poses, position_m[1], position_m[2], rate, change)

    def of_mounted(self, T_body_other: SE3) -> "MotionStates":
        """The motion of another body that is fixed to this one."""
        R_world_body = self.T_world_body.rotation
        arm = T_body_other.translation
        rate = self.rate_rad_s
        sideways = np.cross(rate, arm)
        pull = np.cross(self.rate_change_rad_s2, arm) + np.cross(rate, sideways)
        velocity = self.velocity_m_s + (R_world_body @ sideways[..., None])[..., 0]
        acceleration = self.acceleration_m_s2 + (R_world_body @ pull[..., None])[..., 0]
        R_other_body = T_body_other.rotation.T
        return MotionStates(
            self.stamps_s,
            self.T_world_body @ T_body_other,
            velocity,
            acceleration,
            rate @ R_other_body.T,
            self.rate_change_rad_s2 @ R_other_body.T,
        )


class ContinuousMotion(Protocol):
    """The motion of a camera, in metres, world z up. `stamps_s` (n,): those of its poses."""

    stamps_s: np.ndarray

    def states(self, stamps_s: np.ndarray) -> MotionStates:
        """The states of the camera at any stamps (m,), also outside the time of its poses."""


class RecipeMotion:
    """The path from which the poses of a recipe were taken, exact at every time."""

    def __init__(self, recipe: Recipe) -> None:
        made = make(recipe)
        self.trajectory = made.trajectory
        self.stamps_s = made.trajectory.stamps_s
        self._scale = made.scale
        self._parts = Parts.of(recipe)

    def states(self, stamps_s: np.ndarray) -> MotionStates:
        """As ContinuousMotion; before the first and after the last pose only the shake goes on."""
        stamps_s = np.asarray(stamps_s, float)
        smooth, shake_m, shake_rad = self._parts.jets(stamps_s - FIRST_STAMP_S)
        position = self._scale * smooth[..., :3] + shake_m
        position[0] += (1.0 - self._scale) * self._parts.centre_m
        yaw, pitch, roll = np.moveaxis(smooth[..., 3:], -1, 0)
        level = np.zeros((3, len(stamps_s), 4))
        level[0] = _LEVEL_XYZW
        turns = [_turn(2, yaw), level, _turn(0, pitch), _turn(2, roll), _shaken(shake_rad)]
        return MotionStates.of_jets(stamps_s, position, reduce(_product_jet, turns))


class SplineMotion:
    """A C2 spline through the poses of a trajectory: natural cubic in position and quaternion,
    which goes on at constant velocity before the first and after the last pose.

    Raises InputError for fewer than two poses.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        if len(trajectory) < 2:
            raise InputError("at least two poses to put a path through", found=len(trajectory))
        self.stamps_s = trajectory.stamps_s
        quat = trajectory.T_world_camera.quat_xyzw
        turned = np.cumprod(np.where((quat[1:] * quat[:-1]).sum(-1) < 0, -1.0, 1.0))
        quat[1:] *= turned[:, None]
        self._spline = NaturalSpline(self.stamps_s, np.hstack([trajectory.positions_m, quat]))

    def states(self, stamps_s: np.ndarray) -> MotionStates:
        """As ContinuousMotion."""
        stamps_s = np.asarray(stamps_s, float)
        inside_s = stamps_s.clip(self.stamps_s[0], self.stamps_s[-1])
        jet = self._spline.jet(inside_s)
        jet[0] += jet[1] * (stamps_s - inside_s)[:, None]
        return MotionStates.of_jets(stamps_s, jet[..., :3], jet[..., 3:])


def keys_between(
    motion: ContinuousMotion, trajectory: Trajectory, beyond: int = 0
) -> tuple[np.ndarray, SE3]:
    """Frame numbers (m,) and poses (m,) of a trajectory (n,), with as many of its motion between two
    frames that straight lines through them stay within a micrometre of hand-held motion. beyond:
    frames of the motion before the first and after the last pose.
    """
    frames = np.arange(-beyond * _KEYS, (len(trajectory) - 1 + beyond) * _KEYS + 1) / _KEYS
    poses = motion.states(stamps_at(trajectory, frames)).T_world_body
    rotation, translation = poses.rotation.copy(), poses.translation.copy()
    own = slice(beyond * _KEYS, len(frames) - beyond * _KEYS, _KEYS)
    rotation[own] = trajectory.T_world_camera.rotation
    translation[own] = trajectory.positions_m
    return frames, SE3(rotation, translation)


def stamps_at(trajectory: Trajectory, frames: np.ndarray) -> np.ndarray:
    """(m,) seconds at frame numbers (m,) between those of the poses (n,); beyond them, as far apart
    as the first and the last two.
    """
    return _continued(frames, np.arange(len(trajectory)), trajectory.stamps_s)


def frames_at(trajectory: Trajectory, stamps_s: np.ndarray) -> np.ndarray:
    """The inverse of stamps_at."""
    return _continued(stamps_s, trajectory.stamps_s, np.arange(len(trajectory)))


def _continued(x: np.ndarray, known_x: np.ndarray, known_y: np.ndarray) -> np.ndarray:
    """Interpolated between known points (n,), which go on straight at both ends."""
    found = np.interp(x, known_x, known_y)
    for outside, a, b in ((x < known_x[0], 0, 1), (x > known_x[-1], -1, -2)):
        slope = (known_y[b] - known_y[a]) / (known_x[b] - known_x[a]) if len(known_x) > 1 else 0.0
        found = np.where(outside, known_y[a] + slope * (x - known_x[a]), found)
    return found


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product of quaternions (..., 4), scalar last."""
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.concatenate([vector, aw * bw - (av * bv).sum(-1, keepdims=True)], -1)


def _product_jet(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The jet of the product of two quaternions, of their jets (3, n, 4)."""
    first = _product(a[1], b[0]) + _product(a[0], b[1])
    second = _product(a[2], b[0]) + 2.0 * _product(a[1], b[1]) + _product(a[0], b[2])
    return np.stack([_product(a[0], b[0]), first, second])


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """The jet of the rotation about an axis, of the jet (3, n) of the angle in radians."""
    half = angle / 2.0
    found = np.zeros((*angle.shape, 4))
    for k, (value, slope) in ((axis, (np.sin, np.cos)), (3, (np.cos, lambda a: -np.sin(a)))):
        found[0, :, k] = value(half[0])
        found[1, :, k] = slope(half[0]) * half[1]
        found[2, :, k] = slope(half[0]) * half[2] - value(half[0]) * half[1] ** 2
    return found


def _shaken(vector: np.ndarray) -> np.ndarray:
    """The jet of the rotation exp(vector), of the jet (3, n, 3) of the vector in radians."""
    v, dv, ddv = vector
    square = (v * v).sum(-1)
    growth = 2.0 * (v * dv).sum(-1)
    squares = np.stack([square, growth, 2.0 * (dv * dv + v * ddv).sum(-1)])
    sine = _of_square(_SINE, squares)[..., None]
    first = sine[0] * dv + sine[1] * v
    second = sine[0] * ddv + 2.0 * sine[1] * dv + sine[2] * v
    imaginary = np.stack([sine[0] * v, first, second])
    return np.concatenate([imaginary, _of_square(_COSINE, squares)[..., None]], -1)


def _of_square(series: np.ndarray, square: np.ndarray) -> np.ndarray:
    """The jet (3, n) of a power series, of the jet of its argument."""
    slope = np.polynomial.polynomial.polyder(series)
    value, by, twice = (
        np.polynomial.polynomial.polyval(square[0], c)
        for c in (series, slope, np.polynomial.polynomial.polyder(slope))
    )
    return np.stack([value, by * square[1], twice * square[1] ** 2 + by * square[2]])
