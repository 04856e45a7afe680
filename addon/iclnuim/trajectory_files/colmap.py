"""COLMAP's images, as text or binary (https://colmap.github.io/format.html).

images.txt has lines `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, each followed by a line of
image points; images.bin is read as the text that it stands for.

Its images have no stamps. The last number in a name is the frame's number, or its stamp in
nanoseconds, or, with a decimal point, in seconds.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import data_lines, is_number
from ..geometry.trajectory import stamps_of_frames
from .colmap_binary import BinaryFile
from .columns import NumberTable
from .source import Source
from .stamps import ticks_unless_frames

EXPECTED = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME of COLMAP's images.txt"
_STAMP = re.compile(r"(\d+(?:\.\d+)?)(?:\.[A-Za-z]\w*)?$", re.ASCII)


@dataclass(frozen=True)
class _Images:
    """The images of a file in the order of time: their names, cameras, line numbers, and values
    (n, 8) as returned by `rows`.
    """

    names: list[str]
    cameras: list[str]
    lines: list[int]
    values: np.ndarray
    ticks: float | None


def names_an_image(line: str) -> bool:
    """Whether the tenth field, COLMAP's image name, is not a number."""
    fields = line.split(None, 10)
    return len(fields) >= 10 and not is_number(fields[9])


def rows(source: Source) -> NumberTable:
    """(n, 8) in the order of time: frame number (or stamp if the images are named by stamps),
    translation, quaternion (scalar last).

    Lines of image points are left out: all their fields are numbers.
    """
    images = _read(source)
    return NumberTable(images.values, lambda row: (source.path, images.lines[row]), images.ticks)


def stamps_and_names(path: StrPath) -> list[tuple[float, str]]:
    """Stamp in seconds and name of each image, in the order of time."""
    images = _read(source_of(path))
    first = images.values[:, 0]
    stamps_s = first / images.ticks if images.ticks else stamps_of_frames(first)
    return list(zip(stamps_s.tolist(), images.names, strict=True))


def camera_numbers(path: StrPath) -> set[str]:
    """The numbers of the cameras of the images."""
    return set(_read(source_of(path)).cameras)


def source_of(path: StrPath) -> Source:
    """A file to be read; the lines of a file of images that is binary."""
    source = Source(path)
    return source.with_text(_text_of_binary(source.path)) if is_binary(source.path) else source


def is_binary(path: Path) -> bool:
    """Whether a file has the name of COLMAP's binary images."""
    return path.name == "images.bin"


def _text_of_binary(path: Path) -> str:
    """The lines of images.txt that images.bin stands for, without points."""
    content = BinaryFile(path)
    lines = []
    (count,) = content.take("Q")
    for _ in range(count):
        number, *pose, camera = content.take("I7dI")
        name = content.take_name()
        (points,) = content.take("Q")
        content.skip(24 * points)
        values = " ".join(f"{value!r}" for value in pose)
        lines.append(f"{number} {values} {camera} {' '.join(name.split())}\n")
    return "".join(lines)


def _read(source: Source) -> _Images:
    lines = [(number, line) for number, line in data_lines(source.text) if names_an_image(line)]
    if not lines:
        raise InputError(EXPECTED, path=source.path, found="no such line")
    found = []
    whole = True
    for number, line in lines:
        fields = line.split(None, 9)
        stamp = _STAMP.search(fields[9])
        if not stamp or not all(map(is_number, fields[:9])):
            expected = f"{EXPECTED}, with a name that ends in the frame's number or stamp"
            raise InputError(expected, path=source.path, line=number, found=line)
        w, x, y, z, *translation = (float(field) for field in fields[1:8])
        pose = (float(stamp[1]), *translation, x, y, z, w)
        found.append((pose, number, fields[9], fields[8]))
        whole &= "." not in stamp[1]
    found.sort()
    values, numbers, names, cameras = zip(*found, strict=True)
    table = np.array(values)
    ticks = ticks_unless_frames(table[:, 0]) if whole else 1.0
    return _Images(list(names), list(cameras), list(numbers), table, ticks)
