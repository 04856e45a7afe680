"""The original's raw `.depth` frames, text: each pixel's distance along the ray, row by row; turned into planar Z."""

from __future__ import annotations

import os

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from .files import read_text
from .table import data_lines

#: POV-Ray gives what it hits nothing at some huge distance; rooms end long before this.
NOTHING_BEYOND_M = 1e4


def read_ray_depth(path: str | os.PathLike[str], camera: PinholeCamera, unit_m: float = 1.0) -> np.ndarray:
    """(height, width) planar metres, 0 where nothing was hit; unit_m = 0.01 for cm.

    Z = d / sqrt(((u-cx)/fx)^2 + ((v-cy)/fy)^2 + 1). Raises InputError for other than width x height distances.
    """
    text = read_text(path, "a .depth file")
    distance = _numbers(path, text)
    count = camera.width * camera.height
    if distance.size != count:
        expected = f"{count} distances, {camera.width} x {camera.height}"
        raise InputError(expected, path=path, found=distance.size, hint="the camera of this file")
    distance_m = distance.reshape(camera.height, camera.width) * unit_m
    depth_z_m = camera.planar_from_ray_distance(distance_m)
    return np.where(distance_m > NOTHING_BEYOND_M, 0.0, depth_z_m)


def _numbers(path: str | os.PathLike[str], text: str) -> np.ndarray:
    """All numbers of a text, finite and not negative."""
    try:
        values = np.array([float(field) for field in text.split()])
        good = bool(np.isfinite(values).all() and (values >= 0).all())
    except ValueError:
        good = False
    if not good:
        raise _first_bad_number(path, text)
    return values


def _first_bad_number(path: str | os.PathLike[str], text: str) -> InputError:
    expected = "distances along the ray, numbers >= 0"
    for number, line in data_lines(text):
        for field in line.split():
            try:
                good = 0 <= float(field) < np.inf
            except ValueError:
                good = False
            if not good:
                return InputError(expected, path=path, line=number, found=repr(field[:40]))
    return InputError(expected, path=path, found="something else")
