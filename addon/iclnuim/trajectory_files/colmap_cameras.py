"""COLMAP's cameras, as text or binary: cameras.txt has lines `CAMERA_ID MODEL WIDTH HEIGHT PARAMS`
(https://colmap.github.io/format.html, cameras.html).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines, read_text
from .colmap_binary import BinaryFile


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
    content = BinaryFile(path)
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
