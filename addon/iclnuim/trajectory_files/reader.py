"""Reading a trajectory file: from the rows of its table to right-handed cv camera poses."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines
from ..geometry import so3
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .number_rows import NumberRows
from .number_table import NumberTable, PoseColumns
from .source import OWN_WORLD, FileOptions, LoadedTrajectory, ReadAs, Source
from .stamps import seconds_of

#: Positions further from the first one (a thousand kilometres) are rejected as damaged.
LARGEST_POSITION_M = 1e6
#: Positions up to here, which include all coordinates of maps (UTM 1e7, Web Mercator 2.004e7), are
#: moved to the first one.
LARGEST_COORDINATE_M = 2.5e7
#: Rotation matrices whose entries change by more than the rounding to three digits are mentioned.
_NOTABLE = 5e-4
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
    columns: PoseColumns
    sentence: str
    convert: Callable[[SE3], SE3] | None = None
    world: str = OWN_WORLD
    handedness: str = "right"
    how: Callable[[Source, NumberTable, Trajectory], str] = _nothing
    hint: str | None = None
    first_pose: int | None = None

    def check(self) -> None:
        """Raises InputError unless the rows have the columns."""
        if isinstance(self.rows, NumberRows):
            self.rows.check(self.columns)

    def read(self, format: str, source: Source, options: FileOptions) -> LoadedTrajectory:
        """Read a file. Raises InputError with the line for invalid content.

        A row without a finite pose is left out; the numbers of the other rows do not change.
        """
        every = self.rows(source)
        columns = every.columns or self.columns.shifted(int(every.is_numbered))
        counted = np.arange(len(every.values))
        if not columns.leave_first:
            counted += _empty_lines_before(source, every)
        kept = _finite_rows(every, columns)
        table = every.at(kept)
        poses, few_digits = _poses(table, columns, options.unit_m)
        if self.convert:
            poses = self.convert(poses)
        poses, shift_m = _near_the_origin(table, poses)
        stamps = table.values[:, 0] if columns.leave_first else counted[kept].astype(float)
        stamps_s, rows = seconds_of(table, stamps, options.rate_hz, self.hint)
        trajectory = Trajectory(stamps_s, poses[rows])
        how = self.how(source, table, trajectory)
        read_as = ReadAs(
            format,
            self.handedness,
            self.world,
            self.sentence.replace("{how}", how).replace("{rate}", f"{options.rate_hz:g}"),
            repeated=len(poses) - len(rows),
            lost=int(counted[-1]) + 1 - len(poses),
            shift_m=shift_m,
            has_rotations=bool(columns.orientation),
        )
        read_as = _with_remarks(read_as, table.note + few_digits, int(counted[-1]) + 1)
        return LoadedTrajectory(
            trajectory,
            read_as,
            rows=counted[kept][rows],
            row_count=int(counted[-1]) + 1,
            is_counted=not columns.leave_first,
            is_numbered=columns.leave_first and table.ticks is None,
        )


def _with_remarks(read_as: ReadAs, note: str, row_count: int) -> ReadAs:
    """The same with what was changed or left out in its sentence."""
    sentence = read_as.sentence + note
    if any(read_as.shift_m):
        first = " ".join(f"{metres:.10g}" for metres in read_as.shift_m)
        sentence += f"; positions are relative to the first one, {first} m"
    if read_as.repeated:
        plural = "s" * (read_as.repeated > 1)
        sentence += f"; {read_as.repeated} repeated stamp{plural} left out"
    if read_as.lost:
        sentence += f"; {read_as.lost} of {row_count} rows have no finite pose and are left out"
    return replace(read_as, sentence=sentence)


def _finite_rows(table: NumberTable, columns: PoseColumns) -> np.ndarray:
    """The rows (m,) whose pose is finite. Raises InputError if there are none."""
    finite = np.isfinite(table.values[:, columns.position + columns.orientation]).all(axis=1)
    if not finite.any():
        raise table.error(0, "finite poses", f"none in {len(finite)} rows")
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
    lines = source.text.split("\n")
    empty = np.cumsum([not line.strip() for line in lines])
    before = empty[np.array(numbers) - 1]
    before -= before[0]
    return before if 2 * before[-1] < len(before) else none


def _poses(table: NumberTable, columns: PoseColumns, unit_m: float) -> tuple[SE3, str]:
    """The poses in a table's columns, with positions in units of `unit_m`, or, if that is 1, in the
    unit that the file names; and a note on their rotations. Without columns of an orientation,
    rotations are the identity.

    Raises InputError with the line.
    """
    if unit_m == 1.0 and table.metres:
        unit_m = table.metres
    positions_m = table.values[:, columns.position] * unit_m
    _check_lengths(table, positions_m, LARGEST_COORDINATE_M)
    if not columns.orientation:
        return SE3(np.broadcast_to(np.eye(3), (len(positions_m), 3, 3)), positions_m), ""
    values = table.values[:, columns.orientation]
    rotations = _rotations(table, values)
    note = ""
    if values.shape[1] == 9 and np.abs(rotations.reshape(-1, 9) - values).max() > _NOTABLE:
        note = "; its rotation matrices have few digits and were made orthonormal"
    return SE3(rotations, positions_m), note


def _near_the_origin(table: NumberTable, poses: SE3) -> tuple[SE3, tuple[float, ...]]:
    """The poses, and what was subtracted from their positions: the first one if they are as large
    as the coordinates of maps. Raises InputError with the line of a position that is still far.
    """
    shift_m = np.zeros(3)
    if np.abs(poses.translation).max() > LARGEST_POSITION_M:
        shift_m = poses.translation[0]
    moved_m = poses.translation - shift_m
    _check_lengths(table, moved_m, LARGEST_POSITION_M)
    return SE3(poses.rotation, moved_m), tuple(shift_m.tolist())


def _check_lengths(table: NumberTable, positions_m: np.ndarray, limit_m: float) -> None:
    largest = np.abs(positions_m).max(axis=1)
    absurd = np.flatnonzero(~(largest <= limit_m))
    if absurd.size:
        expected = f"a position of at most {limit_m:g} m"
        found = f"{largest[absurd[0]]:g} m"
        raise table.error(absurd[0], expected, found, "another unit or another format")


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
