"""Numbers in columns: read at the speed of C, and only when something is wrong is the offending line looked for."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..errors import InputError

#: Beyond a million metres or some thousand years of seconds a number is no pose or stamp but a damaged or misread file.
LARGEST_POSITION_M = 1e6
LARGEST_STAMP_S = 1e11

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Table:
    """Values (n, columns) of the lines of `text` that are neither blank nor comments."""

    path: str | os.PathLike[str]
    text: str
    values: np.ndarray

    def line(self, row: int) -> int:
        """The number, from 1, of the line that holds a row."""
        return _data_lines(self.text)[row][0]

    def error(self, row: int, expected: str, found: object, hint: str | None = None) -> InputError:
        return InputError(expected, path=self.path, line=self.line(int(row)), found=found, hint=hint)


def read_table(path: str | os.PathLike[str], text: str, columns: tuple[int, ...], what: str, delimiter: str | None = None) -> Table:
    """A table with one of the given numbers of columns, all finite. Raises InputError naming the first line that is not so.

    `what` names a line, as in `8 columns: timestamp tx ty tz qx qy qz qw`.
    """
    try:
        values = np.loadtxt(io.StringIO(text), dtype=float, comments="#", delimiter=delimiter, ndmin=2)
    except (ValueError, UserWarning):
        raise _first_bad_line(path, text, columns, what, delimiter) from None
    if values.size == 0:
        raise InputError(what, path=path, found="no line of numbers")
    table = Table(path, text, values)
    if values.shape[1] not in columns:
        raise table.error(0, what, f"{values.shape[1]} columns")
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise table.error(row, "finite numbers", f"{values[row, column]} in column {column + 1}")
    return table


def blamed(table: Table, build: Callable[[np.ndarray], T]) -> T:
    """build(table.values); its InputError is given the line of the first row that brings it about (bisection over prefixes)."""
    try:
        return build(table.values)
    except InputError as error:
        good, bad, found = 0, len(table.values), error
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            build(table.values[good:middle])
            good = middle
        except InputError as error:
            bad, found = middle, error
    raise table.error(good, found.expected, found.found, found.hint)


def check_stamps(table: Table, stamps_s: np.ndarray, hint: str | None = None) -> None:
    """Raises InputError for the first stamp that is absurd, repeats or runs backwards."""
    absurd = np.flatnonzero(~(np.abs(stamps_s) <= LARGEST_STAMP_S))
    if absurd.size:
        hint = hint or "--from euroc for nanoseconds, or dividing the stamps"
        raise table.error(absurd[0], f"a stamp in seconds, at most {LARGEST_STAMP_S:g}", f"{stamps_s[absurd[0]]:.10g}", hint)
    late = np.flatnonzero(np.diff(stamps_s) <= 0)
    if late.size:
        row = int(late[0]) + 1
        before, here = stamps_s[row - 1], stamps_s[row]
        hint = "removing one of the two lines" if here == before else "sorting the lines by their stamps"
        kind = "the same again" if here == before else f"{here:.10g}"
        raise table.error(row, f"a stamp later than the {before:.10g} of line {table.line(row - 1)}", kind, hint)


def check_positions(table: Table, positions_m: np.ndarray) -> None:
    """Raises InputError for the first position that cannot be one."""
    absurd = np.flatnonzero(~(np.abs(positions_m).max(axis=1, initial=0.0) <= LARGEST_POSITION_M))
    if absurd.size:
        worst = positions_m[absurd[0]]
        found = f"{worst[np.argmax(np.abs(worst))]:.6g}"
        raise table.error(absurd[0], f"a position in metres, at most {LARGEST_POSITION_M:g}", found, "the right --unit, or another --from")


def _data_lines(text: str) -> list[tuple[int, str]]:
    """(number from 1, content without comment) of each line that holds data, split at the line ends that loadtxt knows."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    stripped = ((number, line.split("#", 1)[0].strip()) for number, line in enumerate(lines, 1))
    return [(number, line) for number, line in stripped if line]


def _first_bad_line(path, text: str, columns: tuple[int, ...], what: str, delimiter: str | None) -> InputError:
    usual = None
    for number, line in _data_lines(text):
        fields = line.split(delimiter)
        for field in fields:
            if not _is_number(field):
                return InputError(what, path=path, line=number, found=repr(field.strip()[:40]))
        usual = usual or len(fields)
        if len(fields) not in columns or len(fields) != usual:
            return InputError(what, path=path, line=number, found=f"{len(fields)} columns")
    return InputError(what, path=path, found="lines that cannot be read as numbers")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return field.isascii() and "_" not in field
