"""The camera and the images of a pair, as a sequence stores them."""

from pathlib import Path

import numpy as np

from ..errors import InputError, within
from ..formats.depth_units import metres_from_depth16
from ..formats.images import ARRAY, image_header, read_array, read_colour8, seen_by
from ..formats.png import read_depth16
from ..geometry.camera import PinholeCamera
from .image_pairs import ImagePair
from .layout import SequenceCamera
from .sequence_formats import format_of

_CAMERA_HINT = (
    "a camera.json in this folder with width, height, fx, fy, cx, cy, "
    "or {camera} WIDTHxHEIGHT,FX,FY,CX,CY"
)


def read_camera(folder: Path, image: Path) -> SequenceCamera:
    """The camera in the sequence's files; else the benchmark's camera if the image has 640 x 480
    pixels.
    """
    with within(folder):
        there = format_of(folder).reader.camera(folder, image)
    if there is not None:
        return there
    header = image_header(image)
    if (header.width, header.height) != (640, 480):
        found = f"images of {header.width} x {header.height} and no camera.json"
        raise InputError("a camera", path=folder, found=found, hint=_CAMERA_HINT)
    return SequenceCamera(PinholeCamera(), assumed=True)


def read_depth_m(path: Path, units_per_metre: float) -> np.ndarray:
    """Read (h, w) float32 planar metres, 0 = missing, from a 16-bit PNG or an array of metres,
    whose NaN and infinity are missing depth.

    Raises InputError.
    """
    if path.suffix == ARRAY:
        depth_z_m = read_array(path)
        return np.where(np.isfinite(depth_z_m), depth_z_m, np.float32(0))
    return metres_from_depth16(read_depth16(path), units_per_metre)


def read_images(pair: ImagePair, camera: SequenceCamera) -> tuple[np.ndarray, np.ndarray]:
    """Read colour (h, w, 3) uint8 and planar depth (h, w) float32 in metres of a pair, both of the
    camera's size. Raises InputError.
    """
    colour = read_colour8(pair.rgb)
    depth_z_m = read_depth_m(pair.depth, camera.depth_units_per_metre)
    c = camera.pinhole
    for path, image, of in ((pair.rgb, colour, camera.colour or c), (pair.depth, depth_z_m, c)):
        if image.shape[:2] != (of.height, of.width):
            expected = f"{of.width} x {of.height} as in the camera"
            found = f"{image.shape[1]} x {image.shape[0]}"
            hint = "{camera} with the size of the images"
            raise InputError(expected, path=path, found=found, hint=hint)
    if camera.colour is not None:
        colour = seen_by(colour, camera.colour.K, c.K, c.width, c.height)
    return colour, depth_z_m
