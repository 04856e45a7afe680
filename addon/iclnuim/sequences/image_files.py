"""The image files of a frame: each image is encoded once for all files that store it in the same
way, and copied if the original stores it so.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..channels import CHANNELS, DEPTH
from ..formats.files import atomic_write, read_bytes, sha256
from ..formats.images import ARRAY, JPEG, image_header, write_array, write_jpeg
from ..formats.png import same_pixels, write_png
from ..geometry.camera import PinholeCamera


class Place(NamedTuple):
    """The path of an image to write, and its depth units per metre."""

    path: Path
    units: float


#: The files of a frame by channel.
Places = dict[str, list[Place]]


def paths_of(places: Places) -> list[Path]:
    """All files of a frame."""
    found = []
    for files in places.values():
        found += [place.path for place in files]
    return found


def stored_as(kind: str, place: Place, units: float) -> str:
    """A key of how an image is stored: its channel, with its ending if it is not PNG, and its scale
    if it is not that of the sequence. Files with the same key have the same content.
    """
    if place.path.suffix != ".png":
        return kind + place.path.suffix
    scaled = kind == DEPTH and place.units != units
    return f"{kind} {place.units:g} a metre" if scaled else kind


def encoder(kind: str, image: np.ndarray) -> Callable[[Place], None]:
    """A function that writes the image to a place, in the format of its ending; depth is given in
    metres.
    """

    def write(place: Place) -> None:
        if place.path.suffix == JPEG:
            write_jpeg(place.path, image)
        elif place.path.suffix == ARRAY:
            write_array(place.path, np.where(np.isfinite(image) & (image > 0), image, 0))
        else:
            write_png(place.path, CHANNELS[kind].encode(image, place.units))

    return write


def copier(original: Path) -> Callable[[Place], None]:
    """A function that copies the file to a place."""

    def write(place: Place) -> None:
        data = read_bytes(original, "an image")
        atomic_write(place.path, lambda temporary: temporary.write_bytes(data))

    return write


def write_images(
    kind: str, places: list[Place], units: float, write: Callable[[Place], None]
) -> dict[str, str]:
    """Write an image to all its places; it is encoded once for each key of `stored_as`.

    Returns SHA-256 by key.
    """
    found: dict[str, Place] = {}
    for place in places:
        key = stored_as(kind, place, units)
        if key not in found:
            write(place)
            found[key] = place
            continue
        place.path.unlink(missing_ok=True)
        try:
            os.link(found[key].path, place.path)
        except OSError:  # a file system without links
            write(place)
    return {key: sha256(read_bytes(place.path)) for key, place in found.items()}


def can_be_copied(path: Path, kind: str, camera: PinholeCamera) -> bool:
    """Whether a file is valid, of the camera's size, and 8-bit RGB, 16-bit grey, or metres. Raises
    InputError if it is damaged.
    """
    header = image_header(path, whole=True)
    stored = (header.bits, header.colour)
    right = stored == (8, "RGB")
    if kind == DEPTH:
        right = stored in ((16, "grey"), (32, "grey, metres"))
    return right and (header.width, header.height) == (camera.width, camera.height)


def same_image(a: Path, b: Path) -> bool:
    """Whether two image files of the same format are equal; PNGs may be compressed in different
    ways.
    """
    return a.read_bytes() == b.read_bytes() or (a.suffix == ".png" and same_pixels(a, b))
