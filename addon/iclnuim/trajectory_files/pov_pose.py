"""The pose of one POV-Ray camera."""

import os
from collections.abc import Sequence

import numpy as np

from ..errors import InputError, StrPath
from ..geometry.axes import world_cv_from_pov
from ..geometry.se3 import SE3
from .pov import camera_axes
from .trajectories import read_trajectory

Vector = np.ndarray | Sequence[float]


def pose_from_pov(
    camera: StrPath | Vector,
    direction: Vector | None = None,
    up: Vector = (0.0, 1.0, 0.0),
    unit_m: float = 1.0,
) -> SE3:
    """The pose, in our world and of the cv camera, of a POV-Ray camera file of ICL-NUIM with
    cam_pos, cam_dir and cam_up, or of the three vectors (3,) themselves, in the left-handed POV
    world, y up.

    unit_m: the unit of the position in metres (1 in the living room, 0.01 in the office). Raises
    InputError for anything else.
    """
    if isinstance(camera, str | os.PathLike):
        if direction is not None:
            raise InputError("a file without a direction, which it contains", found=str(camera))
        loaded = read_trajectory(camera, "pov-cameras", unit_m=unit_m).trajectory
        if len(loaded) != 1:
            hint = "one of its files, or iclnuim.read_trajectory"
            raise InputError("one camera", path=camera, found=f"{len(loaded)}", hint=hint)
        return loaded.T_world_camera[0]
    if direction is None:
        raise InputError("a position with a direction", found="no direction")
    position, ahead, upwards = (_vector(given) for given in (camera, direction, up))
    rotation = camera_axes(ahead, upwards).T
    return world_cv_from_pov(SE3(rotation, unit_m * position))


def _vector(given: Vector) -> np.ndarray:
    vector = np.asarray(given)
    if vector.shape != (3,) or vector.dtype.kind not in "iuf" or not np.isfinite(vector).all():
        raise InputError("a vector of three finite numbers", found=given)
    return vector.astype(float)
