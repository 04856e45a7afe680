"""The description of a sequence format: the paths of its images, its text files, and how a folder
in this format is detected and read.

Each format is a module in layouts/ and an entry of the registry in sequence_formats.py.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..channels import BASE, DEPTH, RGB, Channel
from ..errors import InputError, StrPath, within
from ..evaluation.associate import nearest
from ..formats.depth_units import UNITS_PER_METRE, check_units
from ..formats.files import atomic_write, is_file, make_folder, read_json
from ..formats.image_names import by_numbers, numbers_in_names
from ..formats.images import image_header
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_rate_hz, sample, stamps_of_frames
from ..trajectory_files.stamps import nanoseconds_of, seconds_of_names, stamp_name, stamp_text
from ..trajectory_files.trajectories import write_trajectory
from .associations import ImageList
from .known_keys import COEFFICIENTS, Keys, names

CAMERA = "camera.json"
#: Maximum distance in time between a pose and its frame, as a share of the usual step between
#: frames.
_SLACK = 0.5
_DECIMAL = re.compile(r"[0-9]+(\.[0-9]+)?")


@dataclass(frozen=True)
class SequenceFrame:
    """One pair to be written: the frame's number and its stamp in seconds. For a user-provided
    sequence also, by kind of image (rgb, depth): the path in that folder, and the text of the stamp
    in its lists ("" if there is none).
    """

    number: int
    stamp_s: float
    paths: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)

    def stamp_text(self, kind: str = RGB) -> str:
        """The stamp in seconds as text; the original text if there is one."""
        return self.written.get(kind) or stamp_text(self.stamp_s)

    def stamp_name(self, kind: str = RGB) -> str:
        """The stamp in seconds with a constant number of digits before the decimal point."""
        text = self.written.get(kind, "")
        if not _DECIMAL.fullmatch(text):
            text = stamp_text(self.stamp_s)
        return stamp_name(text)

    def nanoseconds(self, kind: str = RGB) -> int:
        """The stamp in nanoseconds, from the text in its list if there is one."""
        return nanoseconds_of(self.written.get(kind) or self.stamp_s)


class Row(NamedTuple):
    """A frame that was found: stamp in seconds, images, the texts of their stamps in the lists, and
    the frame's number if the format has one. Otherwise the number is that in the colour image's
    name, or the row. An image that is missing is None, or a file that does not exist.
    """

    stamp_s: float
    rgb: Path | None
    depth: Path | None
    written: tuple[str, str] = ("", "")
    number: int | None = None

    @property
    def is_pair(self) -> bool:
        """Whether both images exist."""
        return all(path is not None and is_file(path) for path in (self.rgb, self.depth))


def rows_by_name(colours: Mapping[str, Path], depths: Mapping[str, Path]) -> list[Row]:
    """A row for each name of a colour or depth image, in the order of the numbers in the names:
    frame numbers, or stamps in a known unit. Names without numbers are counted from 0.

    Raises InputError for another unit of time, and for colour images that are counted from another
    number than depth images.
    """
    names = sorted(colours.keys() | depths.keys(), key=by_numbers)
    numbers = numbers_in_names(names)
    if numbers is None:
        numbers = list(range(len(names)))
        stamps = None
    else:
        names = [name for _, name in sorted(zip(numbers, names, strict=True))]
        numbers.sort()
        _check_counting(dict(zip(names, numbers, strict=True)), colours, depths)
        stamps = seconds_of_names(numbers)
    rows = []
    for name, number, stamp_s in zip(
        names, numbers, stamps_of_frames(numbers).tolist(), strict=True
    ):
        rows.append(Row(stamp_s, colours.get(name), depths.get(name), number=number))
    if stamps is None:
        return rows
    stamped = zip(rows, *stamps, strict=True)
    return [Row(s, row.rgb, row.depth, (text, text)) for row, s, text in stamped]


def _check_counting(
    numbers: Mapping[str, int], colours: Mapping[str, Path], depths: Mapping[str, Path]
) -> None:
    """Raises InputError if as many colour as depth images have other numbers, all by the same
    difference.
    """
    of_colour, of_depth = (sorted(numbers[name] for name in kind) for kind in (colours, depths))
    apart = {d - c for c, d in zip(of_colour, of_depth, strict=False)}
    if len(of_colour) != len(of_depth) or len(apart) > 1 or apart <= {0}:
        return
    found = f"rgb {of_colour[0]} to {of_colour[-1]}, depth {of_depth[0]} to {of_depth[-1]}"
    hint = "equal names, or associations.txt (stamp, colour image, stamp, depth image)"
    raise InputError("colour and depth images with the same numbers", found=found, hint=hint)


@dataclass(frozen=True)
class SequenceCamera:
    """The pinhole camera, and the depth units per metre. assumed: no file contains the camera.
    colour: the camera of the colour images if it differs; it has the same pose. notes: a sentence
    for everything in its file that is not applied, such as a lens distortion.
    """

    pinhole: PinholeCamera
    depth_units_per_metre: float = UNITS_PER_METRE
    assumed: bool = False
    colour: PinholeCamera | None = None
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict:
        """The content of camera.json."""
        return self.pinhole.to_dict() | {"depth_units_per_metre": self.depth_units_per_metre}


@dataclass(frozen=True, eq=False)
class Contents:
    """The content of the text files: frames in order, camera, ground truth (or None), and the
    format and bytes of a ground-truth file, which is copied unchanged to a sequence in that format.

    surface(number): colour (h, w, 3) uint8 and depth (h, w) in metres of a frame, as close to the
    true surface as possible.
    """

    camera: PinholeCamera
    frames: tuple[SequenceFrame, ...]
    truth: Trajectory | None
    depth_units_per_metre: float = UNITS_PER_METRE
    truth_file: tuple[str, bytes] | None = None
    surface: Callable[[int], tuple[np.ndarray, np.ndarray]] | None = None
    channels: tuple[Channel, ...] = BASE

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


@dataclass(frozen=True)
class Reader:
    """How a folder in a format is detected and read.

    found: whether a folder has the format; rows: its pairs in the order of time; camera(folder,
    colour image): None if no file contains it; truth: the file or folder with its poses, None if
    there is none; mount: the pose of the camera in the frame that the ground truth follows, None
    if that is the camera's. All raise InputError for files that cannot be read.
    """

    found: Callable[[Path], bool]
    rows: Callable[[Path], list[Row]]
    camera: Callable[[Path, Path], SequenceCamera | None]
    truth: Callable[[Path], Path | None]
    mount: Callable[[Path], SE3 | None] = lambda folder: None


@dataclass(frozen=True)
class SequenceFormat:
    """A sequence format. `image` returns the path of a frame's image (rgb, depth, or a kind of
    ground truth); its ending determines how the image is stored (.png, .jpg, .npy in metres).
    `write_texts` writes all files that are not images; `check` raises InputError for contents that
    the format cannot represent.

    stamps: how stamps are stored: "text" (exact text), "ns" (whole nanoseconds), "ids" (frame
    numbers), or not at all: only frame "numbers" in names. fixed_units:
    the depth units per metre that programs for this format assume; None: the requested units.
    every_pose: each frame must have a pose. keeps_names: images from a sequence in such a format
    keep their paths. fixed_camera: the only camera that programs for this format support.
    zero_stamp: whether these programs accept a stamp of 0. depth_stamps: whether a depth image can
    have another stamp than its colour image. remarks(contents): further sentences for `losses`.
    list_stamp: the text of a frame's stamp in the lists if it is not the usual one, and
    published_image: `image` with the names of the published data sets, if these differ.
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
    depth_stamps: bool = True
    remarks: Callable[[Contents], list[str]] = lambda contents: []
    list_stamp: Callable[[SequenceFrame, str], str] | None = None
    published_image: Callable[[SequenceFrame, str], str] | None = None

    @property
    def published(self) -> "SequenceFormat":
        """The format with the names of the published data sets."""
        if self.published_image is None:
            return self
        return replace(self, image=self.published_image, list_stamp=None)

    def images(self, contents: Contents, kind: str) -> ImageList:
        """All images of a kind with their stamps."""
        frames = contents.frames
        paths = tuple(self.image(frame, kind) for frame in frames)
        stamp = self.list_stamp or (lambda frame, kind: frame.written.get(kind, ""))
        written = tuple(stamp(frame, kind) for frame in frames)
        return ImageList(tuple(frame.stamp_s for frame in frames), paths, written)

    def checked(self, contents: Contents) -> None:
        """Raises InputError for contents that the format cannot represent."""
        if self.every_pose:
            check_poses(self.name, contents)
        self.check(contents)

    def losses(self, contents: Contents, source_units: float) -> list[str]:
        """The losses when these contents are written in this format, one sentence each.
        `source_units`: depth units per metre of the source, 0 for exact depth.
        """
        found = self._stamp_losses(contents)
        for channel in contents.channels:
            ending = Path(self.image(contents.frames[0], channel.name)).suffix
            found.append(channel.loss(ending, contents.depth_units_per_metre, source_units))
        camera = self.fixed_camera
        if camera and np.abs(camera.intrinsics - contents.camera.intrinsics).max() > 1e-3:
            size = f"{camera.width}x{camera.height}"
            known = f"{size},{camera.fx:g},{camera.fy:g},{camera.cx:g},{camera.cy:g}"
            found.append(
                f"its programs support only the camera {known}; the correct camera is in {CAMERA}"
            )
        found += self.remarks(contents)
        return [f"{self.name}: {sentence}" for sentence in found if sentence]

    def _stamp_losses(self, contents: Contents) -> list[str]:
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


def posed(
    stamps_s: np.ndarray, truth: Trajectory | None, step_s: float | None = None
) -> np.ndarray:
    """(n,) bool: whether the trajectory has a pose within half a step, by default half the usual
    one, of each stamp (n,).
    """
    if truth is None:
        return np.zeros(len(stamps_s), bool)
    off_s = nearest(stamps_s, truth.stamps_s)[1]
    return off_s <= _SLACK * (step_s or usual_step_s(stamps_s)) + 1e-6


def poses_at(
    stamps_s: np.ndarray, truth: Trajectory | None, step_s: float | None = None
) -> list[SE3 | None]:
    """The true pose at each stamp (n,), between its neighbours on a screw motion; None where
    `posed` is False.
    """
    found: list[SE3 | None] = [None] * len(stamps_s)
    if truth is None:
        return found
    for row in np.flatnonzero(posed(stamps_s, truth, step_s)).tolist():
        pose = truth.T_world_camera[0]
        if len(truth) > 1:
            pose = sample(truth, stamps_s[row].clip(*truth.stamps_s[[0, -1]]))
        found[row] = pose
    return found


def usual_step_s(stamps_s: np.ndarray) -> float:
    """Median step between stamps (n,) in any order; 1/30 s for a single stamp."""
    return float(np.median(np.diff(np.sort(stamps_s)))) if len(stamps_s) > 1 else 1 / 30


def truth_at(file: StrPath) -> Callable[[Path], Path | None]:
    """A function that returns this file of a folder, None if it does not exist."""

    def find(folder: Path) -> Path | None:
        return folder / file if (folder / file).is_file() else None

    return find


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
        atomic_write(path, lambda temporary: temporary.write_bytes(data))
    elif contents.truth is not None:
        write_trajectory(path, contents.truth, format)


def camera_file(folder: Path) -> SequenceCamera | None:
    """The camera in the folder's camera.json, which we write in several formats.

    None if there is no such file.
    """
    if not (folder / CAMERA).is_file():
        return None
    with within(folder / CAMERA):
        return _camera_of(read_json(folder / CAMERA))


def _camera_of(settings: dict) -> SequenceCamera:
    """The camera of the content of camera.json, to which others may have added a distortion."""
    coefficients = {name: settings.pop(name) for name in COEFFICIENTS if name in settings}
    notes = Keys(used=names(""), distortion=COEFFICIENTS).notes([coefficients], Path(CAMERA))
    units = settings.pop("depth_units_per_metre", UNITS_PER_METRE)
    if isinstance(units, bool) or not isinstance(units, int | float):
        raise InputError("depth_units_per_metre as a number", found=units)
    needed = [field.name for field in fields(PinholeCamera)]
    missing = [name for name in needed if name not in settings]
    if missing:  # the defaults are those of another camera
        raise InputError(f"a camera with {', '.join(needed)}", found=f"no {', '.join(missing)}")
    return SequenceCamera(PinholeCamera.from_dict(settings), check_units(units), notes=notes)


def pinhole_of(image: Path, fx: float, fy: float, cx: float, cy: float) -> PinholeCamera:
    """The camera with an image's size.

    In the original files fy < 0, which means that y points up.
    """
    header = image_header(image)
    return PinholeCamera(header.width, header.height, fx, abs(fy), cx, cy)


def pinhole_of_matrix(image: Path, path: Path, matrix: np.ndarray) -> PinholeCamera:
    """The camera with an image's size and the camera matrix (3, 3) or (4, 4) of a file.

    Raises InputError for a matrix with skew, or another last row or column.
    """
    rest = matrix.copy()
    for place in ((0, 0), (1, 1), (0, 2), (1, 2)):
        rest[place] = 0
    rest -= np.diag([0.0, 0.0, 1.0, 1.0][: len(matrix)])
    if np.abs(rest).max() > 1e-6:
        expected = "a camera matrix fx 0 cx, 0 fy cy, 0 0 1"
        raise InputError(expected, path=path, found=" ".join(f"{v:g}" for v in matrix.ravel()))
    (fx, _, cx), (_, fy, cy) = matrix[:2, :3].tolist()
    return pinhole_of(image, fx, fy, cx, cy)


def numbers_in(path: Path, values: list[str], count: int, what: str) -> list[float]:
    """Convert `count` values to finite numbers. Raises InputError with the file's name."""
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(what, path=path, found=" ".join(map(str, values))[:80] or "nothing")
    return numbers
