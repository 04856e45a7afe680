"""A trajectory file to be read, the options of files that do not say everything, and the result."""

import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import data_lines, is_number, read_text
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from .column_names import names_in

OWN_WORLD = "the file's own world"
OUR_WORLD = "our world (metres, z up)"
_DATA = re.compile(r"^[^\S\n]*[^#\s]", re.MULTILINE)
_WITH_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
#: Names of columns are searched in so many of the comments before the first line of data.
_COMMENTS = 20
#: A line of names has at most so many characters: tables of ROS name two covariances of 36.
_LONGEST_NAMES = 4_000
_LONGEST_LINE = 10_000
#: What printf of older Windows programs writes for nan and infinity; # is no comment there.
_NAN_OF_WINDOWS = r"-?1\.#(?:INF|IND|QNAN)\w*"


@dataclass(frozen=True)
class ReadAs:
    """How a file was read: format, handedness of its poses, world of the resulting trajectory, and
    a sentence for the user. repeated: number of stamps that were left out because they repeat the
    previous one. lost: number of rows without a finite pose, which were left out. shift_m: what was
    subtracted from all positions, in `frame`. has_rotations: whether the file has rotations;
    without them, those of the trajectory are the identity.
    """

    format: str
    handedness: str
    frame: str
    sentence: str
    repeated: int = 0
    lost: int = 0
    shift_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    has_rotations: bool = True


@dataclass(frozen=True, eq=False, repr=False)
class LoadedTrajectory:
    """A right-handed trajectory of cv camera poses, and how its file was read.

    rows (n,): the rows of the poses, from 0, of row_count rows, lost ones included. is_counted:
    whether the file has neither stamps nor frame numbers; the stamps are those of the rows.
    is_numbered: whether it has frame numbers. by_depth: if depth images told which rows belong to
    which images, the figures.
    """

    trajectory: Trajectory
    read_as: ReadAs
    rows: np.ndarray = field(default_factory=lambda: np.arange(0))
    row_count: int = 0
    is_counted: bool = False
    is_numbered: bool = False
    by_depth: str = ""

    def __repr__(self) -> str:
        counts = {"lost": self.read_as.lost, "repeated": self.read_as.repeated}
        left_out = "".join(f", {count} {word}" for word, count in counts.items() if count)
        return f"LoadedTrajectory({self.read_as.format}, {self.trajectory}{left_out})"


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

    def __init__(self, path: StrPath) -> None:
        self.path = Path(path)

    def with_text(self, text: str) -> "Source":
        """The same path with another text."""
        other = Source(self.path)
        other.__dict__["_content"] = text
        return other

    @property
    def name(self) -> str:
        """The file's name in lower case."""
        return self.path.name.lower()

    @cached_property
    def text(self) -> str:
        """The text of the file, with line ends \\n. All comments are after #, also the names of
        columns before the data.

        Raises InputError for a missing, empty or binary file or a web page.
        """
        content = self._content
        found = _DATA.search(content)
        start = found.start() if found else len(content)
        if names_in(content[start : start + _LONGEST_NAMES].partition("\n")[0]):
            return f"{content[:start]}#{content[start:]}"
        return content

    @cached_property
    def _content(self) -> str:
        content = read_text(self.path, "a trajectory file")
        if "1.#" in content:
            content = re.sub(_NAN_OF_WINDOWS, "nan", content)
        content = content.replace("\r\n", "\n").replace("\r", "\n")
        if content.lstrip().startswith(("%", "//")):
            content = re.sub(r"^[^\S\n]*(?:%|//)", "#", content, flags=re.MULTILINE)
        return content

    @property
    def has_title(self) -> bool:
        """Whether the line of names is no comment in the file."""
        return len(self.text) > len(self._content)

    @cached_property
    def table(self) -> str:
        """The text for a reader of columns: without quotes, brackets, and separators at the ends of
        lines. Line numbers are those of the text.
        """
        return self._plain(self.text)

    def _plain(self, text: str) -> str:
        first = "".join(self.first_lines[:1])
        for sign in set("\"'[]").intersection(first):
            text = text.replace(sign, "")
        if ";" in first or self._has_decimal_commas:
            text = text.replace(",", ".")
        if first.endswith((",", ";")):
            text = re.sub(r"[,;.][^\S\n]*$", "", text, flags=re.MULTILINE)
        return text

    @cached_property
    def header(self) -> str:
        """The comment lines (#) before the first line of data, in lower case."""
        return self.text[: self._first_data].lower()

    @cached_property
    def names(self) -> list[str]:
        """The names of the columns in the last comment before the data that names x, y and z; [] if
        none does.
        """
        comments = self.text[: self._first_data].split("\n")
        for line in comments[: -_COMMENTS - 1 : -1]:
            if names := names_in(line[:_LONGEST_NAMES]):
                return names
        return []

    @cached_property
    def first_lines(self) -> list[str]:
        """The first four lines of data, without comments; fewer if the file has fewer."""
        start = self.text[self._first_data : self._first_data + _LONGEST_LINE]
        return [line for _, line in data_lines(start)][:4]

    @cached_property
    def delimiter(self) -> str | None:
        """What parts the columns of the first line of data: a semicolon, a comma, or (None) blanks
        and tabs.
        """
        if self._has_decimal_commas:
            return None
        inside = "".join(self.first_lines[:1]).rstrip(",;")
        return next((sign for sign in ";," if sign in inside), None)

    @cached_property
    def _has_decimal_commas(self) -> bool:
        """Whether blanks part the numbers of the first line of data, which have decimal commas."""
        fields = "".join(self.first_lines[:1]).split()
        return len(fields) > 2 and all(map(_WITH_COMMA.fullmatch, fields))

    @cached_property
    def first_rows(self) -> list[list[str]]:
        """The fields of the first four lines of data; fewer if the file has fewer."""
        rows = [self._plain(line).split(self.delimiter) for line in self.first_lines]
        return [[field.strip() for field in row] for row in rows]

    @property
    def columns(self) -> int:
        """The number of columns of the first line of data."""
        return len(self.first_rows[0]) if self.first_rows else 0

    @property
    def starts_with_numbers(self) -> bool:
        """Whether every field of the first line of data is a number."""
        return bool(self.first_rows) and all(map(is_number, self.first_rows[0]))

    @cached_property
    def _first_data(self) -> int:
        found = _DATA.search(self.text)
        return found.start() if found else len(self.text)
