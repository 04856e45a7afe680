"""The motion of a camera between the poses of a trajectory file: that of the recipe beside it, if
this makes the file's poses, else a spline through the poses.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import is_file, read_json
from ..geometry import so3
from ..geometry.continuous import ContinuousMotion, RecipeMotion, SplineMotion
from ..geometry.handheld import Recipe
from ..geometry.se3 import Poses
from ..geometry.trajectory import Trajectory
from ..shipped import file_or_trajectory
from .trajectories import read_trajectory

#: Half of the last digits of a file: 1e-6 m, 1e-7 in each of four numbers of a quaternion (twice
#: that in the angle), 1e-6 s.
_ROUNDED_M = 0.5e-6
_ROUNDED_RAD = 2e-7
_ROUNDED_S = 0.5e-6
#: Of poses that were interpolated from others, those in between change the velocity by less than
#: this share of what the others do, in runs of this many: at 240 Hz, seven between two at 30 Hz.
_BETWEEN = 0.1
_LONGEST_RUN = 7
#: Where a motion is from.
EXACT = "the path of the recipe that made the poses"
SPLINE = (
    "no recipe beside it makes these poses: a C2 spline through them, which has no motion above half "
    "their rate (of poses at 30 Hz that tremble at up to 12 Hz it lacks 0.4 m/s^2 RMS)"
)


@dataclass(frozen=True, eq=False)
class CameraPath:
    """The motion of a camera at any time, and where it is from: EXACT or SPLINE. recipe: its
    content, {} of a spline.
    """

    motion: ContinuousMotion
    sentence: str
    recipe: dict[str, Any]

    @property
    def is_exact(self) -> bool:
        """Whether the poses were made from this motion."""
        return bool(self.recipe)


def path_of(trajectory: Trajectory | Poses | StrPath) -> CameraPath:
    """The motion through the poses of a trajectory, of matrices (n, 4, 4) at 30 Hz, of a file, or of
    a built-in trajectory such as `kt2`.

    Raises InputError for a single pose, and for poses that were interpolated from others.
    """
    if not isinstance(trajectory, str | os.PathLike):
        return _spline(Trajectory.of(trajectory))
    file = Path(file_or_trajectory(trajectory))
    poses = read_trajectory(file).trajectory
    try:
        return exact_path(file, poses) or _spline(poses)
    except InputError as error:
        raise error.at(file) from None


def exact_path(file: Path, poses: Trajectory) -> CameraPath | None:
    """The motion of the recipe beside a file, None without one that makes these poses of the file."""
    recipe = file.with_suffix(".json")
    content = read_json(recipe) if recipe != file and is_file(recipe) else {}
    found = _of_recipe(content, poses) if "viewpoints" in content else None
    return None if found is None else CameraPath(found, EXACT, content)


def _of_recipe(content: dict, poses: Trajectory) -> RecipeMotion | None:
    """The motion of a recipe, None if the poses are not on it."""
    try:
        motion = RecipeMotion(Recipe.from_dict(content))
    except InputError:
        return None
    made = motion.states(poses.stamps_s)
    T = made.T_world_body
    off_m = np.abs(T.translation - poses.positions_m)
    turned = np.swapaxes(T.rotation, -1, -2) @ poses.T_world_camera.rotation
    slack_m = _ROUNDED_S * np.abs(made.velocity_m_s) + 1.001 * _ROUNDED_M
    slack_rad = _ROUNDED_S * np.linalg.norm(made.rate_rad_s, axis=1) + 1.001 * _ROUNDED_RAD
    fits = (off_m <= slack_m).all() and (so3.angle(turned) <= slack_rad).all()
    return motion if fits else None


def _spline(poses: Trajectory) -> CameraPath:
    motion = SplineMotion(poses)
    _refuse_interpolated(poses)
    return CameraPath(motion, SPLINE, {})


def _refuse_interpolated(poses: Trajectory) -> None:
    """Raises InputError for poses at twice or more the rate of those that they were interpolated
    from: where the camera moves, a third or more of them lie on short pieces of constant speed, at
    whose ends the velocity jumps.
    """
    velocities = np.diff(poses.positions_m, axis=0) / np.diff(poses.stamps_s)[:, None]
    jumps = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
    speeds = np.linalg.norm(velocities, axis=1)
    moving = np.minimum(speeds[1:], speeds[:-1]) > 0.5 * np.median(speeds)
    if not moving.any():
        return
    between = moving & (jumps < _BETWEEN * np.percentile(jumps[moving], 95))
    share = between.sum() / moving.sum()
    ends = np.flatnonzero(np.diff(between, prepend=False, append=False))
    if share > 1 / 3 and np.median(np.diff(ends)[::2]) <= _LONGEST_RUN:
        found = f"{100 * share:.0f} % of them on straight pieces between others"
        hint = "the trajectory that this was resampled from"
        raise InputError("poses of a smooth motion", found=found, hint=hint)
