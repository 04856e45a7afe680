"""What reading a trajectory file gives: the right-handed trajectory and a statement of how the file was taken."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..errors import InputError
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .files import read_text


@dataclass(frozen=True)
class Taken:
    """How a file was taken: its format, the handedness of the poses in it, the world of the trajectory made of it, one sentence."""

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
    """What a file does not say itself: frames per second where it has none or only frame numbers, and its unit of length in metres."""

    rate_hz: float = FRAME_RATE_HZ
    unit_m: float = 1.0

    def __post_init__(self) -> None:
        for name in ("rate_hz", "unit_m"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise InputError(f"{name} of 1e-6 to 1e6", found=getattr(self, name))


class Source:
    """A file or folder to be read; its text is read once, when first asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    @property
    def name(self) -> str:
        return self.path.name.lower()

    @cached_property
    def text(self) -> str:
        """Raises InputError for what is no text: missing, empty, binary, a web page."""
        return read_text(self.path, "a trajectory file")

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first pose, in lower case."""
        lines: list[str] = []
        for line in self.text[:20_000].splitlines():
            if line.strip() and not line.lstrip().startswith("#"):
                break
            lines.append(line.lower())
        return "\n".join(lines)

    @cached_property
    def first_line(self) -> str:
        """The first line that is neither blank nor a comment, or ''."""
        for line in self.text.splitlines():
            if line.strip() and not line.lstrip().startswith("#"):
                return line.strip()
        return ""
