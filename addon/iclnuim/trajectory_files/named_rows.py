"""Rows whose columns a header names, in any order, with or without #."""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..formats.files import is_number
from ..geometry.so3 import QUAT_NORM_TOLERANCE
from .column_names import NamedColumns, columns_of, in_the_plane, is_known
from .number_table import MATRIX, SCALAR_FIRST, SCALAR_LAST, NumberTable, PoseColumns, read_table
from .source import Source
from .stamps import plausible, stamp_ticks

_EXPECTED = "a header that names each of x, y, z and, but for positions alone, qx, qy, qz, qw once"
_SHOWN = 6


def named_columns(source: Source) -> NamedColumns | None:
    """The columns that the header names; None if it does not name all columns of the data.

    One name fewer than columns is a table whose index has no name, or data after the named columns:
    the quaternions tell.
    """
    count = source.columns
    missing = count - len(source.names)
    if not source.names or missing > 1:
        return None
    if missing <= 0:
        named = columns_of(source.names[:count])
        return named if source.has_title or _is_no_prose(source, named) else None
    shifts = (1, 0) if source.has_title else (0, 1)
    found = [columns_of([""] * shift + source.names) for shift in shifts]
    valid = (one for one in found if one and _has_unit_quaternion(source.first_rows[0], one))
    return next(valid, found[0])


def _is_no_prose(source: Source, named: NamedColumns | None) -> bool:
    """Whether a comment lists columns: x, y and z are neighbours, and if it has more words than
    there are columns, the first is a name.
    """
    if named is None or len(source.names) > source.columns and not is_known(source.names[0]):
        return False
    x, y, z = named.position
    return len(named.orientation) == 9 or (y, z) == (x + 1, x + 2)


def is_named(source: Source) -> bool:
    """Whether a header names columns in another layout than those that their number means."""
    if in_the_plane(source.names):
        return True
    named = named_columns(source)
    contradicts = source.has_title and len(source.names) > source.columns
    if named is None or contradicts:
        return source.has_title and source.columns > 0
    if named.metres not in (None, 1.0):
        return True
    layout = PoseColumns(named.position, named.orientation)
    if len(named.orientation) == 9:
        return layout not in (MATRIX, MATRIX.shifted(1))
    return not _is_usual(source, named, layout)


def _is_usual(source: Source, named: NamedColumns, layout: PoseColumns) -> bool:
    """Whether TUM's reader, or EuRoC's or VSLAM-LAB's for commas, reads the same columns."""
    if named.stamp != 0 or named.is_frame:
        return False
    if source.delimiter is None:
        return source.columns == 8 and layout == SCALAR_LAST and named.ticks in (None, 1.0)
    if layout == SCALAR_LAST:
        return source.names[0].lower() == "ts (ns)" and source.columns == 8
    if layout != SCALAR_FIRST or source.columns not in (8, 17):
        return False
    stamps = [row[0] for row in source.first_rows if is_number(row[0])]
    return named.ticks == 1e9 or named.ticks is None and stamp_ticks(np.array(stamps, float)) >= 1e6


def named_rows(source: Source) -> NumberTable:
    """(n, k): stamps or frame numbers, positions, and rotations, as far as they are named.

    Raises InputError if the header does not name the columns.
    """
    if in_the_plane(source.names):
        found = "poses in the plane: " + " ".join(source.names)
        hint = "positions x y z with z = 0, without the angle"
        raise InputError(_EXPECTED, path=source.path, found=found, hint=hint)
    named = named_columns(source)
    names = len(source.names)
    if named is None or source.has_title and names > source.columns:
        found = f"{names} names over {source.columns} columns"
        if names == source.columns:
            found = " ".join(source.names)
        raise InputError(_EXPECTED, path=source.path, found=found)
    expected = "a number in each column that the header names"
    table = read_table(source, (), expected, named.used)
    note = ""
    if others := [name for name in named.others if name]:
        shown = ", ".join(others[:_SHOWN])
        more = ", ..." if len(others) > _SHOWN else ""
        note = f"; not read: {shown}{more}"
    first = len(named.used) - len(named.position) - len(named.orientation)
    layout = PoseColumns((0, 1, 2), tuple(range(3, 3 + len(named.orientation)))).shifted(first)
    table = replace(table, columns=layout, metres=named.metres, note=note)
    return _with_ticks(table, named) if first else table


def _with_ticks(table: NumberTable, named: NamedColumns) -> NumberTable:
    """The table with stamps in the unit that the header names, unless the numbers contradict it."""
    stamps = table.values[:, 0]
    if named.is_frame:
        return table
    if named.nanoseconds is not None:
        values = table.values.copy()
        values[:, 0] += 1e-9 * values[:, 1]
        return replace(table, values=values, ticks=1.0)
    if named.ticks is None or plausible(stamps, named.ticks):
        return replace(table, ticks=named.ticks or stamp_ticks(stamps))
    note = f"{table.note}; its stamps are not in the unit that the header names"
    return replace(table, ticks=stamp_ticks(stamps), note=note)


def _has_unit_quaternion(row: list[str], named: NamedColumns) -> bool:
    fields = [row[column] for column in named.orientation]
    if len(fields) != 4 or not all(map(is_number, fields)):
        return not fields
    return bool(abs(np.linalg.norm([float(field) for field in fields]) - 1) < QUAT_NORM_TOLERANCE)
