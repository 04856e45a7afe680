"""A sequence in a folder or a bag, opened: its format, frames, camera and ground truth."""

import copy
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import DEPTH, FURTHER, RGB
from ..doubt.depth_pairs import depth_residuals
from ..errors import InputError, StrPath, within
from ..formats.bags import is_bag
from ..formats.depth_units import LARGEST_UNIT, metres_from_depth16
from ..formats.files import is_file, real_path
from ..formats.image_names import files_in, numbers_in_names
from ..formats.images import METRES, image_header, read_colour8, read_metres, seen_by
from ..formats.png import read_depth16
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..trajectory_files.trajectories import LoadedTrajectory, read_trajectory
from .camera_files import SequenceCamera
from .format import SequenceFormat
from .frames import ImagePair, Row, frame_numbers, missing_is_largest
from .imu import SequenceImu
from .other_folders import known_folder
from .pose_lines import (
    ImagesOfLines,
    numbers_only_count,
    tied_by_whole_stamps,
    tied_to_images,
    tied_to_poses,
)
from .sequence_formats import format_of

#: Names, without ending, of further images in a format that stores them beside the depth.
_FURTHER_IMAGE = re.compile(f"({'|'.join(FURTHER)})[0-9]+")
#: Folders above a ground truth that may be its sequence: EuRoC's is mav0/NAME/data.csv.
_DEEPEST = 3
_CAMERA_HINT = (
    "a camera.json in this folder with width, height, fx, fy, cx, cy, "
    "or {camera} WIDTHxHEIGHT,FX,FY,CX,CY"
)


class StoredSequence:
    """A sequence in any known format (sequence_formats.py). What it is asked for is read from the
    folder at first use, and kept: make one, and hand it on.

    Its properties raise InputError for files that cannot be read.
    """

    def __init__(self, folder: StrPath, allow_outside: bool = False) -> None:
        """allow_outside: read images outside the folder that its lists name; without it, links
        that lie in the folder are the only way out of it.
        """
        self.folder = Path(folder)
        self._allow_outside = allow_outside

    def __repr__(self) -> str:
        return f"StoredSequence({self.folder})"

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: a format has functions without a name, and is detected again."""
        return {name: value for name, value in vars(self).items() if name != "format"}

    def with_camera(self, camera: SequenceCamera) -> "StoredSequence":
        """The same sequence, read with this camera in place of its own."""
        other = copy.copy(self)
        other.camera = camera
        return other

    def check(self) -> None:
        """Raises InputError if there are no pairs, no camera, or a ground truth that cannot be
        read.
        """
        assert self.pairs and self.camera and (self.truth is None or len(self.truth))

    @cached_property
    def format(self) -> SequenceFormat:
        """The format; tum if none is detected."""
        return format_of(self.folder)

    @cached_property
    def rows(self) -> list[Row]:
        """The frames in the order of time, also those without one of the images.

        Raises InputError if there is no such folder or bag, and for an image outside the folder.
        """
        if not self.folder.is_dir() and not is_bag(self.folder):
            found = "a file" if self.folder.exists() else "nothing"
            expected = "a folder with a sequence, or a ROS bag"
            is_record3d = self.folder.suffix.lower() == ".r3d"
            hint = "Record3D's export as EXR and JPG" if is_record3d else None
            raise InputError(expected, path=self.folder, found=found, hint=hint)
        rows = self.format.reader.rows(self.folder)
        if not (self._allow_outside or is_bag(self.folder)):
            self._refuse_outside(rows)
        return rows

    def _refuse_outside(self, rows: list[Row]) -> None:
        for path in chain.from_iterable((row.rgb, row.depth) for row in rows):
            if path is not None and leads_outside(path, self.folder):
                expected = "lists that name images in the sequence's folder"
                hint = "{allow_outside} if you trust them, or a link in the folder"
                found = os.path.relpath(path, self.folder)
                raise InputError(expected, path=self.folder, found=found, hint=hint)

    @cached_property
    def pairs(self) -> list[ImagePair]:
        """The frames that have both images, in the order of time.

        Raises InputError if there are none.
        """
        whole = [row for row in self.rows if row.rgb is not None and row.depth is not None]
        numbers = frame_numbers(whole) or list(range(len(whole)))
        pairs = []
        for number, row in zip(numbers, whole, strict=True):
            if row.rgb is not None and row.depth is not None and row.is_pair:
                pairs.append(ImagePair(number, row.stamp_s, row.rgb, row.depth, row.written))
        if not pairs:
            raise self._no_pairs(whole)
        return pairs

    @cached_property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds of the pairs."""
        return np.array([pair.stamp_s for pair in self.pairs])

    @cached_property
    def camera(self) -> SequenceCamera:
        """The camera of the pairs."""
        return self.camera_of(self.pairs[0].rgb)

    def camera_of(self, image: Path) -> SequenceCamera:
        """The camera in the sequence's files, for a colour image of it; else the benchmark's camera
        if the image has 640 x 480 pixels. Raises InputError for another size.
        """
        with within(self.folder):
            there = self.format.reader.camera(self.folder, image)
        if there is not None:
            return there
        header = image_header(image)
        if (header.width, header.height) != (640, 480):
            found = f"images of {header.width} x {header.height} and no camera.json"
            raise InputError("a camera", path=self.folder, found=found, hint=_CAMERA_HINT)
        return SequenceCamera(PinholeCamera(), assumed=True)

    def images(self, pair: ImagePair) -> tuple[np.ndarray, np.ndarray]:
        """Colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres of a pair."""
        return read_images(pair, self.camera)

    @cached_property
    def truth_path(self) -> Path | None:
        """The ground truth, or None: a file or folder that read_trajectory can read."""
        return self.format.reader.truth(self.folder)

    @cached_property
    def mount(self) -> SE3 | None:
        """The pose of the camera in the frame that the ground truth follows, None if that is the
        camera's.
        """
        return self.format.reader.mount(self.folder)

    @cached_property
    def imu(self) -> SequenceImu | None:
        """The readings of the IMU, None without any."""
        return self.format.reader.imu(self.folder)

    @cached_property
    def loaded_truth(self) -> LoadedTrajectory | None:
        """The ground truth as right-handed poses of the camera, and how its file was read."""
        return self.load_truth()

    @property
    def truth(self) -> Trajectory | None:
        """The ground truth as right-handed poses of the camera, or None."""
        return None if self.loaded_truth is None else self.loaded_truth.trajectory

    def load_truth(self, **options: Any) -> LoadedTrajectory | None:
        """The ground truth, read with options of read_trajectory."""
        if self.truth_path is None:
            return None
        loaded = self.load_poses(self.truth_path, **options)
        if self.mount is None:
            return loaded
        own = loaded.trajectory
        poses = Trajectory(own.stamps_s, own.T_world_camera @ self.mount)
        how = f"{loaded.read_as.sentence}; poses of the camera by T_BS of its file"
        return replace(loaded, trajectory=poses, read_as=replace(loaded.read_as, sentence=how))

    def load_poses(self, path: StrPath, **options: Any) -> LoadedTrajectory:
        """Poses of the frames from any file; without stamps and frame numbers in the file, or with
        the images' numbers in place of stamps, the line of each frame is found (pose_lines.py).
        options: those of read_trajectory. Raises InputError if the line cannot be told.
        """
        loaded = read_trajectory(path, **options)
        has_stamps = not (loaded.is_counted or loaded.is_numbered)
        if has_stamps and (loaded.trajectory.stamps_s % 1).any():
            return loaded
        images = self._images_of_lines
        if has_stamps:
            return tied_by_whole_stamps(loaded, images)
        if loaded.is_numbered and not numbers_only_count(loaded, images):
            return loaded
        with within(path):
            return tied_to_images(loaded, images)

    def tied(
        self, truth: LoadedTrajectory, estimate: LoadedTrajectory
    ) -> tuple[LoadedTrajectory, LoadedTrajectory]:
        """The ground truth, and an estimate with the stamps of the images or poses.

        Raises InputError if an estimate without stamps has another number of rows than both.
        """
        if estimate.is_counted:
            images = self._images_of_lines
            if len(images.stamps_s) == estimate.row_count:
                return truth, tied_to_images(estimate, images)
        return tied_to_poses(truth, estimate)

    def missing_images(self) -> list[Path]:
        """The images of the lists that do not exist."""
        found = []
        for row in self.rows:
            found += [path for path in (row.rgb, row.depth) if path and not is_file(path)]
        return found

    def unused_images(self) -> dict[str, list[Path]]:
        """The images in the folders of the pairs that are in none, by kind: they have no partner,
        or are in no list.
        """
        images = {RGB: [p.rgb for p in self.pairs], DEPTH: [p.depth for p in self.pairs]}
        used = set(map(real_path, chain.from_iterable(images.values())))
        found = {}
        for kind, paths in images.items():
            there: set[Path] = set()
            for parent, ending in {(path.parent, path.suffix) for path in paths}:
                there.update(map(real_path, files_in(parent, f"*{ending}")))
            unused = there - used
            found[kind] = sorted(path for path in unused if not _FURTHER_IMAGE.fullmatch(path.stem))
        return found

    def _no_pairs(self, rows: list[Row]) -> InputError:
        folder = self.folder
        inside = sorted(path.parent.name for path in folder.glob("*/recipe.json"))
        found = "none"
        if rows:
            images = (rows[0].rgb, rows[0].depth)
            missing = next(path for path in images if path and not is_file(path))
            first = os.path.relpath(missing, folder)
            found = f"none in {len(rows)} frames, the first of which has no {first}"
            hint = "the folder that the lists are relative to"
        elif inside:
            hint = f"a folder inside: {', '.join(inside)}"
        elif known := known_folder(folder):
            found, hint = known
        elif all(files_in(folder / kind) for kind in (RGB, DEPTH)):
            hint = "equal file names in rgb/ (PNG or JPEG) and depth/ (PNG, EXR or NumPy), "
            hint += "or rgb.txt and depth.txt with their stamps"
        else:
            hint = "a folder with rgb/*.png and depth/*.png"
        expected = "pairs of colour and depth images"
        return InputError(expected, path=folder, found=found, hint=hint)

    @cached_property
    def _images_of_lines(self) -> ImagesOfLines:
        numbers = frame_numbers(self.rows) or _numbers_in_names(self.rows)
        stamps_s = np.array([row.stamp_s for row in self.rows])
        return ImagesOfLines(stamps_s, numbers, self._residuals)

    def _residuals(self, frames: np.ndarray, readings: Sequence[SE3]) -> list[float]:
        """Of readings of the poses of some rows, the relative difference between depth and poses;
        NaN without a pair of images.
        """
        if not any(row.is_pair for row in self.rows):
            return [float("nan")] * len(readings)
        camera = self.camera

        def load(frame: int) -> np.ndarray | None:
            depth = self.rows[frames[frame]].depth
            if depth is None:
                return None
            with suppress(InputError):
                return read_depth_m(depth, camera.depth_units_per_metre)
            return None

        return depth_residuals(load, readings, camera.pinhole)


def leads_outside(path: Path, folder: Path) -> bool:
    """Whether the name of a path leads out of a folder. Links that lie in the folder are followed,
    but not `..` behind one of them.
    """
    own = Path(os.path.normpath(folder))
    if not Path(os.path.normpath(path)).is_relative_to(own):
        return True
    for k, part in enumerate(path.parts):
        before = Path(*path.parts[:k])
        if part == ".." and before.is_relative_to(folder):
            by_name = os.path.relpath(os.path.normpath(before), own)
            if real_path(before) != real_path(own) / by_name:
                return True
    return False


def opened(sequence: StoredSequence | StrPath) -> StoredSequence:
    """The sequence itself, or that in a folder."""
    return sequence if isinstance(sequence, StoredSequence) else StoredSequence(sequence)


def _numbers_in_names(rows: list[Row]) -> list[int] | None:
    """The numbers in the names of colour images, None if they do not increase; stamps with decimals
    are none.
    """
    names = [row.rgb.name for row in rows if row.rgb and "." not in row.rgb.stem]
    numbers = numbers_in_names(names)
    return numbers if numbers and len(names) == len(rows) and numbers == sorted(numbers) else None


def noted_mount(file: Path, loaded: LoadedTrajectory) -> LoadedTrajectory:
    """The poses of a file, and in how they were read that those of the camera differ, if the file
    is the ground truth of a sequence whose camera is mounted on a body.
    """
    for folder in file.absolute().parents[:_DEEPEST]:
        sequence = StoredSequence(folder)
        if sequence.truth_path == file.absolute():
            if sequence.mount is None:
                break
            how = f"poses of the body, without T_BS of the camera; {folder} gives the camera's"
            sentence = f"{loaded.read_as.sentence}; {how}"
            return replace(loaded, read_as=replace(loaded.read_as, sentence=sentence))
    return loaded


def read_depth_m(path: Path, units_per_metre: float) -> np.ndarray:
    """Read (h, w) float32 planar metres, 0 = missing, from a 16-bit PNG or an image of metres,
    whose NaN and infinity are missing depth.

    Raises InputError.
    """
    if path.suffix.lower() in METRES:
        depth_z_m = read_metres(path)
        return np.where(np.isfinite(depth_z_m), depth_z_m, np.float32(0))
    units = read_depth16(path)
    if missing_is_largest(path):
        units[units == LARGEST_UNIT] = 0
    return metres_from_depth16(units, units_per_metre)


def read_images(pair: ImagePair, camera: SequenceCamera) -> tuple[np.ndarray, np.ndarray]:
    """Read colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres of a pair, both of the
    camera's size. Raises InputError.
    """
    colour = read_colour8(pair.rgb)
    depth_z_m = read_depth_m(pair.depth, camera.depth_units_per_metre)
    c = camera.pinhole
    for path, image, of in ((pair.rgb, colour, camera.colour or c), (pair.depth, depth_z_m, c)):
        if image.shape[:2] != (of.height, of.width):
            expected = f"{of.width} x {of.height} as in the camera"
            found = f"{image.shape[1]} x {image.shape[0]}"
            hint = "{camera} with the size of the images"
            raise InputError(expected, path=path, found=found, hint=hint)
    if camera.colour is not None:
        colour = seen_by(colour, camera.colour.K, c.K, c.width, c.height)
    return colour, depth_z_m
