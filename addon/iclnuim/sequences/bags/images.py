"""The pixels of the image messages of bags: raw ones of sensor_msgs/Image, and JPEG and PNG of
sensor_msgs/CompressedImage, also those of compressed_depth_image_transport.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...formats.depth_units import metres_from_depth16
from ...formats.images import JPEG, image_header, write_array
from ...formats.png import read_depth16, write_png

#: Encoding -> type of a value, number of channels, and the channels of R, G and B or of depth.
_RGB = (0, 1, 2)
_BGR = (2, 1, 0)
_ENCODINGS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "rgb8": ("u1", 3, _RGB),
    "rgba8": ("u1", 4, _RGB),
    "bgr8": ("u1", 3, _BGR),
    "8UC3": ("u1", 3, _BGR),
    "bgra8": ("u1", 4, _BGR),
    "8UC4": ("u1", 4, _BGR),
    "mono8": ("u1", 1, (0, 0, 0)),
    "8UC1": ("u1", 1, (0, 0, 0)),
    "16UC1": ("u2", 1, (0,)),
    "mono16": ("u2", 1, (0,)),
    "32FC1": ("f4", 1, (0,)),
}
_MAX_PIXELS = 1 << 28
#: compressed_depth_image_transport: an enumeration and the quantisation a, b of 32-bit depth,
#: whose 16-bit values are a / depth + b.
_DEPTH_HEADER = struct.Struct("<iff")


def save_colour(message: Any, place: Path) -> Path:
    """Write a colour image as `place`.png, or as it is compressed. Returns the path.

    Raises InputError for an image that cannot be read.
    """
    if hasattr(message, "encoding"):
        path = place.with_name(place.name + ".png")
        write_png(path, np.ascontiguousarray(_pixels(message, 3)))
        return path
    data = message.data.tobytes()
    path = place.with_name(place.name + (".png" if data.startswith(b"\x89PNG") else JPEG))
    path.write_bytes(data)
    image_header(path, whole=True)
    return path


def save_depth(message: Any, place: Path, units_per_metre: float) -> Path:
    """Write a depth image as `place`.npy in metres, 0 = missing. Returns the path.
    `units_per_metre` of 16-bit depth.

    Raises InputError for an image that cannot be read.
    """
    path = place.with_name(place.name + ".npy")
    if hasattr(message, "encoding"):
        depth = _pixels(message, 1)[..., 0]
        depth_m = depth if depth.dtype.kind == "f" else metres_from_depth16(depth, units_per_metre)
    else:
        scratch = place.with_name(place.name + ".png")
        depth_m = _decompressed(message, scratch, units_per_metre)
    write_array(path, np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0))
    return path


def _pixels(image: Any, wanted: int) -> np.ndarray:
    """(h, w, wanted channels) of a raw image, whose rows may be padded."""
    kind, channels, order = _ENCODINGS.get(image.encoding, ("", 0, ()))
    if len(order) != wanted:
        raise InputError("the encoding of the first image", found=image.encoding)
    row_bytes = image.width * channels * int(kind[1])
    height = image.height
    step = image.step
    pixels = height * image.width
    whole = row_bytes <= step and height * step <= len(image.data)
    if not 0 < pixels <= _MAX_PIXELS or not whole:
        found = f"{len(image.data)} bytes, {step} in a row"
        raise InputError(f"{image.width} x {height} pixels of {image.encoding}", found=found)
    rows = image.data[: height * step].reshape(height, step)[:, :row_bytes]
    values = np.ascontiguousarray(rows).view((">" if image.is_bigendian else "<") + kind)
    return values.reshape(height, image.width, channels)[..., order]


def _decompressed(message: Any, scratch: Path, units_per_metre: float) -> np.ndarray:
    """Metres (h, w) of a compressed depth image; `scratch`: a path for its PNG."""
    data = message.data.tobytes()
    a = b = 0.0
    if "compressedDepth" in message.format:
        if len(data) < _DEPTH_HEADER.size:
            raise InputError("a compressed depth image", found=f"{len(data)} bytes")
        _, a, b = _DEPTH_HEADER.unpack_from(data)
        data = data[_DEPTH_HEADER.size :]
    scratch.write_bytes(data)
    values = read_depth16(scratch)
    scratch.unlink()
    if not message.format.startswith("32FC1"):
        return metres_from_depth16(values, units_per_metre)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(a) / (values.astype(np.float32) - np.float32(b))
    return np.where(values > 0, depth_m, 0)
