"""Writing a trajectory file, and which format the name of a new file means."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from .number_table import PoseColumns
from .reader import LARGEST_POSITION_M
from .source import FileOptions
from .stamps import LARGEST_STAMP_S, Stamps

#: Names and symbols of units in metres, for headers.
_UNITS = {1.0: ("metres", "m"), 0.01: ("centimetres", "cm"), 0.001: ("millimetres", "mm")}


@dataclass(frozen=True)
class TrajectoryWriter:
    """How a format's files are written.

    line: a printf format of all columns in order, after that of `stamps`. convert: makes the
    file's poses of right-handed cv camera poses (None if they are that). chosen: the frame numbers
    and poses of a format that leaves frames out or moves its poses. goes_to: description of the
    written file. header: may contain {unit} or {symbol} of the positions. endings, word: file names
    that select this format: endings, or a word in the name of a file that ends in `texts`.
    """

    line: str
    columns: PoseColumns
    stamps: Stamps
    goes_to: str
    convert: Callable[[SE3], SE3] | None = None
    chosen: Callable[[Trajectory, FileOptions], tuple[np.ndarray, SE3]] | None = None
    header: str = ""
    separator: str = ""
    endings: tuple[str, ...] = ()
    word: str = ""
    texts: tuple[str, ...] = (".txt",)

    @property
    def has_stamps(self) -> bool:
        """Whether a file has the stamps of its poses; a reader of the others needs the rate."""
        return self.stamps in (Stamps.SECONDS, Stamps.NANOSECONDS)

    def check(self) -> None:
        """Raises InputError unless `line` takes the stamp and the columns of a pose."""
        numbers = self.columns.filled(SE3.identity((1,)), 1.0)[0].tolist()
        (stamp,) = self.stamps.of(np.ones(1), 1.0)
        try:
            self.line % (*stamp, *numbers)
        except (TypeError, ValueError) as error:
            expected = f"a line of {self.stamps} and {len(numbers)} numbers of a pose"
            raise InputError(expected, found=f"{self.line!r}: {error}") from None

    def text(self, trajectory: Trajectory, options: FileOptions) -> str:
        """The text of a file in this format.

        Raises InputError if the format cannot represent the trajectory.
        """
        check_writable(trajectory)
        stamps, poses = self._stamps_and_poses(trajectory, options)
        if self.convert:
            poses = self.convert(poses)
        rows = self.columns.filled(poses, options.unit_m).tolist()
        lines = [self.line % (*stamp, *row) for stamp, row in zip(stamps, rows, strict=True)]
        return self._header(options.unit_m) + self.separator.join(lines)

    def _stamps_and_poses(
        self, trajectory: Trajectory, options: FileOptions
    ) -> tuple[Iterable[tuple[str | int, ...]], SE3]:
        if self.chosen is None:
            stamps = self.stamps.of(trajectory.stamps_s, options.rate_hz)
            return stamps, trajectory.T_world_camera
        numbers, poses = self.chosen(trajectory, options)
        return self.stamps.of_frames(numbers), poses

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
