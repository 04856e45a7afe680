"""The frames of a sequence: numbers, stamps, images, and which of them have a pose."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..channels import RGB
from ..errors import InputError
from ..evaluation.associate import nearest
from ..formats.files import is_file
from ..formats.image_names import by_numbers, numbers_in_names
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, sample, stamps_of_frames
from ..trajectory_files.stamps import nanoseconds_of, seconds_of_names, stamp_name, stamp_text
from .associations import LARGEST_NUMBER

#: Maximum distance in time between a pose and its frame, as a share of the usual step between
#: frames.
_SLACK = 0.5
#: A stamp in seconds and its text are equal to this.
_SAME_S = 1e-3
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


def missing_is_largest(depth: Path) -> bool:
    """Whether a depth image marks missing depth by 65535, too, as those of 7-Scenes do, whose names
    are frame-000000.depth.png.
    """
    return depth.name.endswith(".depth.png")


@dataclass(frozen=True)
class ImagePair:
    """A colour and a depth image of the same time.

    The number is that in the file's name if these numbers increase, else the row.
    """

    number: int
    stamp_s: float
    rgb: Path
    depth: Path
    #: The texts of both images' stamps in the lists; "" if no list has seconds.
    written: tuple[str, str] = ("", "")

    @property
    def depth_stamp_s(self) -> float:
        """The stamp of the depth image in seconds, which sensors may take beside the colour
        image's: that of its list, if there is one.
        """
        colour, depth = self.written
        if colour == depth or not (_DECIMAL.fullmatch(colour) and _DECIMAL.fullmatch(depth)):
            return self.stamp_s
        is_seconds = abs(float(colour) - self.stamp_s) < _SAME_S
        return float(depth) if is_seconds else self.stamp_s


def depth_stamps_s(pairs: Sequence[ImagePair]) -> np.ndarray:
    """(n,) seconds of the depth images of pairs."""
    return np.array([pair.depth_stamp_s for pair in pairs])


def depth_lag_s(pairs: Sequence[ImagePair]) -> float:
    """The median time between the images of a pair, without its sign; 0 for no pairs."""
    lags_s = [abs(pair.depth_stamp_s - pair.stamp_s) for pair in pairs]
    return float(np.median(lags_s)) if lags_s else 0.0


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


def frame_numbers(rows: list[Row]) -> list[int] | None:
    """The frame numbers of rows; None if they do not increase, or a name has none."""
    numbers: list[int] = []
    for row in rows:
        number = row.number
        if number is None:
            number = _number((row.rgb or row.depth or Path()).stem)
        if number is None or (numbers and number <= numbers[-1]):
            return None
        numbers.append(number)
    return numbers


def _number(stem: str) -> int | None:
    """The number in an image's name, unless it is a stamp."""
    return int(stem) if stem.isdecimal() and int(stem) <= LARGEST_NUMBER else None


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
