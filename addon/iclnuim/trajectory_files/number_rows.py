"""Rows of numbers parted by blanks, commas or semicolons: the tables of formats that have one pose a
line.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines, is_file
from .number_table import NumberTable, PoseColumns, read_table
from .source import Source
from .stamps import Stamps, stamp_ticks, ticks_unless_frames

#: Start of the line of names in VSLAM-LAB's files, in lower case.
VSLAM_LAB_STAMP = "ts (ns),"
_VSLAM_LAB = "8 columns separated by commas: ts (ns), tx, ty, tz, qx, qy, qz, qw"
#: EuRoC's states, VINS-Mono's with velocities, EuRoC's with velocities and biases.
_EUROC_COUNTS = (8, 11, 17)
_EUROC = "8, 11 or 17 columns separated by commas: stamp in ns, x, y, z, qw, qx, qy, qz"
#: A table of TUM's columns with commas has another order of the quaternion, and other stamps.
_NO_COMMAS = "a header that names the columns, or {from} tum, or tum-wxyz if qw is first"
#: A row of TUM's files.
TUM = "8 columns: timestamp tx ty tz qx qy qz qw"
_MATRIX = "12 columns of a 3x4 matrix, or 13 with the frame number or stamp first"
#: KITTI's stamps of the images, in seconds.
_TIMES = "times.txt"
_SQUARE = "16 columns of a 4x4 matrix, row by row, or 17 with the frame number or stamp first"
_POSITIONS = "4 columns: timestamp x y z, or 3: x y z"


@dataclass(frozen=True)
class NumberRows:
    """Reads rows that each have one of these numbers of columns. stamps: what column 0 has before
    the pose; seconds may also be another unit of time, which the numbers tell, as in ORB-SLAM3's
    files for EuRoC. expected: what a valid row is, for errors.
    """

    counts: tuple[int, ...]
    expected: str
    stamps: Stamps

    def __call__(self, source: Source) -> NumberTable:
        """(n, columns). Raises InputError with the line that has something else."""
        table = read_table(source, self.counts, self.expected)
        if self.stamps is Stamps.SECONDS:
            return replace(table, ticks=stamp_ticks(table.values[:, 0]))
        return replace(table, ticks=1e9) if self.stamps is Stamps.NANOSECONDS else table

    def check(self, columns: PoseColumns) -> None:
        """Raises InputError unless each row has these columns of a pose, after its stamp."""
        used = columns.position + columns.orientation
        first = int(self.stamps is not Stamps.NONE)
        last = min(self.counts) - 1
        fits = first <= min(used) and max(used) <= last and len(set(used)) == len(used)
        if not fits or columns.leave_first != bool(first):
            expected = f"a pose in the columns {first} to {last} of rows with {self.stamps}"
            raise InputError(expected, found=f"columns {', '.join(map(str, used))}")


def position_rows(source: Source) -> NumberTable:
    """(n, 4) with stamps, or (n, 3) without."""
    table = read_table(source, (3, 4), _POSITIONS)
    if table.values.shape[1] == 3:
        return replace(table, columns=PoseColumns((0, 1, 2), ()))
    return replace(table, columns=PoseColumns((1, 2, 3), ()), ticks=stamp_ticks(table.values[:, 0]))


def matrix_rows(source: Source) -> NumberTable:
    """(n, 12), or (n, 13) with a frame number or a stamp first: that of times.txt, if KITTI's file
    of stamps is beside the rows.
    """
    table = read_table(source, (12, 13), _MATRIX)
    if table.is_numbered:
        return replace(table, ticks=_ticks_if_numbered(table))
    return _with_times(source, table)


def _with_times(source: Source, table: NumberTable) -> NumberTable:
    """The table with the stamps of KITTI's file of times, if there is one with as many: times.txt in
    the folder of the rows, or sequences/00/times.txt for poses/00.txt.
    """
    folder = source.path.parent
    places = (folder / _TIMES, folder.parent / "sequences" / source.path.stem / _TIMES)
    file = next((place for place in places if is_file(place) and place != source.path), None)
    if file is None:
        return table
    try:
        times = read_table(Source(file), (1,), "a stamp in seconds").values[:, 0]
    except InputError as error:
        return replace(table, note=f"; not used: {error}")
    if len(times) != len(table.values) or not (np.diff(times) > 0).all():
        counts = f"{len(times)} stamps for {len(table.values)} poses"
        if len(times) == len(table.values):
            counts = "stamps that do not increase"
        return replace(table, note=f"; {file.name} has {counts} and is not used")
    values = np.column_stack([times, table.values])
    return replace(table, values=values, ticks=stamp_ticks(times), note=f"; stamps of {file.name}")


def square_rows(source: Source) -> NumberTable:
    """(n, 12), or (n, 13) with a frame number or a stamp first.

    Raises InputError for a line that does not end in 0 0 0 1.
    """
    table = read_table(source, (16, 17), _SQUARE)
    finite = np.isfinite(table.values).all(axis=1)
    last = table.values[:, -4:]
    wrong = np.flatnonzero(finite & (np.abs(last - (0, 0, 0, 1)).max(axis=1) > 1e-6))
    if wrong.size:
        found = " ".join(f"{value:g}" for value in last[wrong[0]])
        raise table.error(wrong[0], f"{_SQUARE}, ending in 0 0 0 1", found)
    table = replace(table, values=table.values[:, :-4])
    return replace(table, ticks=_ticks_if_numbered(table))


def _ticks_if_numbered(table: NumberTable) -> float | None:
    return ticks_unless_frames(table.values[:, 0]) if table.is_numbered else None


def vslam_lab_rows(source: Source) -> NumberTable:
    """(n, 8) values of VSLAM-LAB's groundtruth.csv. Raises InputError without its header."""
    if not source.header.lstrip("# \n").startswith(VSLAM_LAB_STAMP):
        number, found = next(iter(data_lines(source.text)), (None, "comments alone"))
        expected = f"the header {VSLAM_LAB_STAMP}..."
        raise InputError(expected, path=source.path, line=number, found=found)
    return NumberRows((8,), _VSLAM_LAB, Stamps.NANOSECONDS)(source)


def euroc_rows(source: Source) -> NumberTable:
    """(n, 8), (n, 11) or (n, 17).

    Raises InputError for stamps that are not whole nanoseconds or microseconds.
    """
    table = read_table(source, _EUROC_COUNTS, _EUROC)
    stamps = table.values[:, 0]
    parts = np.flatnonzero(stamps != np.rint(stamps))
    if parts.size:
        found = f"{stamps[parts[0]]:.12g}"
        raise table.error(parts[0], "stamps in whole nanoseconds, as in EuRoC", found, _NO_COMMAS)
    ticks = stamp_ticks(stamps)
    if len(stamps) > 1 and ticks < 1e6:
        found = f"stamps {np.median(np.diff(stamps)):.12g} apart, as of frame numbers or seconds"
        raise table.error(0, "stamps in nanoseconds, as in EuRoC", found, _NO_COMMAS)
    return replace(table, ticks=1e9 if len(stamps) == 1 else ticks)
