"""The tables of formats whose lines are numbers separated by blanks or commas."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import InputError
from .columns import NumberTable, read_table
from .files import data_lines
from .stamps import SHORTEST_STEP_NS, stamp_ticks
from .trajectory_source import Source

#: Start of the line of names in VSLAM-LAB's files, in lower case.
VSLAM_LAB_STAMP = "ts (ns),"
_VSLAM_LAB = "8 columns separated by commas: ts (ns), tx, ty, tz, qx, qy, qz, qw"
_EUROC = "8 or 17 columns separated by commas: stamp in ns, x, y, z, qw, qx, qy, qz"
#: A table of TUM's columns with commas has another order of the quaternion, and other stamps.
_NO_COMMAS = "blanks instead of commas, for a TUM file"
#: A row of TUM's files.
TUM = "8 columns: timestamp tx ty tz qx qy qz qw"
_SQUARE = "16 columns of a 4x4 matrix, row by row"


def plain_rows(counts: tuple[int, ...], expected: str) -> Callable[[Source], NumberTable]:
    """A reader of rows with one of these numbers of columns, which contain no stamps."""
    return lambda source: read_table(source, counts, expected)


def tum_rows(source: Source) -> NumberTable:
    """(n, 8); the stamps may be in nanoseconds, as in ORB-SLAM3's files for EuRoC."""
    table = read_table(source, (8,), TUM)
    return replace(table, ticks=stamp_ticks(table.values[:, 0]))


def square_rows(source: Source) -> NumberTable:
    """(n, 16). Raises InputError for a line that does not end in 0 0 0 1."""
    table = read_table(source, (16,), _SQUARE)
    finite = np.isfinite(table.values).all(axis=1)
    off = np.abs(table.values[:, 12:] - (0, 0, 0, 1)).max(axis=1)
    wrong = np.flatnonzero(finite & (off > 1e-6))
    if wrong.size:
        found = " ".join(f"{value:g}" for value in table.values[wrong[0], 12:])
        raise table.error(wrong[0], f"{_SQUARE}, ending in 0 0 0 1", found)
    return table


def vslam_lab_rows(source: Source) -> NumberTable:
    """(n, 8) values of VSLAM-LAB's groundtruth.csv."""
    table = read_table(_commented_first(source), (8,), _VSLAM_LAB, ",")
    return replace(table, ticks=1e9)


def _commented_first(source: Source) -> Source:
    """The same source with its first line of data, which contains the names of the columns, made a
    comment. Raises InputError without it.
    """
    number, names = next(iter(data_lines(source.text)), (0, ""))
    if not names.lower().startswith(VSLAM_LAB_STAMP):
        expected = f"the header {VSLAM_LAB_STAMP}..."
        found = names or "comments alone"
        raise InputError(expected, path=source.path, line=number or None, found=found)
    lines = source.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    lines[number - 1] = "#" + lines[number - 1]
    return source.with_text("\n".join(lines))


def euroc_rows(source: Source) -> NumberTable:
    """(n, 8) or (n, 17).

    Raises InputError for stamps that are not whole nanoseconds, and for names of columns that have
    qw last.
    """
    if re.search(r"q\w*x\b.*q\w*w\b", source.header):
        expected = "columns qw, qx, qy, qz, as in EuRoC"
        found = source.header.strip().splitlines()[-1]
        raise InputError(expected, path=source.path, found=found, hint=_NO_COMMAS)
    table = read_table(source, (8, 17), _EUROC, ",")
    stamps = table.values[:, 0]
    parts = np.flatnonzero(stamps != np.rint(stamps))
    if parts.size:
        found = f"{stamps[parts[0]]:.12g}"
        raise table.error(parts[0], "stamps in whole nanoseconds, as in EuRoC", found, _NO_COMMAS)
    usual = float(np.median(np.diff(stamps))) if len(stamps) > 1 else SHORTEST_STEP_NS
    if abs(usual) < SHORTEST_STEP_NS:
        found = f"stamps {usual:.12g} apart, as of frame numbers or seconds"
        raise table.error(0, "stamps in nanoseconds, as in EuRoC", found, _NO_COMMAS)
    return replace(table, ticks=1e9)
