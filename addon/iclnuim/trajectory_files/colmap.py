"""COLMAP's images and cameras, as text or binary (https://colmap.github.io/format.html,
cameras.html).

cameras.txt has lines `CAMERA_ID MODEL WIDTH HEIGHT PARAMS`. images.txt has lines `IMAGE_ID QW QX QY
QZ TX TY TZ CAMERA_ID NAME`, each followed by a line of image points; images.bin is read as the text
that it stands for.

Its images have no stamps. The last number in a name is the frame's number, or its stamp in
nanoseconds, or, with a decimal point, in seconds.
"""

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, StrPath
from ..formats.files import data_lines, is_number, read_bytes, read_text
from ..geometry.trajectory import stamps_of_frames
from .number_table import NumberTable
from .source import Source
from .stamps import ticks_unless_frames


class _BinaryFile:
    """The content of a binary file, taken from its start."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.place = 0

    def take(self, form: str) -> tuple:
        """The next values of a form of `struct`, little-endian."""
        form = "<" + form
        try:
            found = struct.unpack_from(form, self.data, self.place)
        except struct.error:
            raise self.cut() from None
        self.place += struct.calcsize(form)
        return found

    def take_name(self) -> str:
        """The next text, which ends in a zero."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise self.cut()
        name = self.data[self.place : end].decode("utf-8", "replace")
        self.place = end + 1
        return name

    def skip(self, size: int) -> None:
        """Leave out the next bytes."""
        self.place += size
        if self.place > len(self.data):
            raise self.cut()

    def cut(self) -> InputError:
        """The error for a file that ends too early."""
        return InputError("a whole binary file of COLMAP", path=self.path, found="a damaged file")


EXPECTED = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME of COLMAP's images.txt"
_STAMP = re.compile(r"(\d+(?:\.\d+)?)(?:\.[A-Za-z]\w*)?$", re.ASCII)


@dataclass(frozen=True)
class _NamedImages:
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
    content = _BinaryFile(path)
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


def _read(source: Source) -> _NamedImages:
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
    return _NamedImages(list(names), list(cameras), list(numbers), table, ticks)


class Model(NamedTuple):
    """A camera model: the numbers of its focal lengths and of its coefficients, with the principal
    point between them; whether it is a pinhole camera if all coefficients are 0.
    """

    name: str
    focal_lengths: int
    coefficients: int
    is_pinhole: bool


#: The camera models in the order of their ids (src/colmap/sensor/models.h).
MODELS = (
    Model("SIMPLE_PINHOLE", 1, 0, True),
    Model("PINHOLE", 2, 0, True),
    Model("SIMPLE_RADIAL", 1, 1, True),
    Model("RADIAL", 1, 2, True),
    Model("OPENCV", 2, 4, True),
    Model("OPENCV_FISHEYE", 2, 4, False),
    Model("FULL_OPENCV", 2, 8, True),
    Model("FOV", 2, 1, False),
    Model("SIMPLE_RADIAL_FISHEYE", 1, 1, False),
    Model("RADIAL_FISHEYE", 1, 2, False),
    Model("THIN_PRISM_FISHEYE", 2, 8, False),
    Model("RAD_TAN_THIN_PRISM_FISHEYE", 2, 12, False),
    Model("SIMPLE_DIVISION", 1, 1, True),
    Model("DIVISION", 2, 1, True),
    Model("SIMPLE_FISHEYE", 1, 0, False),
    Model("FISHEYE", 2, 0, False),
    Model("EUCM", 2, 2, False),
    Model("EQUIRECTANGULAR", 0, 0, False),
)


class Camera(NamedTuple):
    """A camera as in the file, with pixel centres at +0.5."""

    model: Model
    width: int
    height: int
    focal_lengths: tuple[float, ...]
    centre: tuple[float, ...]
    coefficients: tuple[float, ...]


def read_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of cameras.txt or cameras.bin by number. Raises InputError."""
    return _binary_cameras(path) if path.suffix == ".bin" else _text_cameras(path)


def _text_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of cameras.txt by number."""
    found = {}
    for line, text in data_lines(read_text(path)):
        number, name, *values = [*text.split(), ""]
        model = next((model for model in MODELS if model.name == name), None)
        if model is None:
            raise InputError("a camera model of COLMAP", path=path, line=line, found=name)
        try:
            numbers = [float(value) for value in values[:-1]]
        except ValueError:
            numbers = []
        if len(numbers) != 2 + _parameters(model) or not np.isfinite(numbers).all():
            expected = f"CAMERA_ID MODEL WIDTH HEIGHT and the numbers of a {name}"
            raise InputError(expected, path=path, line=line, found=text)
        found[number] = _camera(model, numbers)
    return found


def _parameters(model: Model) -> int:
    return model.focal_lengths + 2 + model.coefficients


def _camera(model: Model, numbers: list[float]) -> Camera:
    """A camera of its width, height and parameters."""
    width, height, *parameters = numbers
    f = model.focal_lengths
    focal_lengths = tuple(parameters[:f])
    coefficients = tuple(parameters[f + 2 :])
    centre = tuple(parameters[f : f + 2])
    return Camera(model, int(width), int(height), focal_lengths, centre, coefficients)


def _binary_cameras(path: Path) -> dict[str, Camera]:
    """The cameras of cameras.bin by number."""
    content = _BinaryFile(path)
    found = {}
    (count,) = content.take("Q")
    for _ in range(count):
        number, model_id, width, height = content.take("IiQQ")
        if not 0 <= model_id < len(MODELS):
            expected = f"a camera model of COLMAP from 0 to {len(MODELS) - 1}"
            raise InputError(expected, path=path, found=model_id)
        model = MODELS[model_id]
        parameters = content.take(f"{_parameters(model)}d")
        if not np.isfinite(parameters).all():
            raise content.cut()
        found[str(number)] = _camera(model, [float(width), float(height), *parameters])
    return found
