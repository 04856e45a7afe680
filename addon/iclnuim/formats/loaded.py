"""What reading a trajectory file gives: the right-handed trajectory and a statement of how the file was taken."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .files import read_text
from .table import data_lines, is_number

OWN_WORLD = "the file's own world"
OUR_WORLD = "our world (metres, z up)"
#: Rooms are a few metres wide; a POV-world path this far from the origin was most likely written in centimetres.
FAR_M = 50.0


@dataclass(frozen=True)
class Taken:
    """How a file was taken: format, handedness of its poses, world of the trajectory made of them, one sentence."""

    format: str
    handedness: str
    frame: str
    sentence: str


@dataclass(frozen=True, eq=False)
class LoadedTrajectory:
    """A right-handed trajectory of cv camera poses, and how it came out of its file."""

    trajectory: Trajectory
    taken: Taken


@dataclass(frozen=True)
class ReadOptions:
    """What a file does not say: frames per second where it numbers its frames, and its unit of length in metres."""

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))


def unit_warning(trajectory: Trajectory) -> str:
    """What to add to the sentence of a POV-world file whose positions look like centimetres; '' elsewhere."""
    far_m = np.abs(trajectory.positions_m).max()
    return f"; positions reach {far_m:.0f} m: if they are centimetres, --unit cm" if far_m > FAR_M else ""


class Source:
    """A file or folder to be read; its text is read once, when first asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @property
    def is_folder(self) -> bool:
        return os.path.isdir(self.path)

    @cached_property
    def text(self) -> str:
        """Raises InputError for what is no text: missing, empty, binary, a web page."""
        return read_text(self.path, "a trajectory file")

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first line of data, in lower case."""
        return self.text[: self._first_data].lower()

    @cached_property
    def first_lines(self) -> list[str]:
        """The first two lines of data, without comments; fewer where there are none."""
        return [line for _, line in data_lines(self.text[self._first_data : self._first_data + 10_000])][:2]

    @property
    def columns(self) -> int:
        """Of the first line of data, parted by blanks."""
        return len(self.first_lines[0].split()) if self.first_lines else 0

    @property
    def starts_with_numbers(self) -> bool:
        """Whether every field of the first line of data is a number."""
        return bool(self.first_lines) and all(is_number(field) for field in self.first_lines[0].split())

    @property
    def first_line_number(self) -> int:
        """From 1."""
        return self.text.count("\n", 0, self._first_data) + 1

    @cached_property
    def _first_data(self) -> int:
        found = re.search(r"^[^\S\n]*[^#\s]", self.text, re.MULTILINE)
        return found.start() if found else len(self.text)
