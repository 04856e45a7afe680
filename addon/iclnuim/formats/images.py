"""Images of user-provided sequences: colour as PNG or JPEG, depth as 16-bit PNG or as an array of
metres (.npy, EXR). The format is detected by content.
"""

import io
import os
import re
import struct
from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from . import png
from .arrays import read_npy
from .exif import refuse_turned
from .exr import MAGIC, exr_header, read_exr
from .files import atomic_write, atomic_write_bytes, read_bytes
from .libraries import first_library
from .png import PngHeader

JPEG = ".jpg"
ARRAY = ".npy"
EXR = ".exr"
#: Endings of depth in metres.
METRES = (ARRAY, EXR)
#: JPEG quality. 100, without chroma subsampling, is nearly lossless.
_QUALITY = 100
_NUMPY = b"\x93NUMPY"
_JPEG = b"\xff\xd8\xff"
#: The segment of a JPEG with EXIF data, and how it starts.
_APP1 = 0xE1
_EXIF = b"Exif\0\0"
_MAX_PIXELS = 1 << 28
#: Where no surface is, Blender writes 1e10 m, which as half is this or infinite.
_BACKGROUND_M = 65504.0
#: Channels of depth in a layer, unlike those of its vectors.
_DEPTH_CHANNEL = re.compile(r"(?i)(?!.*(?:normal|position|vector)).*\.[zvy]")


def image_header(path: StrPath, whole: bool = False) -> PngHeader:
    """Size and kind of a PNG, JPEG, .npy or EXR image. `whole`: read the file to its end and verify its
    checksums, if it has any.

    Raises InputError if `path` is none of these, or damaged.
    """
    start = read_bytes(path, "an image", 8)
    if start.startswith(_JPEG):
        return _jpeg_header(path, read_bytes(path, "an image"))
    if start.startswith(_NUMPY):
        height, width = read_array(path).shape
        return PngHeader(width, height, 32, "grey, metres")
    if start.startswith(MAGIC):
        header = exr_header(path, whole)
        bits = 16 if set(header.channels.values()) == {"half"} else 32
        return PngHeader(header.width, header.height, bits, "EXR, metres")
    return png.checked_png(path)[1] if whole else png.png_header(path)


def read_colour8(path: StrPath) -> np.ndarray:
    """Read a PNG or JPEG as (height, width, 3) uint8 in the order R, G, B.

    Raises InputError for other files.
    """
    if not read_bytes(path, "an image", 8).startswith(_JPEG):
        return png.read_rgb8(path)
    data = read_bytes(path, "an image")
    header = _jpeg_header(path, data)
    name, module = first_library("JPEG", *png.BACKENDS)
    if name == "cv2":
        mode = module.IMREAD_COLOR | module.IMREAD_IGNORE_ORIENTATION
        image = module.imdecode(np.frombuffer(data, np.uint8), mode)
        if image is not None:
            image = module.cvtColor(image, module.COLOR_BGR2RGB)
    else:
        image = png.read_oiio(module, os.fspath(path), header, 3)
    if image is None or image.shape != (header.height, header.width, 3):
        raise InputError("a whole JPEG image", path=path, found="pixels that cannot be decoded")
    return image


def seen_by(
    image: np.ndarray, K: np.ndarray, K_new: np.ndarray, width: int, height: int
) -> np.ndarray:
    """Resample the image (h, w, 3) uint8 of a camera K to a camera K_new with the same pose:
    (height, width, 3), black outside. Needs OpenCV.
    """
    _, cv2 = first_library("colour of another size than depth", "cv2")
    scale = K[[0, 1], [0, 1]] / K_new[[0, 1], [0, 1]]
    if (scale > 1).any():  # downsampling: pixels are averaged
        image = cv2.blur(image, tuple(max(1, round(s)) for s in scale.tolist()))
    u = (np.arange(width) - K_new[0, 2]) * scale[0] + K[0, 2]
    v = (np.arange(height) - K_new[1, 2]) * scale[1] + K[1, 2]
    u, v = (a.astype(np.float32) for a in np.broadcast_arrays(u, v[:, None]))
    return cv2.remap(image, u, v, cv2.INTER_LINEAR)


def read_array(path: StrPath) -> np.ndarray:
    """Read (height, width) float32 from a NumPy file.

    Raises InputError for other arrays, and for Python objects, which are never loaded.
    """
    expected = "a NumPy array of depth, height x width, in metres"
    depth_m = read_npy(path, expected)
    if depth_m.ndim != 2 or depth_m.dtype.kind != "f" or depth_m.size > _MAX_PIXELS:
        raise InputError(expected, path=path, found=f"{depth_m.dtype} {depth_m.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        return depth_m.astype(np.float32)


def read_metres(path: StrPath) -> np.ndarray:
    """Read (height, width) float32 from a NumPy or EXR file of depth; NaN or infinity: no depth.

    Raises InputError.
    """
    if not read_bytes(path, "depth in metres", 8).startswith(MAGIC):
        return read_array(path)
    depth_m = exr_depth(path).astype(np.float32)
    return np.where(depth_m < _BACKGROUND_M, depth_m, np.float32(np.inf))


def exr_depth(path: StrPath) -> np.ndarray:
    """Read (height, width) half or float depth of an EXR file: its channel Z, V, Y or depth, or that
    of a pass, or the only one, or R if R, G and B are equal. Raises InputError for other channels.
    """
    channels = read_exr(path)
    of_passes = [n for n in channels if "depth" in n.lower().split(".")]
    of_layers = [n for n in channels if _DEPTH_CHANNEL.fullmatch(n)]
    for names in ([n for n in channels if n in ("Z", "V", "Y")], of_passes, of_layers, [*channels]):
        if len(names) == 1:
            return channels[names[0]]
    grey = [channels[name] for name in "RGB" if name in channels]
    if len(grey) == 3 and all(np.array_equal(grey[0], other) for other in grey):
        return grey[0]
    expected = "an EXR image with one channel of depth (Z, V, Y, Depth.Z)"
    raise InputError(expected, path=path, found=f"channels {', '.join(channels)}"[:200])


def write_jpeg(path: StrPath, image: np.ndarray) -> None:
    """Write (h, w, 3) uint8 RGB as JPEG, atomically. Raises WorkError if it cannot be written."""
    name, module = first_library("JPEG", *png.BACKENDS)
    if name == "cv2":
        settings = [module.IMWRITE_JPEG_QUALITY, _QUALITY]
        settings += [module.IMWRITE_JPEG_SAMPLING_FACTOR, module.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        data = module.imencode(JPEG, module.cvtColor(image, module.COLOR_RGB2BGR), settings)[1]
        atomic_write_bytes(path, data)
        return

    def write(temporary: Path) -> None:
        spec = module.ImageSpec(image.shape[1], image.shape[0], 3, module.UINT8)
        spec.attribute("Compression", f"jpeg:{_QUALITY}")
        spec.attribute("jpeg:subsampling", "4:4:4")
        spec.attribute("Software", "")
        output = module.ImageOutput.create(str(temporary))
        if not output:
            raise OSError(module.geterror())
        opened = output.open(str(temporary), spec)
        if not (opened and output.write_image(image) and output.close()):
            raise OSError(output.geterror())

    atomic_write(path, write)


def write_array(path: StrPath, depth_z_m: np.ndarray) -> None:
    """Write (h, w) metres as float32 .npy, atomically. Raises WorkError if it cannot be written."""
    file = io.BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(depth_z_m, "<f4"), (1, 0))
    atomic_write_bytes(path, file.getvalue())


def _jpeg_header(path: StrPath, data: bytes) -> PngHeader:
    """Size and kind from the frame header (SOF).

    Raises InputError if the file has no end marker, is damaged, or is to be turned.
    """
    place = 2
    cut = InputError("a whole JPEG image", path=path, found="a truncated or damaged file")
    if b"\xff\xd9" not in data[-64:]:
        raise cut
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        size = struct.unpack_from(">H", data, place + 2)[0]
        if marker == _APP1 and data[place + 4 : place + 10] == _EXIF:
            refuse_turned(data[place + 10 : place + 2 + size], path)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            bits, height, width, channels = struct.unpack_from(">BHHB", data, place + 4)
            if not 0 < width * height <= _MAX_PIXELS or bits != 8:
                found = f"{width} x {height}, {bits} bits"
                raise InputError("an image of a sane size", path=path, found=found)
            colour = {1: "grey", 3: "RGB"}.get(channels, f"with {channels} channels")
            return PngHeader(width, height, bits, colour)
        place += 2 + size
    raise cut
