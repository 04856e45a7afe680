"""What the format of a sequence is: where its images lie, the text files beside them, and how a folder in it is found and read back.

Each format is a module in layouts/ and one entry of the registry in sequence_formats.py.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..formats.associations import ImageList
from ..formats.files import atomic_write, make_folder, read_json
from ..formats.images import ARRAY, JPEG, image_header
from ..formats.trajectories import write_trajectory
from ..formats.trajectory_file import stamp_text
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_rate_hz, sample, stamps_of_frames
from .depth_units import UNITS_PER_METRE, check_units

#: What a sequence's images are of; further kinds are those of ground truth.
RGB, DEPTH = "rgb", "depth"
CAMERA = "camera.json"
#: A pose belongs to a frame within this share of the usual step between frames.
_SLACK = 0.5


@dataclass(frozen=True)
class SequenceFrame:
    """One pair to be written: the frame's number and its stamp in seconds; and what is kept of a sequence that somebody has, by kind of
    image (rgb, depth): its path in that folder, and its stamp as the lists write it ("" where there is none).
    """

    number: int
    stamp_s: float
    paths: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)

    def stamp_text(self, kind: str = RGB) -> str:
        """Seconds, to the character where the frame comes with a text."""
        return self.written.get(kind) or stamp_text(self.stamp_s)

    def nanoseconds(self, kind: str = RGB) -> int:
        """By the shortest decimal that stands for the stamp: 1305031102.175304 s has no ...303936 ns in it."""
        return round(Decimal(self.written.get(kind) or repr(self.stamp_s)) * 10**9)


class Row(NamedTuple):
    """A pair that was found: stamp in seconds, images, their stamps as the lists write them, and the frame's number where the format has
    one; else it is the one in the colour image's name, or the row.
    """

    stamp_s: float
    rgb: Path
    depth: Path
    written: tuple[str, str] = ("", "")
    number: int | None = None


@dataclass(frozen=True)
class SequenceCamera:
    """The pinhole camera, and how many units of the depth images make a metre; `assumed` where no file gives it. colour: that of the colour
    images where theirs is another one at the same place.
    """

    pinhole: PinholeCamera
    depth_units_per_metre: float = UNITS_PER_METRE
    assumed: bool = False
    colour: PinholeCamera | None = None

    def to_dict(self) -> dict:
        """The content of camera.json."""
        return self.pinhole.to_dict() | {"depth_units_per_metre": self.depth_units_per_metre}


@dataclass(frozen=True, eq=False)
class Contents:
    """What the text files say: frames in order, camera, ground truth (None where there is none), and the format and bytes of a
    ground-truth file, which a sequence in that format keeps as it is.

    surface(number): colour (h, w, 3) uint8 and depth (h, w) in metres of a frame, as close to the true surface as can be had.
    """

    camera: PinholeCamera
    frames: tuple[SequenceFrame, ...]
    truth: Trajectory | None
    depth_units_per_metre: float = UNITS_PER_METRE
    truth_file: tuple[str, bytes] | None = None
    surface: Callable[[int], tuple[np.ndarray, np.ndarray]] | None = None

    @cached_property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds."""
        return np.array([frame.stamp_s for frame in self.frames])

    @property
    def rate_hz(self) -> float:
        """Frames a second by the stamps; the benchmark's for a single frame."""
        return frame_rate_hz(self.stamps_s)

    @cached_property
    def poses(self) -> SE3:
        """(n,) camera to world, one for each frame. Raises InputError where there are none (`check_poses`)."""
        truth = self.truth
        if truth is None:
            raise InputError("poses", found="none")
        if len(truth) < 2:
            return truth.T_world_camera
        return sample(truth, self.stamps_s.clip(*truth.stamps_s[[0, -1]]))

    @property
    def full_camera(self) -> SequenceCamera:
        return SequenceCamera(self.camera, self.depth_units_per_metre)


@dataclass(frozen=True)
class Reader:
    """How a folder of a format is recognised and read.

    rows: its pairs in the order of time; camera(folder, colour image), None where the format has none and nothing says it; truth: the
    file or folder with its poses, None where there is none. All raise InputError for what cannot be read.
    """

    found: Callable[[Path], bool]
    rows: Callable[[Path], list[Row]]
    camera: Callable[[Path, Path], SequenceCamera | None]
    truth: Callable[[Path], Path | None]


@dataclass(frozen=True)
class SequenceFormat:
    """`image` gives the path of a frame's image: its rgb, its depth, or a kind of ground truth; its ending says how the image is stored
    (.png, .jpg, .npy in metres). `write_texts` writes all that is no image; `check` raises InputError for contents that the format
    cannot hold.

    stamps: what it has of them: "text" (to the character), "ns" (whole nanoseconds), "ids" (frame numbers), or nothing but names with
    the frames' "numbers" or the order of the "rows". fixed_units:
    depth units a metre that its readers take for granted; else those asked for. every_pose: a frame without a pose cannot stand in it.
    keeps_names: images keep the paths that they have in a sequence of such a format. fixed_camera: the only one that its programs know. zero_stamp: whether they take a
    stamp of 0.
    """

    name: str
    description: str
    image: Callable[[SequenceFrame, str], str]
    write_texts: "Callable[[Path, Contents, SequenceFormat], None]"
    reader: Reader
    check: Callable[[Contents], object] = lambda contents: None
    stamps: str = "text"
    fixed_units: float | None = None
    every_pose: bool = False
    keeps_names: bool = False
    fixed_camera: PinholeCamera | None = None
    zero_stamp: bool = True

    def images(self, contents: Contents, kind: str) -> ImageList:
        """All images of a kind with their stamps."""
        frames = contents.frames
        paths, written = (tuple(self.image(f, kind) for f in frames), tuple(f.written.get(kind, "") for f in frames))
        return ImageList(tuple(frame.stamp_s for frame in frames), paths, written)

    def checked(self, contents: Contents) -> None:
        """Raises InputError for contents that the format cannot hold."""
        if self.every_pose:
            check_poses(self.name, contents)
        self.check(contents)

    def losses(self, contents: Contents, source_units: float) -> list[str]:
        """What the format does not hold of these contents, a sentence each; `source_units`: depth units a metre that they come with, 0 for
        exact depth.
        """
        frames, found = contents.frames, []
        digits = max((len(text.partition(".")[2]) for f in frames for text in f.written.values()), default=0)
        if self.stamps == "ns" and digits > 9:
            found.append(f"stamps have 9 digits after the point, those of the source up to {digits}")
        if self.stamps in ("numbers", "rows"):
            counted = [frame.number if self.stamps == "numbers" else row for row, frame in enumerate(frames)]
            kept = np.abs(stamps_of_frames(counted) - contents.stamps_s).max() <= 1e-6
            found += [] if kept else ["there are no stamps in this format; its frames are read at 30 a second"]
        if not self.zero_stamp and contents.stamps_s.min() <= 0:
            found.append("its programs take a stamp of 0 for none, and fail; the stamps are kept as they are")
        if self.image(frames[0], RGB).endswith(JPEG):
            found.append("colour is stored as JPEG, with loss")
        units = contents.depth_units_per_metre
        if not self.image(frames[0], DEPTH).endswith(ARRAY) and units < source_units:
            found.append(f"depth is stored in {units:g} units a metre; the source has {source_units:g}")
        if (c := self.fixed_camera) and np.abs(c.intrinsics - contents.camera.intrinsics).max() > 1e-3:
            known = f"{c.width}x{c.height},{c.fx:g},{c.fy:g},{c.cx:g},{c.cy:g}"
            found.append(f"its programs know only the camera {known}; the right one is in {CAMERA}")
        return [f"{self.name}: {sentence}" for sentence in found]


def posed(stamps_s: np.ndarray, truth: Trajectory | None) -> np.ndarray:
    """(n,) bool: which frames at the stamps (n,) have a pose of the trajectory, within half a usual step."""
    if truth is None:
        return np.zeros(len(stamps_s), bool)
    own = truth.stamps_s
    after = np.searchsorted(own, stamps_s).clip(1, max(1, len(own) - 1))
    near = np.abs(own[np.stack([after - 1, np.minimum(after, len(own) - 1)])] - stamps_s).min(0)
    return near <= _SLACK * usual_step_s(stamps_s) + 1e-6


def usual_step_s(stamps_s: np.ndarray) -> float:
    """Median step between stamps (n,) in any order; that of 30 frames a second for a single one."""
    return float(np.median(np.diff(np.sort(stamps_s)))) if len(stamps_s) > 1 else 1 / 30


def check_poses(name: str, contents: Contents) -> None:
    """Raises InputError where a frame has no pose, for formats in which each needs one."""
    without = np.flatnonzero(~posed(contents.stamps_s, contents.truth))
    if without.size:
        found = "no ground truth" if contents.truth is None else f"{without.size} of {len(contents.frames)} without"
        raise InputError(f"a pose for every frame for the format {name}", found=found, hint="the format tum")


def write_truth(path: Path, contents: Contents, format: str) -> None:
    """A ground-truth file, where there is ground truth; one that is kept, byte for byte."""
    kept_format, data = contents.truth_file or ("", b"")
    if contents.truth is not None:
        make_folder(path.parent)
    if kept_format == format:
        atomic_write(path, lambda temporary: temporary.write_bytes(data))
    elif contents.truth is not None:
        write_trajectory(path, contents.truth, format)


def camera_file(folder: Path) -> SequenceCamera | None:
    """camera.json there: ours, in any format. None where there is none."""
    if not (folder / CAMERA).is_file():
        return None
    settings = read_json(folder / CAMERA)
    units = settings.pop("depth_units_per_metre", UNITS_PER_METRE)
    if isinstance(units, bool) or not isinstance(units, int | float):
        raise InputError("depth_units_per_metre as a number", path=folder / CAMERA, found=units)
    return SequenceCamera(PinholeCamera.from_dict(settings), check_units(units))


def pinhole_of(image: Path, fx: float, fy: float, cx: float, cy: float) -> PinholeCamera:
    """The camera of an image's size. The original's fy < 0 means that y points up."""
    header = image_header(image)
    return PinholeCamera(header.width, header.height, fx, abs(fy), cx, cy)


def numbers_in(path: Path, values: list[str], count: int, what: str) -> list[float]:
    """`count` finite numbers. Raises InputError naming the file."""
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(what, path=path, found=" ".join(map(str, values))[:80] or "nothing")
    return numbers
