"""How a camera is mounted on the body that a ground truth follows: T_BS, the pose of the sensor in
the body, in the camera's file.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, within
from ..geometry.se3 import SE3
from .known_keys import numbers_of, short

#: Smaller entries of a matrix are rounding.
_SAME = 1e-6


def pose_of(value: Any, path: Path) -> SE3:
    """The pose in a 4 x 4 matrix, which may be a mapping with `data`; the identity for None.

    Raises InputError for anything else.
    """
    if value is None:
        return SE3.identity()
    if isinstance(value, dict):
        value = value.get("data")
    numbers = numbers_of(value)
    if numbers is None or len(numbers) != 16 or not np.isfinite(numbers).all():
        expected = "T_BS with the 16 numbers of a 4 x 4 matrix"
        raise InputError(expected, path=path, found=short(value))
    with within(path):
        return SE3.from_matrix(numbers.reshape(4, 4))


def is_identity(T: SE3) -> bool:
    """Whether a pose is the identity, but for rounding."""
    return bool(np.abs(T.matrix - np.eye(4)).max() < _SAME)


def mount_notes(T_truth_camera: SE3 | None) -> tuple[str, ...]:
    """A sentence if the ground truth follows another frame than the camera's."""
    if T_truth_camera is None:
        return ()
    distance_mm = 1000 * float(np.linalg.norm(T_truth_camera.translation))
    applied = "T_BS is applied: the ground truth follows a body"
    return (f"{applied}, and the camera is {distance_mm:.3g} mm from its origin",)
