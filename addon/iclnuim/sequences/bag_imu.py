"""The IMU in a bag: readings of both sensors in one topic, or of a gyroscope and an accelerometer
apart, whose readings then are interpolated at the gyroscope's stamps, as RealSense's node does.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..formats.bags import IMU, Bag, stamp_ns
from ..geometry.se3 import SE3
from ..geometry.trajectory import frame_rate_hz
from ..sensor.imu import ImuStream
from ..trajectory_files.bag_poses import constant_transform
from .imu import SequenceImu

_SENSORS = ("gyro", "accel")


class BagImu(NamedTuple):
    """The IMU, None without one that can be read; notes and warnings: how it was read."""

    imu: SequenceImu | None
    notes: list[str]
    warnings: list[str]


def bag_imu(bag: Bag, camera_frame: str) -> BagImu:
    """The IMU of a bag, and where the camera of this frame is on it. Raises InputError for a damaged
    bag.
    """
    topics = _chosen(bag)
    names = ", ".join(topics)
    if not topics:
        return BagImu(None, [], [])
    if len(topics) > 2 or (len(topics) == 2 and not _are_apart(topics)):
        hint = f"{bag.path}:{topics[0]} chooses one"
        return BagImu(None, [], [f"no IMU is read, as several are there: {names}; {hint}"])
    parts = [_readings(bag, topic) for topic in sorted(topics, key=_is_accel)]
    stamps_ns, readings = _merged(parts)
    if len(stamps_ns) < 2:
        return BagImu(None, [], [f"no IMU is read: fewer than two readings in {names}"])
    for sensor, read in (("rotation rates", readings[:, :3]), ("forces", readings[:, 3:])):
        if not read.any():
            return BagImu(None, [f"no IMU is read, as {names} has no {sensor}"], [])
    warnings = []
    if lost := sum(part.lost for part in parts):
        warnings.append(f"{lost} readings of the IMU that are not finite or not later are left out")
    frame, T_imu_camera = bag.frame(topics[0]), None
    with suppress(InputError):  # frames with several parents
        T_imu_camera = constant_transform(bag, camera_frame, frame)
    if T_imu_camera is None:
        path = f"no one path of transforms from {frame} to {camera_frame}"
        warnings.append(f"/tf has {path}: the IMU is read as in the axes of the camera")
    rate_hz = frame_rate_hz((stamps_ns - stamps_ns[0]) / 1e9)
    stream = ImuStream(stamps_ns, readings, rate_hz, T_imu_camera or SE3.identity())
    return BagImu(SequenceImu(stream, about=names), [f"IMU {names}"], warnings)


def _chosen(bag: Bag) -> list[str]:
    topics = bag.topics_of(IMU)
    return [topic for topic in topics if topic in bag.given] or topics


def _is_accel(topic: str) -> bool:
    return _SENSORS[1] in topic.lower()


def _are_apart(topics: list[str]) -> bool:
    """Whether these are the topics of a gyroscope and of an accelerometer."""
    found = [[name for name in _SENSORS if name in topic.lower()] for topic in topics]
    return sorted(found) == [[name] for name in sorted(_SENSORS)]


class _Topic(NamedTuple):
    """Stamps (n,) in nanoseconds and readings (n, 6) of a topic, and the number of those left out."""

    stamps_ns: np.ndarray
    readings: np.ndarray
    lost: int


def _readings(bag: Bag, topic: str) -> _Topic:
    stamps: list[int] = []
    rows: list[list[float]] = []
    lost = 0
    for _, time_ns, message in bag.messages([topic]):
        stamp = stamp_ns(message.header, time_ns)
        vectors = (message.angular_velocity, message.linear_acceleration)
        row = [getattr(vector, axis) for vector in vectors for axis in "xyz"]
        if not np.isfinite(row).all() or (stamps and stamp <= stamps[-1]):
            lost += 1
            continue
        stamps.append(stamp)
        rows.append(row)
    return _Topic(np.array(stamps, np.int64), np.array(rows).reshape(-1, 6), lost)


def _merged(parts: list[_Topic]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) and readings (n, 6) of one topic, or of a gyroscope and an accelerometer where both
    are there.
    """
    gyro, accel = parts[0], parts[-1]
    if len(parts) == 1 or not len(gyro.stamps_ns) or not len(accel.stamps_ns):
        return gyro.stamps_ns[: len(accel.stamps_ns)], gyro.readings[: len(accel.stamps_ns)]
    first_ns, last_ns = accel.stamps_ns[[0, -1]]
    inside = (gyro.stamps_ns >= first_ns) & (gyro.stamps_ns <= last_ns)
    stamps_ns = gyro.stamps_ns[inside]
    since = [(each - first_ns).astype(float) for each in (stamps_ns, accel.stamps_ns)]
    forces = [np.interp(since[0], since[1], column) for column in accel.readings[:, 3:].T]
    return stamps_ns, np.hstack([gyro.readings[inside, :3], np.stack(forces, -1)])
