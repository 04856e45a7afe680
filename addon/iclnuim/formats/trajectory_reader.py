"""Reading a trajectory file: from the rows of its table to right-handed cv camera poses."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .columns import Columns, NumberTable
from .files import data_lines
from .stamps import seconds_of
from .trajectory_source import OWN_WORLD, FileOptions, LoadedTrajectory, ReadAs, Source

#: Larger positions (a thousand kilometres) are rejected as damaged.
LARGEST_POSITION_M = 1e6
_EMPTY_LINE = re.compile(r"[\n\r][^\S\n\r]*[\n\r]")


def _nothing(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    return ""


@dataclass(frozen=True)
class TrajectoryReader:
    """How a format's files are read.

    rows: reads the table of a file; its place and ticks are those of the rows. Without a column for
    stamps, lines are counted from 0. sentence: how a file was read; {rate} is replaced by the frame
    rate, {how} by the result of `how`. convert: makes the file's poses right-handed cv camera poses
    (None if they are that already) in `world`. handedness: of the file's poses. hint: for the error
    of invalid frame numbers. first_pose: for a text format with one pose per line, the lines of
    data before the first pose; the poses of some frames are then a subset of the lines.
    """

    rows: Callable[[Source], NumberTable]
    columns: Columns
    sentence: str
    convert: Callable[[SE3], SE3] | None = None
    world: str = OWN_WORLD
    handedness: str = "right"
    how: Callable[[Source, NumberTable, Trajectory], str] = _nothing
    hint: str | None = None
    first_pose: int | None = None

    def read(self, format: str, source: Source, options: FileOptions) -> LoadedTrajectory:
        """Read a file. Raises InputError with the line for invalid content.

        A row without a finite pose is left out; the numbers of the other rows do not change.
        """
        every = self.rows(source)
        columns = self.columns.shifted(1) if every.is_numbered else self.columns
        counted = np.arange(len(every.values))
        if not columns.leave_first:
            counted += _empty_lines_before(source, every)
        kept = _finite_rows(every, columns)
        table = every.at(kept)
        poses = _poses(table, columns, options.unit_m)
        if self.convert:
            poses = self.convert(poses)
        stamps = table.values[:, 0] if columns.leave_first else counted[kept].astype(float)
        stamps_s, rows = seconds_of(table, stamps, options.rate_hz, self.hint)
        trajectory = Trajectory(stamps_s, poses[rows])
        how = self.how(source, table, trajectory)
        sentence = self.sentence.format(rate=f"{options.rate_hz:g}", how=how)
        repeated = len(poses) - len(rows)
        if repeated:
            sentence += f"; {repeated} repeated stamp{'s' * (repeated > 1)} left out"
        row_count = int(counted[-1]) + 1
        lost = row_count - len(poses)
        if lost:
            sentence += f"; {lost} of {row_count} rows have no finite pose and are left out"
        read_as = ReadAs(format, self.handedness, self.world, sentence, repeated, lost)
        if columns.leave_first:
            return LoadedTrajectory(trajectory, read_as)
        return LoadedTrajectory(trajectory, read_as, counted[kept], row_count)


def _finite_rows(table: NumberTable, columns: Columns) -> np.ndarray:
    """The rows (m,) whose pose is finite. Raises InputError if there are none."""
    finite = np.isfinite(table.values[:, columns.position + columns.orientation]).all(axis=1)
    if not finite.any():
        raise table.error(0, "a row of finite numbers", f"none in {len(finite)} rows")
    return np.flatnonzero(finite)


def _empty_lines_before(source: Source, table: NumberTable) -> np.ndarray:
    """(n,) how many empty lines are between the first row and each row: lost poses, unless every
    second line is empty.
    """
    none = np.zeros(len(table.values), int)
    if not _EMPTY_LINE.search(source.text):
        return none
    numbers = [number for number, _ in data_lines(source.text)]
    if len(numbers) != len(none):
        return none
    lines = source.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    empty = np.cumsum([not line.strip() for line in lines])
    before = empty[np.array(numbers) - 1]
    before -= before[0]
    return before if 2 * before[-1] < len(before) else none


def _poses(table: NumberTable, columns: Columns, unit_m: float) -> SE3:
    """The poses in a table's columns, with positions in units of `unit_m`.

    Raises InputError with the line.
    """
    positions_m = table.values[:, columns.position] * unit_m
    largest = np.abs(positions_m).max(axis=1)
    absurd = np.flatnonzero(~(largest <= LARGEST_POSITION_M))
    if absurd.size:
        expected = f"a position of at most {LARGEST_POSITION_M:g} m"
        found = f"{largest[absurd[0]]:g} m"
        raise table.error(absurd[0], expected, found, "another unit or another format")
    return SE3(_rotations(table, table.values[:, columns.orientation]), positions_m)


def _rotations(table: NumberTable, values: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of rows qx qy qz qw or r00 r01 ... r22.

    An error has the line of the first invalid row.
    """
    try:
        return _matrices(values)
    except InputError:
        for row in range(len(values)):
            try:
                _matrices(values[row : row + 1])
            except InputError as error:
                raise table.error(row, error.expected, error.found, error.hint) from None
        raise


def _matrices(values: np.ndarray) -> np.ndarray:
    if values.shape[1] == 4:
        return so3.matrix_from_quat_xyzw(values)
    return so3.nearest_rotation(values.reshape(-1, 3, 3))
