"""Reading and writing of PNG images, 8-bit colour and 16-bit depth.

They are read by OpenCV, or inside Blender by OpenImageIO, and compressed by libdeflate (package
deflate) at level 1, or, without it, by Python's zlib. Every row has the filter Sub. A noisy 640 x
480 colour image takes 6 ms and 0.54 MB (zlib: 10 ms, 0.56 MB; OpenCV at its fastest: 14 ms, 0.50
MB), a noisy depth image 2.2 ms and 0.21 MB (5.5 ms, 0.23 MB; 8 ms, 0.24 MB). libdeflate gives the
same bytes on every processor. Layout: W3C, Portable Network Graphics, sections 5 (chunks) and 9
(filters).
"""

import os
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from types import ModuleType

import numpy as np

from ..errors import InputError, StrPath, within
from .exif import refuse_turned
from .files import atomic_write_bytes, read_bytes
from .libraries import first_library

BACKENDS = ("cv2", "OpenImageIO")
#: Libraries that compress.
COMPRESSORS = ("deflate", "zlib")
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey with alpha", 6: "RGB with alpha"}
_SUB = 1
_MAX_SIDE_PX = 65536
_AGAIN = "writing or copying this image again"


@dataclass(frozen=True)
class PngHeader:
    """Size in pixels, bits per channel, and a description of the colour type."""

    width: int
    height: int
    bits: int
    colour: str

    def __str__(self) -> str:
        return f"{self.width} x {self.height}, {self.bits}-bit {self.colour}"


def png_header(path: StrPath) -> PngHeader:
    """Size and kind, from the first bytes only. Raises InputError if `path` is not a PNG."""
    return _header(path, read_bytes(path, "a PNG image", 33))


def read_rgb8(path: StrPath) -> np.ndarray:
    """Read (height, width, 3) uint8 in the order R, G, B; alpha is dropped, grey is repeated.

    Raises InputError for other files.
    """
    return _read(path, "an 8-bit colour PNG", 8, _COLOURS.values(), 3)


def read_depth16(path: StrPath) -> np.ndarray:
    """Read (height, width) uint16, raw units. Raises InputError unless it is a 16-bit grey PNG."""
    return _read(path, "a 16-bit grey depth PNG", 16, ("grey",), 1)[..., 0]


def read_rgb16(path: StrPath) -> np.ndarray:
    """Read (height, width, 3) uint16 in the order R, G, B: three values per pixel, such as normals.

    Raises InputError for other files.
    """
    return _read(path, "a 16-bit RGB PNG", 16, ("RGB",), 3)


def read_png(path: StrPath) -> np.ndarray:
    """Read (h, w) or (h, w, 3) uint16 of a PNG with 16 bits, (h, w, 3) uint8 of any other.

    Raises InputError.
    """
    header = png_header(path)
    if header.bits < 16:
        return read_rgb8(path)
    return read_rgb16(path) if header.colour == "RGB" else read_depth16(path)


def write_png(path: StrPath, image: np.ndarray) -> None:
    """Write RGB (h, w, 3) or grey (h, w), uint8 or uint16, atomically. The same pixels
    compressed by the same library give the same bytes.

    Raises InputError for other arrays, WorkError if it cannot be written.
    """
    with within(path):
        data = png_bytes(image)
    atomic_write_bytes(path, data)


def png_bytes(image: np.ndarray) -> bytes:
    """The file that write_png writes. Raises InputError for other arrays."""
    kinds = ((3, np.uint8), (3, np.uint16), (2, np.uint8), (2, np.uint16))
    if (image.ndim, image.dtype) not in kinds or image.shape[2:] not in ((), (3,)):
        expected = "(h, w, 3) or (h, w) of uint8 or uint16"
        raise InputError(expected, found=f"{image.shape} {image.dtype}")
    height, width = image.shape[:2]
    size = struct.pack(">II", width, height)
    kind = bytes((8 * image.itemsize, 2 if image.ndim == 3 else 0, 0, 0, 0))
    pixels = _compressor(COMPRESSORS)(_filtered(image).tobytes(), 1)
    chunks = (*chunk(b"IHDR", size + kind), *chunk(b"IDAT", pixels), *chunk(b"IEND", b""))
    return b"".join((_SIGNATURE, *chunks))


@cache
def _compressor(libraries: tuple[str, ...]) -> Callable[[bytes, int], bytes]:
    """Compresses bytes at a level, by the first of the libraries. Raises WorkError without one."""
    name, module = first_library("PNG", *libraries)
    return module.zlib_compress if name == "deflate" else module.compress


def same_pixels(a: StrPath, b: StrPath) -> bool:
    """Whether two PNG files contain the same image, however it is compressed.

    Raises InputError if one is damaged.
    """
    headers = checked_png(a)[1], checked_png(b)[1]
    kinds = {(8, "RGB"): read_rgb8, (16, "RGB"): read_rgb16, (16, "grey"): read_depth16}
    read = kinds.get((headers[0].bits, headers[0].colour))
    return headers[0] == headers[1] and read is not None and np.array_equal(read(a), read(b))


def _filtered(image: np.ndarray) -> np.ndarray:
    """(h, 1 + bytes of a row): each row as differences from the pixel to the left, after the number
    of this filter.
    """
    rows = np.ascontiguousarray(image, image.dtype.newbyteorder(">"))
    rows = rows.view(np.uint8).reshape(len(image), -1)
    step = rows.shape[1] // image.shape[1]
    filtered = np.empty((len(rows), 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = _SUB
    filtered[:, 1 : 1 + step] = rows[:, :step]
    np.subtract(rows[:, step:], rows[:, :-step], out=filtered[:, 1 + step :])
    return filtered


def chunk(kind: bytes, content: bytes) -> tuple[bytes, ...]:
    """The parts of a chunk: length, kind, content, checksum."""
    checksum = zlib.crc32(content, zlib.crc32(kind))
    return (struct.pack(">I", len(content)), kind, content, struct.pack(">I", checksum))


def chunks_of(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each chunk of a file that `checked_png` has read."""
    place = 8
    kind = b""
    while kind != b"IEND":
        size, kind = struct.unpack_from(">I4s", data, place)
        yield kind, data[place + 8 : place + 8 + size]
        place += 12 + size


def checked_png(path: StrPath) -> tuple[bytes, PngHeader]:
    """The content of the file and its header, after a check that every chunk is complete and has
    the right checksum, and that the image is not to be turned. OpenCV would decode half a file
    without an error.
    """
    data = read_bytes(path, "a PNG image")
    header = _header(path, data)
    place = 8
    kind = b""
    while kind != b"IEND":
        end = len(data) + 1
        if place + 12 <= len(data):
            size, kind = struct.unpack_from(">I4s", data, place)
            end = place + 12 + size
        if end > len(data):
            raise InputError("a whole PNG image", path=path, found="a truncated file", hint=_AGAIN)
        checksum = struct.unpack_from(">I", data, end - 4)[0]
        if zlib.crc32(memoryview(data)[place + 4 : end - 4]) != checksum:
            raise InputError("a whole PNG image", path=path, found="a wrong checksum", hint=_AGAIN)
        if kind == b"eXIf":
            refuse_turned(data[place + 8 : end - 4], path)
        place = end
    return data, header


def _header(path: StrPath, data: bytes) -> PngHeader:
    if data[:8] != _SIGNATURE:
        found = f"a file that starts with {data[:4]!r}" if data else "an empty file"
        if data[:2] == b"\xff\xd8":
            found = "a JPEG"
        raise InputError("a PNG image", path=path, found=found)
    if len(data) < 33 or data[12:16] != b"IHDR":
        raise InputError("a whole PNG image", path=path, found="a truncated file", hint=_AGAIN)
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    plausible = 1 <= width <= _MAX_SIDE_PX and 1 <= height <= _MAX_SIDE_PX
    if not plausible or width * height > 1 << 28:
        found = f"a header with {width} x {height}"
        raise InputError("an image of a plausible size", path=path, found=found)
    return PngHeader(width, height, bits, _COLOURS.get(colour, f"colour type {colour}"))


def _read(
    path: StrPath, expected: str, bits: int, colours: Collection[str], channels: int
) -> np.ndarray:
    """(height, width, channels)."""
    data, header = checked_png(path)
    if header.bits != bits or header.colour not in colours:
        raise InputError(expected, path=path, found=str(header))
    name, module = _decoder(BACKENDS)
    if name == "cv2":
        mode = module.IMREAD_COLOR if channels == 3 and bits == 8 else module.IMREAD_UNCHANGED
        image = module.imdecode(np.frombuffer(data, np.uint8), mode)
        if image is not None and channels == 3:
            image = module.cvtColor(image, module.COLOR_BGR2RGB)
        elif image is not None:
            image = image[..., None]
    else:
        image = read_oiio(module, os.fspath(path), header, channels)
    if image is None or image.shape != (header.height, header.width, channels):
        found = "pixels that cannot be decoded"
        raise InputError("a whole PNG image", path=path, found=found, hint=_AGAIN)
    return image


@cache
def _decoder(libraries: tuple[str, ...]) -> tuple[str, ModuleType]:
    """Name and module of the first of the libraries that read. Raises WorkError without one."""
    return first_library("PNG", *libraries)


def read_oiio(module: ModuleType, path: str, header: PngHeader, channels: int) -> np.ndarray | None:
    """(height, width, channels) by OpenImageIO; grey is repeated, alpha dropped. None if it
    fails.
    """
    config = module.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    image = module.ImageInput.open(path, config)
    if image is None:
        return None
    kind = module.UINT8 if header.bits == 8 else module.UINT16
    pixels = image.read_image(0, 0, 0, image.spec().nchannels, kind)
    image.close()
    if pixels is None:
        return None
    pixels = pixels.reshape(image.spec().height, image.spec().width, -1)
    if channels == 3 and pixels.shape[2] < 3:
        return np.repeat(pixels[..., :1], 3, -1)
    return pixels[..., :channels]
