"""Numbers in columns: which columns of a row are a pose, and the values of a file with their lines.

Numbers are read by numpy; the invalid line is searched only after an error.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import data_lines, is_number
from ..geometry.se3 import SE3
from .source import Source


@dataclass(frozen=True)
class PoseColumns:
    """The columns of x y z, and of qx qy qz qw or r00 r01 ... r22. If they leave column 0 free, it
    contains a stamp or a frame number.
    """

    position: tuple[int, ...]
    orientation: tuple[int, ...]

    @property
    def leave_first(self) -> bool:
        """Whether column 0 is none of the pose's."""
        return 0 not in self.position + self.orientation

    def shifted(self, by: int) -> "PoseColumns":
        """The same columns of a row with `by` more columns in front."""
        return PoseColumns(
            tuple(column + by for column in self.position),
            tuple(column + by for column in self.orientation),
        )

    def filled(self, poses: SE3, unit_m: float) -> np.ndarray:
        """Rows (n, columns) with the poses, without the stamp; positions in units of `unit_m`."""
        rows = np.zeros((len(poses), max(self.position + self.orientation) + 1))
        if len(self.orientation) == 4:
            rows[:, self.orientation] = poses.quat_xyzw
        else:
            rows[:, self.orientation] = poses.rotation.reshape(-1, 9)
        rows[:, self.position] = poses.translation / unit_m
        return rows[:, int(self.leave_first) :] + 0.0  # adding 0.0 changes -0.0 to 0.0


#: A stamp, then the pose with the scalar of the quaternion last, as in TUM's files, or first.
SCALAR_LAST = PoseColumns((1, 2, 3), (4, 5, 6, 7))
SCALAR_FIRST = PoseColumns((1, 2, 3), (5, 6, 7, 4))
#: The rows of a 3x4 matrix.
MATRIX = PoseColumns((3, 7, 11), (0, 1, 2, 4, 5, 6, 8, 9, 10))


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Values (n, columns), and a function that returns file and line (from 1) of a row. `ticks`:
    ticks per second of the stamps in column 0, or None if it contains frame numbers or a pose.

    Of a file that names its columns: columns, where they are in `values`; metres, the unit of
    positions (None if it is not named); note, what else to tell of it.
    """

    values: np.ndarray
    place: Callable[[int], tuple[StrPath, int | None]]
    ticks: float | None = None
    columns: PoseColumns | None = None
    metres: float | None = None
    note: str = ""

    @property
    def is_numbered(self) -> bool:
        """Whether a frame number or a stamp precedes the twelve numbers of a 3x4 matrix."""
        return self.values.shape[1] == 13

    def at(self, rows: np.ndarray) -> "NumberTable":
        """The table of some rows (m,)."""
        values = self.values[rows]
        return replace(self, values=values, place=lambda row: self.place(int(rows[row])))

    def error(self, row: int, expected: str, found: object, hint: str | None = None) -> InputError:
        path, line = self.place(int(row))
        return InputError(expected, path=path, line=line, found=found, hint=hint)


def read_table(
    source: Source, columns: tuple[int, ...], expected: str, used: tuple[int, ...] | None = None
) -> NumberTable:
    """Read all lines that are neither blank nor comments (#). Each must have one of the given
    numbers of columns, or, of any number, the columns `used` from 0, which are read alone. A lost
    pose may be nan or inf.

    Raises InputError with the first invalid line; `expected` describes a valid line.
    """
    if not source.first_lines:
        raise InputError(expected, path=source.path, found="comments alone")
    text = io.StringIO(source.table)
    form = {"delimiter": source.delimiter, "usecols": used}
    try:
        values = np.loadtxt(text, ndmin=2, **form)  # type: ignore[call-overload]
    except (ValueError, OverflowError, IndexError):
        raise _first_bad_line(source, columns, expected, used) from None
    table = NumberTable(values, lambda row: (source.path, data_lines(source.table)[row][0]))
    if used is None and values.shape[1] not in columns:
        raise table.error(0, expected, f"{values.shape[1]} columns")
    return table


def _first_bad_line(
    source: Source, columns: tuple[int, ...], expected: str, used: tuple[int, ...] | None
) -> InputError:
    usual = None
    for number, line in data_lines(source.table):
        fields = line.split(source.delimiter)
        read = fields
        if used is not None:
            read = [fields[column] for column in used if column < len(fields)]
        bad = next((field for field in read if not is_number(field)), None)
        if bad is not None:
            return InputError(expected, path=source.path, line=number, found=repr(bad.strip()[:40]))
        usual = usual or len(fields)
        wrong = len(fields) not in columns or len(fields) != usual
        if used is not None:
            wrong = len(read) < len(used)
        if wrong:
            found = f"{len(fields)} columns"
            return InputError(expected, path=source.path, line=number, found=found)
    return InputError(expected, path=source.path, found="lines that cannot be read as numbers")
