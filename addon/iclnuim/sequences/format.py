"""A sequence format: the paths of its images, its text files, what it cannot store, and how a
folder in this format is detected and read.

Each format is a module in layouts/ and an entry of the registry in sequence_formats.py.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from ..channels import DEPTH, RGB
from ..errors import StrPath
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import stamps_of_frames
from .associations import ImageList
from .camera_files import CAMERA, SequenceCamera
from .contents import Contents, check_poses
from .frames import Row, SequenceFrame
from .imu import SequenceImu

SORTED = "sorted"
PUBLISHED = "published"
#: name -> what it means
NAME_FORMS = {
    SORTED: "names sort as time, as text too: stamps and numbers have a constant number of digits",
    PUBLISHED: "names as in the data sets of each format: rgb/0.png in icl-nuim, "
    "frames/color/0.jpg in scannet, no zeros before stamps in eth3d, euroc and rtabmap",
}
#: The form of a folder whose recipe has no form: published names, and, in these formats, the
#: requested depth units.
UNRECORDED = ""
_REQUESTED_UNITS = ("euroc", "nerf")
#: The path of a frame's image of a kind, or the text of its stamp.
OfImage = Callable[[SequenceFrame, str], str]


@dataclass(frozen=True)
class Reader:
    """How a folder in a format is detected and read.

    found: whether a folder has the format; rows: its pairs in the order of time; camera(folder,
    colour image): None if no file contains it; truth: the file or folder with its poses, None if
    there is none; mount: the pose of the camera in the frame that the ground truth follows, None
    if that is the camera's; imu: the readings of an IMU, None without any. All raise InputError for
    files that cannot be read.
    """

    found: Callable[[Path], bool]
    rows: Callable[[Path], list[Row]]
    camera: Callable[[Path, Path], SequenceCamera | None]
    truth: Callable[[Path], Path | None]
    mount: Callable[[Path], SE3 | None] = lambda folder: None
    imu: Callable[[Path], SequenceImu | None] = lambda folder: None


@dataclass(frozen=True)
class FormatLimits:
    """What the files of a format, or the programs for it, cannot represent.

    stamps: how stamps are stored: "text" (exact text), "ns" (whole nanoseconds), "ids" (frame
    numbers), or not at all: only frame "numbers" in names. depth_stamps: whether a depth image can
    have another stamp than its colour image. zero_stamp: whether the programs accept a stamp of 0.
    fixed_units: the depth units per metre that they assume; None: the requested units.
    fixed_camera: the only camera that they support. depth_width: the most columns that depth images
    have, if less than colour. confidence: whether a phone's confidence of depth is stored. every_pose: each frame must have a pose. imu: whether the readings of
    an IMU are stored.
    check(contents): raises InputError for other contents that cannot be represented.
    remarks(contents): further sentences for `losses`.
    """

    stamps: str = "text"
    depth_stamps: bool = True
    zero_stamp: bool = True
    fixed_units: float | None = None
    fixed_camera: PinholeCamera | None = None
    depth_width: int | None = None
    confidence: bool = False
    every_pose: bool = False
    imu: bool = False
    check: Callable[[Contents], object] = lambda contents: None
    remarks: Callable[[Contents], list[str]] = lambda contents: []

    def stamp_losses(self, contents: Contents) -> list[str]:
        """What is lost of the stamps, one sentence each."""
        frames = contents.frames
        found = []
        written = chain.from_iterable(frame.written.values() for frame in frames)
        digits = max((len(text.partition(".")[2]) for text in written), default=0)
        if self.stamps == "ns" and digits > 9:
            found.append(
                f"stamps have 9 digits after the decimal point, those of the source up to {digits}"
            )
        apart_s = max(abs(f.nanoseconds(RGB) - f.nanoseconds(DEPTH)) for f in frames) / 1e9
        if not self.depth_stamps and apart_s > 0:
            found.append(
                "depth images get the stamps of their colour images, "
                f"up to {1e3 * apart_s:.3g} ms from their own"
            )
        if self.stamps == "numbers":
            counted = [frame.number for frame in frames]
            if not np.abs(stamps_of_frames(counted) - contents.stamps_s).max() <= 1e-6:
                found.append(
                    "this format has no stamps; its frames are read at 30 frames per second"
                )
        if not self.zero_stamp and contents.stamps_s.min() <= 0:
            found.append(
                "its programs treat a stamp of 0 as missing, and fail; the stamps are not changed"
            )
        return found

    def camera_losses(self, contents: Contents) -> list[str]:
        """A sentence if the programs do not support the camera, or store less of its depth."""
        camera = self.fixed_camera
        whole = contents.camera
        if self.depth_width and whole.width > self.depth_width:
            small = whole.narrowed(self.depth_width)
            return [f"depth has {small.width} x {small.height} pixels, as that of a phone"]
        if not camera or np.abs(camera.intrinsics - contents.camera.intrinsics).max() <= 1e-3:
            return []
        size = f"{camera.width}x{camera.height}"
        known = f"{size},{camera.fx:g},{camera.fy:g},{camera.cx:g},{camera.cy:g}"
        return [f"its programs support only the camera {known}; the correct camera is in {CAMERA}"]


@dataclass(frozen=True)
class SequenceFormat:
    """A sequence format. `image` returns the path of a frame's image (rgb, depth, or a kind of
    ground truth); its ending determines how the image is stored (.png, .jpg, .npy in metres).
    `write_texts` writes all files that are not images.

    keeps_names: images from a sequence in such a format keep their paths. list_stamp: the text of
    a frame's stamp in the lists if it is not the usual one. published_image: `image` with the names
    of the published data sets, if these differ.
    """

    name: str
    description: str
    image: OfImage
    write_texts: "Callable[[Path, Contents, SequenceFormat], None]"
    reader: Reader
    limits: FormatLimits = FormatLimits()
    keeps_names: bool = False
    list_stamp: OfImage | None = None
    published_image: OfImage | None = None

    def named(self, form: str) -> "SequenceFormat":
        """The format with names of a form, one of NAME_FORMS or UNRECORDED."""
        if form == SORTED:
            return self
        format = self
        if form == UNRECORDED and self.name in _REQUESTED_UNITS:
            format = replace(format, limits=replace(format.limits, fixed_units=None))
        if format.published_image is None:
            return format
        return replace(format, image=format.published_image, list_stamp=None)

    def images(self, contents: Contents, kind: str) -> ImageList:
        """All images of a kind with their stamps."""
        frames = contents.frames
        paths = tuple(self.image(frame, kind) for frame in frames)
        stamp = self.list_stamp or (lambda frame, kind: frame.written.get(kind, ""))
        written = tuple(stamp(frame, kind) for frame in frames)
        return ImageList(tuple(frame.stamp_s for frame in frames), paths, written)

    def checked(self, contents: Contents) -> None:
        """Raises InputError for contents that the format cannot represent."""
        if self.limits.every_pose:
            check_poses(self.name, contents)
        self.limits.check(contents)

    def losses(self, contents: Contents, source_units: float) -> list[str]:
        """The losses when these contents are written in this format, one sentence each.
        `source_units`: depth units per metre of the source, 0 for exact depth.
        """
        found = self.limits.stamp_losses(contents)
        for channel in contents.channels:
            ending = Path(self.image(contents.frames[0], channel.name)).suffix
            found.append(channel.loss(ending, contents.depth_units_per_metre, source_units))
        found += self.limits.camera_losses(contents) + self.limits.remarks(contents)
        if contents.imu is not None and not self.limits.imu:
            found.append("the readings of the IMU are not stored")
        return [f"{self.name}: {sentence}" for sentence in found if sentence]


def common_units(formats: Sequence[SequenceFormat], requested: float) -> float:
    """Depth units per metre: the requested ones, unless all formats have the same fixed units."""
    fixed = {format.limits.fixed_units for format in formats}
    if len(fixed) > 1:
        return requested
    return fixed.pop() or requested


def truth_at(file: StrPath) -> Callable[[Path], Path | None]:
    """A function that returns this file of a folder, None if it does not exist."""

    def find(folder: Path) -> Path | None:
        return folder / file if (folder / file).is_file() else None

    return find
