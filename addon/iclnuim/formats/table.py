"""Numbers in columns: read at the speed of C, and only when something is wrong is the offending line looked for."""

import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..errors import InputError

#: Beyond a thousand kilometres, three thousand years or a thousand million frames a number stands for damage.
LARGEST_POSITION_M = 1e6
LARGEST_STAMP_S = 1e11
LARGEST_FRAME = 10**9

Built = TypeVar("Built")


@dataclass(frozen=True, eq=False)
class Table:
    """Values (n, columns), and the file and line (from 1) where a row stands."""

    values: np.ndarray
    place: Callable[[int], tuple[str | os.PathLike[str], int | None]]

    def error(self, row: int, expected: str, found: object, hint: str | None = None) -> InputError:
        path, line = self.place(int(row))
        return InputError(expected, path=path, line=line, found=found, hint=hint)


def read_table(
    path: str | os.PathLike[str], text: str, columns: tuple[int, ...], what: str, delimiter: str | None = None
) -> Table:
    """All lines that are neither blank nor comments (#), with one of the given numbers of columns, all finite.

    Raises InputError naming the first line that is not so; `what` says what a line should be.
    """
    if not re.search(r"^[^\S\n]*[^#\s]", text, re.MULTILINE):
        raise InputError(what, path=path, found="comments alone")
    try:
        values = np.loadtxt(io.StringIO(text, newline=None), dtype=float, comments="#", delimiter=delimiter, ndmin=2)
    except (ValueError, OverflowError):
        raise _first_bad_line(path, text, columns, what, delimiter) from None
    table = Table(values, lambda row: (path, data_lines(text)[row][0]))
    if values.shape[1] not in columns:
        raise table.error(0, what, f"{values.shape[1]} columns")
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise table.error(row, "finite numbers", f"{values[row, column]} in column {column + 1}", "removing the line")
    return table


def data_lines(text: str) -> list[tuple[int, str]]:
    """(number from 1, content without comment) of each line that holds data."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    stripped = ((number, line.split("#", 1)[0].strip()) for number, line in enumerate(lines, 1))
    return [(number, line) for number, line in stripped if line]


def blamed(table: Table, build: Callable[[np.ndarray], Built]) -> Built:
    """build(table.values); its InputError is given the line of the first row that causes it (found by bisection)."""
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


def _first_bad_line(
    path: str | os.PathLike[str], text: str, columns: tuple[int, ...], what: str, delimiter: str | None
) -> InputError:
    usual = None
    for number, line in data_lines(text):
        fields = line.split(delimiter)
        bad = next((field for field in fields if not is_number(field)), None)
        if bad is not None:
            return InputError(what, path=path, line=number, found=repr(bad.strip()[:40]))
        usual = usual or len(fields)
        if len(fields) not in columns or len(fields) != usual:
            return InputError(what, path=path, line=number, found=f"{len(fields)} columns")
    return InputError(what, path=path, found="lines that cannot be read as numbers")


def is_number(field: str) -> bool:
    """Whether a field is what loadtxt takes for a number."""
    try:
        float(field)
    except ValueError:
        return False
    return field.isascii() and "_" not in field
