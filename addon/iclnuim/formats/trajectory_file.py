"""What the readers and writers of trajectory files share: the file, the options, the result, and checks blamed on their line."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .files import read_text
from .table import LARGEST_FRAME, LARGEST_POSITION_M, LARGEST_STAMP_S, Table, blamed, data_lines, is_number

OWN_WORLD = "the file's own world"
OUR_WORLD = "our world (metres, z up)"
#: Rooms are a few metres wide; a POV-world trajectory this far from the origin was most likely written in centimetres.
FAR_M = 50.0
#: A stamp may be off its frame's time by this share of a frame.
STAMP_SLACK = 0.01


@dataclass(frozen=True)
class ReadAs:
    """How a file was read: format, handedness of its poses, world of the trajectory made of them, one sentence."""

    format: str
    handedness: str
    frame: str
    sentence: str


@dataclass(frozen=True, eq=False)
class LoadedTrajectory:
    """A right-handed trajectory of cv camera poses, and how it came out of its file."""

    trajectory: Trajectory
    read_as: ReadAs


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not say: frames per second where it numbers its frames, and its unit of length in metres."""

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))


@dataclass(frozen=True)
class WriteOptions(ReadOptions):
    """Frames per second where frames are numbered, the unit of length in metres, and where the anchored formats start."""

    start_z_m: float = -2.25

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(self.start_z_m) <= 1e3:
            raise InputError("start_z_m of at most 1000 m", found=self.start_z_m)


@dataclass(frozen=True)
class TrajectoryFormat:
    """One format: whether a file is of it (by name and content), how it is read, how it is written (None: not), and by which names of files
    to be written it is meant: endings, or a word in the name of a .txt.
    """

    sniff: "Callable[[Source], bool]"
    read: "Callable[[Source, ReadOptions], LoadedTrajectory]"
    write: Callable[[Trajectory, WriteOptions], str] | None = None
    goes_to: str = ""
    endings: tuple[str, ...] = ()
    word: str = ""


class Source:
    """A file or folder to be read; its text is read once, when first asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @property
    def is_folder(self) -> bool:
        return os.path.isdir(self.path)

    @cached_property
    def text(self) -> str:
        """Raises InputError for what is no text: missing, empty, binary, a web page."""
        return read_text(self.path, "a trajectory file")

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first line of data, in lower case."""
        return self.text[: self._first_data].lower()

    @cached_property
    def first_lines(self) -> list[str]:
        """The first two lines of data, without comments; fewer where there are none."""
        return [line for _, line in data_lines(self.text[self._first_data : self._first_data + 10_000])][:2]

    @property
    def columns(self) -> int:
        """Of the first line of data, parted by blanks."""
        return len(self.first_lines[0].split()) if self.first_lines else 0

    @property
    def starts_with_numbers(self) -> bool:
        """Whether every field of the first line of data is a number."""
        return bool(self.first_lines) and all(is_number(field) for field in self.first_lines[0].split())

    @property
    def first_line_number(self) -> int:
        """From 1."""
        return self.text.count("\n", 0, self._first_data) + 1

    @cached_property
    def _first_data(self) -> int:
        found = re.search(r"^[^\S\n]*[^#\s]", self.text, re.MULTILINE)
        return found.start() if found else len(self.text)


def unit_warning(trajectory: Trajectory) -> str:
    """What to add to the sentence of a POV-world file whose positions look like centimetres; '' elsewhere."""
    far_m = np.abs(trajectory.positions_m).max()
    return f"; positions reach {far_m:.0f} m: they may be centimetres (unit cm)" if far_m > FAR_M else ""


def trajectory_at(table: Table, stamps_s: np.ndarray, poses: SE3) -> Trajectory:
    """The trajectory with stamps in seconds. Raises InputError for one that is absurd, repeats or runs backwards."""
    absurd = np.flatnonzero(~(np.abs(stamps_s) <= LARGEST_STAMP_S))
    if absurd.size:
        expected = f"a stamp in seconds, at most {LARGEST_STAMP_S:g}"
        raise table.error(absurd[0], expected, f"{stamps_s[absurd[0]]:.10g}", "dividing stamps in nanoseconds by 1e9")
    _check_increasing(table, stamps_s, "stamp")
    return Trajectory(stamps_s, poses)


def trajectory_of_frames(
    table: Table, numbers: np.ndarray, poses: SE3, rate_hz: float, hint: str | None = None
) -> Trajectory:
    """The trajectory with stamps number / rate. Raises InputError for one that is none, repeats or runs backwards."""
    bad = np.flatnonzero(~((numbers == np.rint(numbers)) & (numbers >= 0) & (numbers <= LARGEST_FRAME)))
    if bad.size:
        raise table.error(bad[0], f"a frame number, 0 to {LARGEST_FRAME}", f"{numbers[bad[0]]:.10g}", hint)
    _check_increasing(table, numbers, "frame number")
    return Trajectory(numbers / rate_hz, poses)


def poses_of(table: Table, positions_m: np.ndarray, orientation: list[int]) -> SE3:
    """Poses of positions (n, 3) and of the table's columns qx qy qz qw, or r00 r01 ... r22. Raises InputError naming the line."""
    largest = np.abs(positions_m).max(axis=1)
    absurd = np.flatnonzero(~(largest <= LARGEST_POSITION_M))
    if absurd.size:
        expected = f"a position of at most {LARGEST_POSITION_M:g} m"
        raise table.error(absurd[0], expected, f"{largest[absurd[0]]:g} m", "another unit or another format")
    if len(orientation) == 4:
        return SE3(blamed(table, lambda values: so3.matrix_from_quat_xyzw(values[:, orientation])), positions_m)
    return SE3(
        blamed(table, lambda values: so3.nearest_rotation(values[:, orientation].reshape(-1, 3, 3))), positions_m
    )


def _check_increasing(table: Table, values: np.ndarray, what: str) -> None:
    late = np.flatnonzero(np.diff(values) <= 0)
    if late.size:
        row = int(late[0]) + 1
        before, here = values[row - 1], values[row]
        found, hint = f"{here:.15g}", "sorting the lines"
        if here == before:
            found, hint = f"{here:.15g} again", "removing one of the two lines"
        raise table.error(row, f"a {what} above the {before:.15g} of line {table.place(row - 1)[1]}", found, hint)


def check_writable(trajectory: Trajectory) -> None:
    """Raises InputError for what no reader would accept: no poses, numbers that are not finite or absurd."""
    if len(trajectory) == 0:
        raise InputError("at least one pose to write", found="none")
    positions_m, stamps_s = trajectory.positions_m, trajectory.stamps_s
    if not (np.isfinite(positions_m).all() and np.isfinite(trajectory.T_world_camera.rotation).all()):
        raise InputError("finite poses to write", found="NaN or infinity")
    if np.abs(positions_m).max() > LARGEST_POSITION_M:
        expected = f"positions of at most {LARGEST_POSITION_M:g} m to write"
        raise InputError(expected, found=f"{np.abs(positions_m).max():g} m")
    if np.abs(stamps_s).max() > LARGEST_STAMP_S or (np.diff(np.rint(stamps_s * 1e9)) <= 0).any():
        raise InputError(f"stamps of at most {LARGEST_STAMP_S:g} s, a nanosecond or more apart, to write")


def frame_numbers(trajectory: Trajectory, rate_hz: float) -> np.ndarray:
    """(n,) integers: stamp * rate. Raises InputError where a stamp lies between two frames or before frame 0."""
    frames = trajectory.stamps_s * rate_hz
    numbers = np.rint(frames)
    between = ~(np.abs(frames - numbers) <= STAMP_SLACK)
    bad = np.flatnonzero(between | (numbers < 0) | (np.diff(numbers, prepend=-1.0) <= 0))
    if bad.size:
        expected = f"stamps at frame numbers / {rate_hz:g} s, from 0 on, to write frame numbers"
        raise InputError(expected, found=f"{trajectory.stamps_s[bad[0]]:.15g} s", hint="{restamp}")
    return numbers.astype(np.int64)
