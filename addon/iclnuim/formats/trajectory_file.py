"""Shared parts of the readers and writers of trajectory files: the file, its numbers in columns,
the options, the result, and checks whose
errors give the line. Numbers are read by numpy; the invalid line is searched only after an error.
"""

import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import (
    FRAME_RATE_HZ,
    STAMP_DIGITS,
    Trajectory,
    frames_of_stamps,
    stamps_of_frames,
)
from .files import data_lines, read_text

OWN_WORLD = "the file's own world"
OUR_WORLD = "our world (metres, z up)"
#: Larger numbers (a thousand kilometres, three thousand years, a thousand million frames) are
#: rejected as damaged.
LARGEST_POSITION_M = 1e6
LARGEST_STAMP_S = 1e11
LARGEST_FRAME = 10**9
#: Rooms are a few metres wide: a POV-world trajectory that is this far from the origin was probably
#: written in centimetres.
FAR_M = 50.0
#: A stamp may differ from its frame's time by this share of a frame.
STAMP_SLACK = 0.01
#: Stamps whose median step is longer are nanoseconds (10,000 frames per second), not seconds (one
#: frame per day).
LONGEST_STEP_S = 1e5
#: Whole numbers whose median step is shorter (10,000 frames per second) are no nanoseconds.
SHORTEST_STEP_NS = 1e5


@dataclass(frozen=True)
class ReadAs:
    """How a file was read: format, handedness of its poses, world of the resulting trajectory, and
    a sentence for the user. repeated: number of
    stamps that were left out because they repeat the previous one.
    """

    format: str
    handedness: str
    frame: str
    sentence: str
    repeated: int = 0


@dataclass(frozen=True, eq=False)
class LoadedTrajectory:
    """A right-handed trajectory of cv camera poses, and how its file was read."""

    trajectory: Trajectory
    read_as: ReadAs


@dataclass(frozen=True)
class FileOptions:
    """Information that a file does not contain: frames per second if it has frame numbers, and its
    unit of length in metres. start_z_m: where
    trajectories in the anchored formats start when they are written.
    """

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0
    start_z_m: float = -2.25

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))
        if not abs(self.start_z_m) <= 1e3:
            raise InputError("start_z_m of at most 1000 m", found=self.start_z_m)


class Source:
    """A file or folder to be read. Its text is read once, at first use."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def with_text(self, text: str) -> "Source":
        """The same path with another text."""
        other = Source(self.path)
        other.__dict__["text"] = text
        return other

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @cached_property
    def text(self) -> str:
        """The text of the file.

        Raises InputError for a missing, empty or binary file or a web page.
        """
        return read_text(self.path, "a trajectory file")

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first line of data, in lower case."""
        return self.text[: self._first_data].lower()

    @cached_property
    def first_lines(self) -> list[str]:
        """The first two lines of data, without comments; fewer if the file has fewer."""
        return [
            line for _, line in data_lines(self.text[self._first_data : self._first_data + 10_000])
        ][:2]

    @property
    def columns(self) -> int:
        """The number of columns, separated by blanks, of the first line of data."""
        return len(self.first_lines[0].split()) if self.first_lines else 0

    @property
    def starts_with_numbers(self) -> bool:
        """Whether every field of the first line of data is a number."""
        return bool(self.first_lines) and all(
            is_number(field) for field in self.first_lines[0].split()
        )

    @cached_property
    def _first_data(self) -> int:
        found = re.search(r"^[^\S\n]*[^#\s]", self.text, re.MULTILINE)
        return found.start() if found else len(self.text)


@dataclass(frozen=True, eq=False)
class Table:
    """Values (n, columns), and a function that returns file and line (from 1) of a row. `ticks`:
    ticks per second of the stamps in column 0, or None
    if unknown.
    """

    values: np.ndarray
    place: Callable[[int], tuple[str | os.PathLike[str], int | None]]
    ticks: float | None = None

    def error(self, row: int, expected: str, found: object, hint: str | None = None) -> InputError:
        path, line = self.place(int(row))
        return InputError(expected, path=path, line=line, found=found, hint=hint)


def read_table(
    source: Source, columns: tuple[int, ...], expected: str, delimiter: str | None = None
) -> Table:
    """Read all lines that are neither blank nor comments (#). Each must have one of the given
    numbers of columns, all finite.

    Raises InputError with the first invalid line; `expected` describes a valid line.
    """
    if not source.first_lines:
        raise InputError(expected, path=source.path, found="comments alone")
    text = io.StringIO(source.text, newline=None)
    try:
        values = np.loadtxt(text, dtype=float, comments="#", delimiter=delimiter, ndmin=2)
    except (ValueError, OverflowError):
        raise _first_bad_line(source, columns, expected, delimiter) from None
    table = Table(values, lambda row: (source.path, data_lines(source.text)[row][0]))
    if values.shape[1] not in columns:
        raise table.error(0, expected, f"{values.shape[1]} columns")
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise table.error(
            row,
            "finite numbers",
            f"{values[row, column]} in column {column + 1}",
            "removing the line",
        )
    return table


def _first_bad_line(
    source: Source, columns: tuple[int, ...], expected: str, delimiter: str | None
) -> InputError:
    usual = None
    for number, line in data_lines(source.text):
        fields = line.split(delimiter)
        bad = next((field for field in fields if not is_number(field)), None)
        if bad is not None:
            return InputError(expected, path=source.path, line=number, found=repr(bad.strip()[:40]))
        usual = usual or len(fields)
        if len(fields) not in columns or len(fields) != usual:
            return InputError(
                expected, path=source.path, line=number, found=f"{len(fields)} columns"
            )
    return InputError(expected, path=source.path, found="lines that cannot be read as numbers")


def is_number(field: str) -> bool:
    """Whether loadtxt accepts the field as a number."""
    try:
        float(field)
    except ValueError:
        return False
    return field.isascii() and "_" not in field


def stamp_ticks(stamps: np.ndarray) -> float:
    """Ticks per second of stamps (n,): 1, or 1e9 if the median step, or a single stamp, is far too
    large for seconds.
    """
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    long = (
        np.median(steps) > LONGEST_STEP_S if steps.size else np.abs(stamps).max() > LARGEST_STAMP_S
    )
    return 1e9 if long else 1.0


def seconds_of(
    table: Table, values: np.ndarray, ticks: float | None, rate_hz: float, hint: str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(m,) seconds of a file's stamps (`ticks` per second), or of its frame numbers if `ticks` is
    None, and the rows (m,) they belong to. A stamp that
    repeats the previous one is left out: some systems write it for a frame that they lost.

    Raises InputError for implausible or decreasing stamps, for a repeated frame number, and if most
    stamps repeat. `hint`: for the error of an invalid frame number.
    """
    if ticks:
        what, values = "stamp", values / ticks
        good = np.abs(values) <= LARGEST_STAMP_S
        expected, hint = f"a stamp in seconds, at most {LARGEST_STAMP_S:g}", None
    else:
        what, good = (
            "frame number",
            (values == np.rint(values)) & (values >= 0) & (values <= LARGEST_FRAME),
        )
        expected = f"a frame number, 0 to {LARGEST_FRAME}"
    if not good.all():
        row = int(good.argmin())
        raise table.error(row, expected, f"{values[row]:.10g}", hint)
    steps = np.diff(values, prepend=-np.inf)
    repeated = (steps == 0) & bool(ticks)
    rows, late = np.flatnonzero(~repeated), np.flatnonzero((steps <= 0) & ~repeated)
    if late.size:
        row = int(late[0])
        before, here = values[row - 1], values[row]
        expected = f"a {what} above the {before:.15g} of line {table.place(row - 1)[1]}"
        if here == before:
            raise table.error(row, expected, f"{here:.15g} again", "removing one of the two lines")
        raise table.error(
            row, expected, f"{here:.15g}", "a file of a single run, in the order of time"
        )
    if 2 * len(rows) < len(values):
        found = f"{len(values) - len(rows)} of {len(values)} that repeat the previous stamp"
        raise table.error(
            0, "stamps with all their digits", found, "writing six digits after the decimal point"
        )
    return (values if ticks else stamps_of_frames(values, rate_hz))[rows], rows


def poses_of(table: Table, positions_m: np.ndarray, orientation: list[int]) -> SE3:
    """Poses of positions (n, 3) and of the table's columns qx qy qz qw, or r00 r01 ... r22.

    Raises InputError with the line.
    """
    largest = np.abs(positions_m).max(axis=1)
    absurd = np.flatnonzero(~(largest <= LARGEST_POSITION_M))
    if absurd.size:
        expected = f"a position of at most {LARGEST_POSITION_M:g} m"
        raise table.error(
            absurd[0], expected, f"{largest[absurd[0]]:g} m", "another unit or another format"
        )
    return SE3(_rotations(table, table.values[:, orientation]), positions_m)


def _rotations(table: Table, values: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of rows qx qy qz qw or r00 r01 ... r22.

    An error has the line of the first invalid row.
    """

    def build(rows: np.ndarray) -> np.ndarray:
        return (
            so3.matrix_from_quat_xyzw(rows)
            if rows.shape[1] == 4
            else so3.nearest_rotation(rows.reshape(-1, 3, 3))
        )

    try:
        return build(values)
    except InputError:
        for row in range(len(values)):
            try:
                build(values[row : row + 1])
            except InputError as error:
                raise table.error(row, error.expected, error.found, error.hint) from None
        raise


def check_writable(trajectory: Trajectory) -> None:
    """Raises InputError for a trajectory that no reader would accept: no poses, or implausible
    numbers.
    """
    if len(trajectory) == 0:
        raise InputError("at least one pose to write", found="none")
    positions_m, stamps_s = trajectory.positions_m, trajectory.stamps_s
    if np.abs(positions_m).max() > LARGEST_POSITION_M:
        expected = f"positions of at most {LARGEST_POSITION_M:g} m to write"
        raise InputError(expected, found=f"{np.abs(positions_m).max():g} m")
    if np.abs(stamps_s).max() > LARGEST_STAMP_S or (np.diff(np.rint(stamps_s * 1e9)) <= 0).any():
        raise InputError(
            f"stamps of at most {LARGEST_STAMP_S:g} s, a nanosecond or more apart, to write"
        )


def stamp_text(stamp_s: float) -> str:
    """The text of a stamp in seconds: six digits after the decimal point, up to nine if six are not
    exact.
    """
    text = f"{stamp_s:.{STAMP_DIGITS}f}"
    if float(text) == stamp_s:
        return text
    return _nine_digits(Decimal(repr(float(stamp_s))))


def stamp_text_of_ns(nanoseconds: int) -> str:
    """The text in seconds of a stamp in nanoseconds, with six to nine digits after the decimal
    point.
    """
    return _nine_digits(Decimal(nanoseconds).scaleb(-9))


def _nine_digits(stamp_s: Decimal) -> str:
    text = f"{stamp_s:.9f}"
    return text[:-3] + text[-3:].rstrip("0")


def frame_numbers(stamps_s: np.ndarray, rate_hz: float) -> np.ndarray:
    """Frame numbers (n,) of stamps (n,): (stamp - 1) * rate.

    Raises InputError if a stamp is between two frames or before frame 0.
    """
    frames = frames_of_stamps(stamps_s, rate_hz)
    numbers = np.rint(frames)
    between = ~(np.abs(frames - numbers) <= STAMP_SLACK)
    bad = np.flatnonzero(between | (numbers < 0) | (np.diff(numbers, prepend=-1.0) <= 0))
    if bad.size:
        expected = (
            f"stamps of whole frame numbers, 1 + number / {rate_hz:g} s, to write frame numbers"
        )
        raise InputError(expected, found=f"{stamps_s[bad[0]]:.15g} s", hint="{restamp}")
    return numbers.astype(np.int64)
