"""Hypotheses on readings of an IMU that do not fit the poses, and what each of them says."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..geometry.axis_changes import changes_of_axes
from ..sensor.imu import GRAVITY_M_S2
from .change import Change
from .hypothesis import Words
from .imu_evidence import ImuEvidence, ImuHypothesis, MountedReadings
from .imu_time import DRIFT_STEP_S
from .time_axis import TimeAxis

#: A smaller offset, and a scale nearer to 1, is none.
_LEAST_OFFSET_S = 0.001
_LEAST_SCALE = 1e-4
_SEARCH_ROUNDS = 12
_STANDARD_G_M_S2 = 9.80665
_SAME = np.eye(3)
_AXES = [*changes_of_axes(1), *changes_of_axes(-1)]


def _fixed(kind: str, apply: Callable[[MountedReadings], MountedReadings]) -> ImuHypothesis:
    return ImuHypothesis(kind, lambda _: Change(kind, apply, "imu"))


def _gravity_direction(given: ImuEvidence) -> Change | None:
    """Gravity along another direction of the world: the mean of what it must add."""
    moved, felt = given.accelerations
    if not len(moved):
        return None
    mean = (moved - felt + given.imu.gravity_m_s2).mean(0)
    gravity = mean * np.linalg.norm(GRAVITY_M_S2) / max(float(np.linalg.norm(mean)), 1e-9)
    parameters = {"gravity_m_s2": gravity.round(3).tolist()}
    change = Change("gravity_direction", parameters=parameters, of="imu", free=2)
    return replace(change, apply=lambda imu: imu.with_(gravity_m_s2=gravity))


def _axes(kind: str, pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> ImuHypothesis:
    """Of pairs of matrices of both sensors, those that fit the poses best."""

    def fit(given: ImuEvidence) -> Change | None:
        turned, read = given.rates
        if not len(turned):
            return None
        moved, felt = given.accelerations
        own = np.swapaxes(given.R_used, -1, -2)
        force, force_read = (
            (own @ (each - given.imu.gravity_m_s2)[..., None])[..., 0] for each in (moved, felt)
        )
        alike = [_likeness(turned, read), _likeness(force, force_read)]
        gyro, accel = max(pairs, key=lambda one: sum(map(np.vdot, one, alike)))
        if (gyro == _SAME).all() and (accel == _SAME).all():
            return None
        shown = accel if kind != "gyro_axes" else gyro
        parameters = {"axes": _named_axes(shown)}
        return Change(kind, lambda imu: imu.multiplied(gyro, accel), "imu", parameters)

    return ImuHypothesis(kind, fit)


def _likeness(wanted: np.ndarray, read: np.ndarray) -> np.ndarray:
    """(3, 3) of which the sum over a matrix B is largest where B @ read is most like `wanted`."""
    return wanted.T @ read / max(float(np.vdot(read, read)), 1e-12)


def _named_axes(B: np.ndarray) -> str:
    """What x, y and z are made of, such as `-y x z`."""
    places = np.abs(B).argmax(1)
    return " ".join("-" * int(B[k, p] < 0) + "xyz"[p] for k, p in enumerate(places))


def _offset(given: ImuEvidence) -> Change | None:
    step_s = float(np.median(np.diff(given.imu.stamps_s)))
    axis = _refined(given, given.imu.offset, ("offset_s",), step_s)
    if abs(axis.offset_s) < _LEAST_OFFSET_S:
        return None
    return Change("offset", lambda imu: imu.with_stamps(axis), "imu", axis.to_dict(), 1)


def _rate(given: ImuEvidence) -> Change | None:
    step_s = float(np.median(np.diff(given.imu.stamps_s)))
    names = ("offset_s", "scale", "offset_s")
    axis = _refined(given, given.imu.scaled, names, step_s)
    if abs(axis.scale - 1) < _LEAST_SCALE:
        return None
    return Change("rate", lambda imu: imu.with_stamps(axis), "imu", axis.to_dict(), 2)


def _refined(given: ImuEvidence, axis: TimeAxis, names: Sequence[str], step_s: float) -> TimeAxis:
    """A time axis near this one with smaller errors: its numbers are searched one after the other
    by golden sections.
    """
    length_s = max(float(np.ptp(given.imu.stamps_s)), step_s)
    for name in names:
        wide = 2 * step_s if name == "offset_s" else DRIFT_STEP_S / length_s

        def cost(value: float, name: str = name, axis: TimeAxis = axis) -> float:
            other = axis._replace(**{name: value})
            return given.after([Change("", lambda imu: imu.with_stamps(other))]).cost

        middle = getattr(axis, name)
        axis = axis._replace(**{name: _least(cost, middle - wide, middle + wide)})
    return axis


def _least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Where a function of one valley is least, by golden sections."""
    golden = (5**0.5 - 1) / 2
    a, b = high - golden * (high - low), low + golden * (high - low)
    at_a, at_b = cost(a), cost(b)
    for _ in range(_SEARCH_ROUNDS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - golden * (high - low)
            at_a = cost(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + golden * (high - low)
            at_b = cost(b)
    return (low + high) / 2


_DEGREES = _fixed("degrees", lambda imu: imu.multiplied(np.deg2rad(_SAME), _SAME))
_G = _fixed("g", lambda imu: imu.multiplied(_SAME, _STANDARD_G_M_S2 * _SAME))
_NO_GRAVITY = _fixed("no_gravity", lambda imu: imu.with_gravity(1.0))
_REVERSED = _fixed("gravity_reversed", lambda imu: imu.with_gravity(2.0))
_GYRO_AXES = _axes("gyro_axes", [(B, _SAME) for B in _AXES])
_ACCEL_AXES = _axes("accel_axes", [(_SAME, B) for B in _AXES])
_OF_GYRO = (_DEGREES, _GYRO_AXES)
_OF_ACCEL = (_G, _NO_GRAVITY, _REVERSED, _ACCEL_AXES)
#: Chains of hypotheses, in the order in which they are tried until one explains all: one mistake
#: without a number that is fitted, one with, one of each sensor.
CHAINS: tuple[tuple[tuple[ImuHypothesis, ...], ...], ...] = (
    (
        *((one,) for one in (*_OF_GYRO, *_OF_ACCEL)),
        (_axes("axes", [*((B, B) for B in _AXES), *((-B, B) for B in _AXES[24:])]),),
        (_fixed("mount_inverse", lambda imu: imu.with_(T_imu_camera=imu.T_imu_camera.inverse())),),
    ),
    (
        (ImuHypothesis("gravity_direction", _gravity_direction),),
        (ImuHypothesis("offset", _offset),),
        (ImuHypothesis("rate", _rate),),
    ),
    tuple((one, other) for one in _OF_GYRO for other in _OF_ACCEL),
)


def _words_of_axes(subject: str) -> Callable[[Change], Words]:
    def words(change: Change) -> Words:
        axes = change.parameters["axes"]
        cause = f"the axes of {subject} are not those that the mounting says"
        return Words(f"with {axes} as x y z of {subject}", cause, f"{subject} in this order")

    return words


def _words_of_gravity(change: Change) -> Words:
    along = " ".join(f"{value:g}" for value in change.parameters["gravity_m_s2"])
    cause = "the world of the poses is not z up"
    return Words(f"with gravity along {along}", cause, "poses in a world whose z points up")


def _words_of_offset(change: Change) -> Words:
    offset_s = change.parameters["offset_s"]
    late = "late" if offset_s < 0 else "early"
    cause = f"the stamps of the readings are {1000 * abs(offset_s):.1f} ms {late}"
    return Words("with other stamps", cause, f"adding {offset_s:.4f} s to them")


def _words_of_rate(change: Change) -> Words:
    parameters = change.parameters
    axis = TimeAxis(parameters["offset_s"], parameters["stamp_scale"], parameters["origin_s"])
    cause = "the stamps of the readings count another rate"
    return Words("with other stamps", cause, axis.advice)


def _said(better: str, cause: str, advice: str) -> Callable[[Change], Words]:
    return lambda _: Words(better, cause, advice)


#: What each kind says.
WORDS: dict[str, Callable[[Change], Words]] = {
    "degrees": _said(
        "with rates in degrees per second", "the unit of the rates is another", "rates in rad/s"
    ),
    "g": _said(
        "with specific forces in g", "the unit of the accelerometer is another", "forces in m/s^2"
    ),
    "no_gravity": _said(
        "with gravity added",
        "gravity was taken out of the specific forces",
        "forces as the sensor reads them: 9.81 m/s^2 upwards at rest",
    ),
    "gravity_reversed": _said(
        "with gravity reversed",
        "at rest the specific force points down",
        "forces of 9.81 m/s^2 upwards at rest",
    ),
    "gravity_direction": _words_of_gravity,
    "axes": _words_of_axes("the readings"),
    "gyro_axes": _words_of_axes("the rates"),
    "accel_axes": _words_of_axes("the specific forces"),
    "mount_inverse": _said(
        "with the inverse of the mounting",
        "the pose of the IMU in the camera stands where that of the camera in the IMU belongs",
        "the inverse of T_BS",
    ),
    "offset": _words_of_offset,
    "rate": _words_of_rate,
}
