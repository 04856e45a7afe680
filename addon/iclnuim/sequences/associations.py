"""Lists of images: `associations.txt` in either order, detected by content, and `rgb.txt` /
`depth.txt`.

TUM order: `stamp rgb/... stamp depth/...` in seconds. ICL-NUIM order: `id depth/... id rgb/...`
with frame numbers. Whole numbers that are also the names of the images (`600 rgb/600.png`) are
frame numbers in every list: systems that read TUM's order need the columns of the original swapped.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import atomic_write_text, data_lines, read_text
from ..geometry.trajectory import FRAME_RATE_HZ, frames_of_stamps, stamps_of_frames
from ..trajectory_files.stamps import (
    LARGEST_FRAME,
    LARGEST_STAMP_S,
    STAMP_SLACK,
    stamp_text,
    stamp_text_of_ns,
    stamp_ticks,
)

#: Larger numbers in names are no frame numbers, but stamps.
LARGEST_NUMBER = 9_999_999
PAIRS = "4 columns: stamp rgb/... stamp depth/... (TUM) or id depth/... id rgb/... (ICL-NUIM)"


@dataclass(frozen=True)
class ImageList:
    """Stamps in seconds, and paths as written in the file, relative to its folder.

    written: the exact text of the stamps in the file, so that a list that is written again has the
    same text; "" or () if they are not seconds.
    """

    stamps_s: tuple[float, ...]
    paths: tuple[str, ...]
    written: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if len(self.stamps_s) != len(self.paths):
            raise InputError(
                "as many paths as stamps", found=f"{len(self.paths)} and {len(self.stamps_s)}"
            )

    def stamp_texts(self) -> list[str]:
        """The text of each stamp in seconds, as it is written into a list."""
        if self.written:
            texts = zip(self.written, self.stamps_s, strict=True)
            return [text or stamp_text(stamp_s) for text, stamp_s in texts]
        return list(map(stamp_text, self.stamps_s))

    @property
    def is_numbered(self) -> bool:
        """Whether the stamps are written as whole numbers and are the names of the images: frame
        numbers.
        """
        return bool(self.written) and all(map(_is_number_of, self.written, self.paths))

    def by_frame_number(self) -> "ImageList":
        """The list with its stamps as frame numbers."""
        return ImageList(tuple(stamps_of_frames(self.stamps_s).tolist()), self.paths)

    def frame_numbers(self) -> list[int]:
        """The frame numbers: stamp = 1 + number / 30 s.

        Raises InputError for stamps between frames.
        """
        frames = frames_of_stamps(self.stamps_s)
        numbers = np.rint(frames)
        bad = np.flatnonzero(
            (np.abs(frames - numbers) > STAMP_SLACK) | (numbers < 0) | (numbers > LARGEST_FRAME)
        )
        if bad.size:
            whole = f"stamps of whole frame numbers, 1 + number / {FRAME_RATE_HZ:g} s"
            found = f"{self.stamps_s[bad[0]]:.9g} s"
            raise InputError(f"{whole}, to write ICL-NUIM's order", found=found)
        return numbers.astype(int).tolist()

    def __len__(self) -> int:
        return len(self.paths)


@dataclass(frozen=True)
class Associations:
    """Pairs of a colour and a depth image.

    `order`: the order of the columns in the file, "tum" or "icl-nuim".
    """

    rgb: ImageList
    depth: ImageList
    order: str = "tum"

    def __post_init__(self) -> None:
        if len(self.rgb) != len(self.depth):
            raise InputError(
                "as many depth as colour images", found=f"{len(self.depth)} and {len(self.rgb)}"
            )

    def __len__(self) -> int:
        return len(self.rgb)


def read_associations(path: StrPath) -> Associations:
    """Read associations in either order; the paths show which column is depth. Whole numbers in
    ICL-NUIM's order, and those that are the names of the images, are frame numbers, stamp = 1 + id
    / 30 s. Raises InputError with file and line.
    """
    rows = _rows(path, 4, PAIRS)
    firsts = ["depth" in fields[1].lower() for _, fields in rows]
    for (number, fields), first_is_depth in zip(rows, firsts, strict=True):
        if first_is_depth == ("depth" in fields[3].lower()) or first_is_depth != firsts[0]:
            expected = "the word depth in one of the two paths, always in the same column"
            raise InputError(expected, path=path, line=number, found=f"{fields[1]} and {fields[3]}")
    first, second = (_image_list(path, rows, column, increasing=column == 0) for column in (0, 2))
    whole = firsts[0] and all(stamp.is_integer() for stamp in (*first.stamps_s, *second.stamps_s))
    if whole or (first.is_numbered and second.is_numbered):
        first, second = (one.by_frame_number() for one in (first, second))
    if firsts[0]:
        return Associations(second, first, "icl-nuim")
    return Associations(first, second, "tum")


def read_image_lists(*paths: StrPath) -> tuple[ImageList, ...]:
    """Read `rgb.txt` and `depth.txt`: stamps in seconds, or, if all are the names of the images,
    frame numbers. Raises InputError.
    """
    lists = tuple(read_image_list(path) for path in paths)
    if all(one.is_numbered for one in lists):
        return tuple(one.by_frame_number() for one in lists)
    return lists


def write_associations(path: StrPath, pairs: Associations, order: str = "tum") -> None:
    """Write associations in TUM's order with seconds, or in ICL-NUIM's order with frame numbers,
    atomically.
    """
    if order == "icl-nuim":
        first = _entries(pairs.depth, pairs.depth.frame_numbers())
        second = _entries(pairs.rgb, pairs.rgb.frame_numbers())
    else:
        first = _entries(pairs.rgb, pairs.rgb.stamp_texts())
        second = _entries(pairs.depth, pairs.depth.stamp_texts())
    rows = zip(first, second, strict=True)
    atomic_write_text(path, "".join(f"{one} {other}\n" for one, other in rows))


def read_image_list(path: StrPath) -> ImageList:
    """Read `rgb.txt` or `depth.txt`: stamps in seconds, increasing.

    Raises InputError with file and line.
    """
    return _image_list(path, _rows(path, 2, "2 columns: stamp path"), 0, increasing=True)


def write_image_list(path: StrPath, images: ImageList) -> None:
    """Write a header `# timestamp filename` and one line per image, atomically."""
    lines = ["# timestamp filename", *_entries(images, images.stamp_texts()), ""]
    atomic_write_text(path, "\n".join(lines))


def _entries(images: ImageList, stamps: Iterable[object]) -> list[str]:
    """Stamp and path of each image."""
    return [f"{stamp} {_plain(path)}" for stamp, path in zip(stamps, images.paths, strict=True)]


def _rows(path: StrPath, columns: int, what: str) -> list[tuple[int, list[str]]]:
    lines = data_lines(read_text(path, "a list of images"))
    rows = [(number, line.split()) for number, line in lines]
    if not rows:
        raise InputError(what, path=path, found="comments alone")
    for number, fields in rows:
        if len(fields) != columns:
            raise InputError(what, path=path, line=number, found=f"{len(fields)} columns")
    return rows


def _image_list(
    path: StrPath, rows: list[tuple[int, list[str]]], column: int, increasing: bool
) -> ImageList:
    stamps = np.array([_finite(fields[column]) for _, fields in rows])
    ticks = stamp_ticks(stamps)
    stamps_s = (stamps / ticks).tolist()
    for (number, fields), stamp_s in zip(rows, stamps_s, strict=True):
        if not abs(stamp_s) <= LARGEST_STAMP_S:
            expected = f"a stamp in seconds in column {column + 1}"
            raise InputError(expected, path=path, line=number, found=repr(fields[column]))
    late = np.flatnonzero(np.diff(stamps_s) <= 0)
    if increasing and late.size:
        row = int(late[0]) + 1
        expected = f"a stamp above the {stamps_s[row - 1]:.15g} of line {rows[row - 1][0]}"
        raise InputError(expected, path=path, line=rows[row][0], found=f"{stamps_s[row]:.15g}")
    paths, written = (tuple(fields[place] for _, fields in rows) for place in (column + 1, column))
    if ticks != 1:
        written = tuple(_in_seconds(text, ticks) for text in written)
    return ImageList(tuple(stamps_s), paths, written)


def _in_seconds(text: str, ticks: float) -> str:
    """The text in seconds of a stamp in ticks; "" of one that is no whole number."""
    return stamp_text_of_ns(int(text) * round(1e9 / ticks)) if text.isdecimal() else ""


def _finite(text: str) -> float:
    """The number of a text; NaN for other texts."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _is_number_of(text: str, path: str) -> bool:
    """Whether a text is a whole number, and the name of an image."""
    if not text.isdecimal() or int(text) > LARGEST_NUMBER:
        return False
    return PurePath(path).stem.lstrip("0") == text.lstrip("0")


def _plain(image: str) -> str:
    if not image or image.split() != [image] or "#" in image:
        raise InputError("an image's path without blanks or #", found=repr(image))
    return image
