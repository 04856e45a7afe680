"""The contents of the text files of a sequence that is written, in any format."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..channels import BASE, Channel
from ..errors import InputError
from ..formats.depth_units import UNITS_PER_METRE
from ..formats.files import atomic_write_bytes, make_folder
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_rate_hz, sample
from ..trajectory_files.trajectories import write_trajectory
from .camera_files import SequenceCamera
from .frames import SequenceFrame, posed
from .imu import SequenceImu


@dataclass(frozen=True, eq=False)
class Contents:
    """The content of the text files: frames in order, camera, ground truth (or None), and the
    format and bytes of a ground-truth file, which is copied unchanged to a sequence in that format.

    surface(number): colour (h, w, 3) uint8 and depth (h, w) in metres of a frame, as close to the
    true surface as possible. imu: the readings around the frames, None without any.
    """

    camera: PinholeCamera
    frames: tuple[SequenceFrame, ...]
    truth: Trajectory | None
    depth_units_per_metre: float = UNITS_PER_METRE
    truth_file: tuple[str, bytes] | None = None
    surface: Callable[[int], tuple[np.ndarray, np.ndarray]] | None = None
    channels: tuple[Channel, ...] = BASE
    imu: SequenceImu | None = None

    @cached_property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds."""
        return np.array([frame.stamp_s for frame in self.frames])

    @property
    def rate_hz(self) -> float:
        """Frames per second, from the stamps; the benchmark's rate for a single frame."""
        return frame_rate_hz(self.stamps_s)

    @cached_property
    def poses(self) -> SE3:
        """(n,) camera to world, one for each frame.

        Raises InputError if there are none (`check_poses`).
        """
        truth = self.truth
        if truth is None:
            raise InputError("poses", found="none")
        if len(truth) < 2:
            return truth.T_world_camera
        return sample(truth, self.stamps_s.clip(*truth.stamps_s[[0, -1]]))

    @property
    def full_camera(self) -> SequenceCamera:
        return SequenceCamera(self.camera, self.depth_units_per_metre)


def check_poses(name: str, contents: Contents) -> None:
    """Raises InputError if a frame has no pose, for formats in which each frame needs one."""
    without = np.flatnonzero(~posed(contents.stamps_s, contents.truth))
    if without.size:
        found = f"{without.size} of {len(contents.frames)} without"
        if contents.truth is None:
            found = "no ground truth"
        expected = f"a pose for every frame for the format {name}"
        raise InputError(expected, found=found, hint="the format tum")


def write_truth(path: Path, contents: Contents, format: str) -> None:
    """Write the ground-truth file, if there is ground truth.

    A file that is already in this format is copied byte for byte.
    """
    kept_format, data = contents.truth_file or ("", b"")
    if contents.truth is not None:
        make_folder(path.parent)
    if kept_format == format:
        atomic_write_bytes(path, data)
    elif contents.truth is not None:
        write_trajectory(path, contents.truth, format)


def write_truth_of_body(path: Path, contents: Contents, format: str) -> None:
    """Like write_truth; with an IMU, poses of the IMU, in formats whose body it is."""
    kept = contents.truth_file is not None and contents.truth_file[0] == format
    if contents.imu is not None and contents.truth is not None and not kept:
        contents = replace(contents, truth=contents.imu.states_of(contents.truth)[0])
    write_truth(path, contents, format)
