"""Writing a trajectory file, and which format the name of a new file means."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .columns import Columns
from .reader import LARGEST_POSITION_M
from .source import FileOptions
from .stamps import LARGEST_STAMP_S, frame_numbers, nanoseconds_of, stamp_text

#: Names and symbols of units in metres, for headers.
_UNITS = {1.0: ("metres", "m"), 0.01: ("centimetres", "cm"), 0.001: ("millimetres", "mm")}

#: Stamps or frame numbers (None if a format has none), and the poses to write.
Given = tuple[Iterable | None, SE3]


def poses_alone(trajectory: Trajectory, options: FileOptions) -> Given:
    """The poses without stamps."""
    return None, trajectory.T_world_camera


def with_seconds(trajectory: Trajectory, options: FileOptions) -> Given:
    """Texts of the stamps in seconds, and the poses."""
    return map(stamp_text, trajectory.stamps_s.tolist()), trajectory.T_world_camera


def with_nanoseconds(trajectory: Trajectory, options: FileOptions) -> Given:
    """Stamps in nanoseconds, and the poses."""
    return map(nanoseconds_of, trajectory.stamps_s.tolist()), trajectory.T_world_camera


def pov_with_numbers(trajectory: Trajectory, options: FileOptions) -> Given:
    """Frame numbers, and the poses in the POV world."""
    numbers = frame_numbers(trajectory.stamps_s, options.rate_hz)
    return numbers.tolist(), axes.pov_from_world_cv(trajectory.T_world_camera)


def ned_alone(trajectory: Trajectory, options: FileOptions) -> Given:
    """The poses in NED axes without stamps."""
    return None, axes.ned_from_world_cv(trajectory.T_world_camera)


@dataclass(frozen=True)
class TrajectoryWriter:
    """How a format's files are written.

    line: a printf format of all columns in order, after the stamp or frame number if `given`
    returns such. header: may contain {unit} or {symbol} of the positions. goes_to: description of
    the written file. endings, word: file names that select this format: endings, or a word in the
    name of a file that ends in `texts`. has_stamps: whether a file has the stamps of its poses; a
    reader of the others needs the frame rate.
    """

    line: str
    columns: Columns
    goes_to: str
    given: Callable[[Trajectory, FileOptions], Given] = poses_alone
    header: str = ""
    separator: str = ""
    endings: tuple[str, ...] = ()
    word: str = ""
    texts: tuple[str, ...] = (".txt",)
    has_stamps: bool = False

    def text(self, trajectory: Trajectory, options: FileOptions) -> str:
        """The text of a file in this format.

        Raises InputError if the format cannot represent the trajectory.
        """
        check_writable(trajectory)
        stamps, poses = self.given(trajectory, options)
        rows = self.columns.filled(poses, options.unit_m).tolist()
        if stamps is None:
            lines = [self.line % tuple(row) for row in rows]
        else:
            lines = [self.line % (stamp, *row) for stamp, row in zip(stamps, rows, strict=True)]
        return self._header(options.unit_m) + self.separator.join(lines)

    def _header(self, unit_m: float) -> str:
        """The header for positions in a unit of so many metres."""
        long, short = _UNITS.get(unit_m, (f"units of {unit_m:g} m", f"{unit_m:g} m"))
        return self.header.format(unit=long, symbol=short)

    def is_meant_by(self, name: str) -> bool:
        """Whether a file of this name (in lower case) is to be written in this format."""
        if name.endswith(self.endings):
            return True
        return bool(self.word) and self.word in name and name.endswith(self.texts)


def check_writable(trajectory: Trajectory) -> None:
    """Raises InputError for a trajectory that no reader would accept: no poses, or implausible
    numbers.
    """
    if len(trajectory) == 0:
        raise InputError("at least one pose to write", found="none")
    largest_m = np.abs(trajectory.positions_m).max()
    if largest_m > LARGEST_POSITION_M:
        expected = f"positions of at most {LARGEST_POSITION_M:g} m to write"
        raise InputError(expected, found=f"{largest_m:g} m")
    stamps_s = trajectory.stamps_s
    if np.abs(stamps_s).max() > LARGEST_STAMP_S or (np.diff(np.rint(stamps_s * 1e9)) <= 0).any():
        raise InputError(
            f"stamps of at most {LARGEST_STAMP_S:g} s, a nanosecond or more apart, to write"
        )
