"""The ground truth of a sequence, and poses of its frames from any file."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..doubt.depth_pairs import depth_residuals
from ..errors import InputError, StrPath, within
from ..formats.image_names import numbers_in_names
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..trajectory_files.trajectories import LoadedTrajectory, read_trajectory
from .image_pairs import find_rows, frame_numbers
from .layout import Row
from .pose_lines import (
    ImagesOfLines,
    Residuals,
    numbers_only_count,
    tied_by_whole_stamps,
    tied_to_images,
    tied_to_poses,
)
from .sequence_formats import format_of
from .stored_images import read_camera, read_depth_m

#: Folders above a ground truth that may be its sequence: EuRoC's is mav0/NAME/data.csv.
_DEEPEST = 3


def find_truth(folder: Path) -> Path | None:
    """The ground truth of a sequence, or None: a file or folder that read_trajectory can read."""
    return format_of(folder).reader.truth(folder)


def load_truth(folder: Path, **options: Any) -> LoadedTrajectory | None:
    """The ground truth of a sequence as right-handed poses of its camera, and how its file was
    read, or None. options: those of read_trajectory.
    """
    path = find_truth(folder)
    if path is None:
        return None
    loaded = load_poses(folder, path, **options)
    mount = format_of(folder).reader.mount(folder)
    if mount is None:
        return loaded
    own = loaded.trajectory
    poses = Trajectory(own.stamps_s, own.T_world_camera @ mount)
    how = f"{loaded.read_as.sentence}; poses of the camera by T_BS of its file"
    return replace(loaded, trajectory=poses, read_as=replace(loaded.read_as, sentence=how))


def said_of_body(file: Path, loaded: LoadedTrajectory) -> LoadedTrajectory:
    """The poses of a file, and in how they were read that those of the camera differ, if the file
    is the ground truth of a sequence whose camera is mounted on a body.
    """
    for folder in file.absolute().parents[:_DEEPEST]:
        if find_truth(folder) == file.absolute():
            if format_of(folder).reader.mount(folder) is None:
                break
            how = f"poses of the body, without T_BS of the camera; {folder} gives the camera's"
            sentence = f"{loaded.read_as.sentence}; {how}"
            return replace(loaded, read_as=replace(loaded.read_as, sentence=sentence))
    return loaded


def read_truth(folder: Path) -> Trajectory | None:
    """The ground truth of a sequence as right-handed poses of its camera, or None."""
    loaded = load_truth(folder)
    return None if loaded is None else loaded.trajectory


def load_poses(folder: Path, path: StrPath, **options: Any) -> LoadedTrajectory:
    """Poses of a sequence's frames from any file; without stamps and frame numbers in the file, or
    with the images' numbers in place of stamps, the line of each frame is found (pose_lines.py).
    options: those of read_trajectory. Raises InputError if the line cannot be told.
    """
    loaded = read_trajectory(path, **options)
    has_stamps = not (loaded.is_counted or loaded.is_numbered)
    if has_stamps and (loaded.trajectory.stamps_s % 1).any():
        return loaded
    images = _images_of_lines(folder)
    if has_stamps:
        return tied_by_whole_stamps(loaded, images)
    if loaded.is_numbered and not numbers_only_count(loaded, images):
        return loaded
    with within(path):
        return tied_to_images(loaded, images)


def tied_to_sequence(
    folder: Path, truth: LoadedTrajectory, estimate: LoadedTrajectory
) -> tuple[LoadedTrajectory, LoadedTrajectory]:
    """The ground truth of a sequence, and an estimate with the stamps of its images or poses.

    Raises InputError if an estimate without stamps has another number of rows than both.
    """
    if estimate.is_counted:
        images = _images_of_lines(folder)
        if len(images.stamps_s) == estimate.row_count:
            return truth, tied_to_images(estimate, images)
    return tied_to_poses(truth, estimate)


def _images_of_lines(folder: Path) -> ImagesOfLines:
    rows = find_rows(folder)
    numbers = frame_numbers(rows) or _numbers_in_names(rows)
    stamps_s = np.array([row.stamp_s for row in rows])
    return ImagesOfLines(stamps_s, numbers, _residuals_of(folder, rows))


def _numbers_in_names(rows: list[Row]) -> list[int] | None:
    """The numbers in the names of colour images, None if they do not increase; stamps with decimals
    are none.
    """
    names = [row.rgb.name for row in rows if row.rgb and "." not in row.rgb.stem]
    numbers = numbers_in_names(names)
    return numbers if numbers and len(names) == len(rows) and numbers == sorted(numbers) else None


def _residuals_of(folder: Path, rows: list[Row]) -> Residuals:
    """A function that compares the depth of some frames with readings of their poses."""

    def residuals(frames: np.ndarray, readings: list[SE3]) -> list[float]:
        pairs = [rows[frame] for frame in frames.tolist()]
        first = next((row.rgb for row in rows if row.is_pair), None)
        if first is None:
            return [float("nan")] * len(readings)
        camera = read_camera(folder, first)

        def load(frame: int) -> np.ndarray | None:
            depth = pairs[frame].depth
            if depth is None:
                return None
            with suppress(InputError):
                return read_depth_m(depth, camera.depth_units_per_metre)
            return None

        return depth_residuals(load, readings, camera.pinhole)

    return residuals
