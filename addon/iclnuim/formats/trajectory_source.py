"""A trajectory file to be read, the options of files that do not say everything, and the result."""

import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .files import data_lines, is_number, read_text

OWN_WORLD = "the file's own world"
OUR_WORLD = "our world (metres, z up)"


@dataclass(frozen=True)
class ReadAs:
    """How a file was read: format, handedness of its poses, world of the resulting trajectory, and
    a sentence for the user. repeated: number of stamps that were left out because they repeat the
    previous one. lost: number of rows without a finite pose, which were left out.
    """

    format: str
    handedness: str
    frame: str
    sentence: str
    repeated: int = 0
    lost: int = 0


@dataclass(frozen=True, eq=False)
class LoadedTrajectory:
    """A right-handed trajectory of cv camera poses, and how its file was read.

    rows: for a file with neither stamps nor frame numbers, (n,) the rows of the poses, from 0;
    row_count: of how many rows, lost ones included.
    """

    trajectory: Trajectory
    read_as: ReadAs
    rows: np.ndarray | None = None
    row_count: int = 0


@dataclass(frozen=True)
class FileOptions:
    """Information that a file does not contain: frames per second if it has frame numbers, and its
    unit of length in metres. start_z_m: where trajectories in the anchored formats start when they
    are written.
    """

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0
    start_z_m: float = -2.25

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))
        if not abs(self.start_z_m) <= 1e3:
            raise InputError("start_z_m of at most 1000 m", found=self.start_z_m)


class Source:
    """A file or folder to be read. Its text is read once, at first use."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def with_text(self, text: str) -> "Source":
        """The same path with another text."""
        other = Source(self.path)
        other.__dict__["text"] = text
        return other

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @cached_property
    def text(self) -> str:
        """The text of the file.

        Raises InputError for a missing, empty or binary file or a web page.
        """
        return read_text(self.path, "a trajectory file")

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first line of data, in lower case."""
        return self.text[: self._first_data].lower()

    @cached_property
    def first_lines(self) -> list[str]:
        """The first two lines of data, without comments; fewer if the file has fewer."""
        start = self.text[self._first_data : self._first_data + 10_000]
        return [line for _, line in data_lines(start)][:2]

    @property
    def columns(self) -> int:
        """The number of columns, separated by blanks, of the first line of data."""
        return len(self._first_fields)

    @property
    def starts_with_numbers(self) -> bool:
        """Whether every field of the first line of data is a number."""
        return bool(self.first_lines) and all(map(is_number, self._first_fields))

    @property
    def _first_fields(self) -> list[str]:
        return self.first_lines[0].split() if self.first_lines else []

    @cached_property
    def _first_data(self) -> int:
        found = re.search(r"^[^\S\n]*[^#\s]", self.text, re.MULTILINE)
        return found.start() if found else len(self.text)
