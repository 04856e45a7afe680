"""Reading and writing of EXR images by the OpenEXR package, or inside Blender by OpenImageIO. The
pixels are equal.

Compression is zip: one 640 x 480 frame of half R, G, B and float Z takes 1.8 MB, 30 ms to write and
7.5 ms to read (piz: 2.0 MB, 48 ms, 13 ms). OpenImageIO would be sufficient, but it writes the
header's attributes in other bytes, and reads 1.6 to 2.3 times as slowly. The libraries print to
standard error for a damaged file, and do not verify the size in the header. Therefore every header
is checked here first, without the libraries. Layout: OpenEXR's "File Layout" page.
"""

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

import numpy as np

from ..errors import InputError, StrPath, WorkError
from .files import atomic_write, read_bytes
from .libraries import first_library

BACKENDS = ("OpenEXR", "OpenImageIO")
MAGIC = b"\x76\x2f\x31\x01"
_TILED = 0x200
_DEEP = 0x800
_MULTIPART = 0x1000
_COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab")
_ROWS_A_CHUNK = dict(zip(_COMPRESSIONS, (1, 1, 1, 16, 32, 16, 32, 32, 32, 256), strict=True))
_TYPES: dict[str, np.dtype] = {"half": np.dtype(np.float16), "float": np.dtype(np.float32)}
#: A header with a larger frame is rejected as damaged or malicious.
_MAX_SIDE_PX = 65536
_MAX_PIXEL_BYTES = 1 << 30
_LONGEST_HEADER = 1 << 18
_AGAIN = "rendering or copying this frame again"


@dataclass(frozen=True)
class ExrPart:
    """One part of a file. channels: name -> "half" or "float", in file order; size in pixels; text
    attributes.
    """

    channels: dict[str, str]
    width: int
    height: int
    compression: str
    attributes: dict[str, str]


@dataclass(frozen=True)
class ExrHeader:
    """All parts of a file, their common size and all of their channels. There is one part, unless
    the writer splits passes into parts, as Blender 5 does.
    """

    parts: tuple[ExrPart, ...]
    width: int
    height: int
    channels: dict[str, str]


def read_exr(path: StrPath) -> dict[str, np.ndarray]:
    """Read every channel of every part by its full name: (height, width), float16 or float32 as
    stored.

    Raises InputError if the file is missing, truncated, not a flat EXR, or of an implausible size.
    """
    header = exr_header(path, whole=True)
    name, module = first_library("EXR", *BACKENDS)
    try:
        if name == "OpenEXR":
            channels = _read_openexr(module, os.fspath(path))
        else:
            channels = _read_oiio(module, os.fspath(path), header)
    except (RuntimeError, ValueError, UnicodeDecodeError) as error:
        raise InputError("a whole EXR image", path=path, found=error, hint=_AGAIN) from None
    size = (header.height, header.width)
    whole = {name for name, pixels in channels.items() if pixels.shape == size}
    lacking = [name for name in header.channels if name not in whole]
    if lacking:
        found = f"no pixels for {', '.join(lacking)}"
        raise InputError("a whole EXR image", path=path, found=found)
    return channels


def write_exr(
    path: StrPath,
    channels: Mapping[str, np.ndarray],
    attributes: Mapping[str, str] | None = None,
    compressed: bool = True,
) -> None:
    """Write (height, width) float16 or float32 arrays under their names, and text attributes into
    the header.

    compressed: compress by ZIP, which reduces a rendered frame from 3.1 to 2.3 MB and takes seven
    times as long as writing uncompressed.

    The same pixels and attributes give the same bytes: date and host are not written.

    The file is written atomically. Raises InputError for other arrays, WorkError if it cannot be
    written.
    """
    channels = {name: np.ascontiguousarray(values) for name, values in sorted(channels.items())}
    shapes = {values.shape for values in channels.values()}
    if len(shapes) != 1 or len(shape := shapes.copy().pop()) != 2 or 0 in shape:
        raise InputError("channels of one shape (height, width)", path=path, found=sorted(shapes))
    for name, values in channels.items():
        if values.dtype not in (np.float16, np.float32):
            raise InputError(f"channel {name} as float16 or float32", path=path, found=values.dtype)
    name, module = first_library("EXR", *BACKENDS)
    write = _write_openexr if name == "OpenEXR" else _write_oiio

    def write_and_check(temporary: Path) -> None:
        try:
            write(module, str(temporary), channels, attributes or {}, compressed)
            exr_header(temporary, whole=True)  # the libraries do not always report a full disk
        except (RuntimeError, ValueError, InputError) as error:
            reason = str(error).replace(f"{temporary}: ", "").replace(str(temporary), "the file")
            reason = " ".join(reason.split()) or "the disk may be full"
            raise WorkError(f"{os.fspath(path)}: cannot write: {reason}") from None

    atomic_write(path, write_and_check)


def _read_openexr(module: ModuleType, path: str) -> dict[str, np.ndarray]:
    channels: dict[str, np.ndarray] = {}
    with module.File(path, separate_channels=True) as file:
        for part in file.parts:
            for name, channel in part.channels.items():
                channels[name] = channel.pixels
    return channels


def _write_openexr(
    module: ModuleType,
    path: str,
    channels: dict[str, np.ndarray],
    attributes: Mapping[str, str],
    compressed: bool,
) -> None:
    kind = module.ZIP_COMPRESSION if compressed else module.NO_COMPRESSION
    settings = {**attributes, "compression": kind, "type": module.scanlineimage}
    with module.File(settings, channels) as file:
        file.write(path)


def _read_oiio(module: ModuleType, path: str, header: ExrHeader) -> dict[str, np.ndarray]:
    image = module.ImageInput.open(path)
    if image is None:
        raise ValueError(module.geterror())
    channels: dict[str, np.ndarray] = {}
    for index, part in enumerate(header.parts):
        pixels = image.read_image(index, 0, 0, len(part.channels), module.FLOAT)
        if pixels is None:
            raise ValueError(image.geterror())
        # R, G, B are sorted to the front; the part's name may be a prefix
        names = [f".{name}" for name in image.spec(index).channelnames]
        for name, kind in part.channels.items():
            places = [i for i, own in enumerate(names) if own.endswith(f".{name}")]
            if not places:
                raise ValueError(f"no channel {name}")
            channels[name] = pixels[..., places[0]].astype(_TYPES[kind])
    image.close()
    return channels


def _write_oiio(
    module: ModuleType,
    path: str,
    channels: dict[str, np.ndarray],
    attributes: Mapping[str, str],
    compressed: bool,
) -> None:
    height, width = next(iter(channels.values())).shape
    spec = module.ImageSpec(width, height, len(channels), module.FLOAT)
    spec.channelnames = tuple(channels)
    formats = {"float16": module.HALF, "float32": module.FLOAT}
    spec.channelformats = tuple(formats[values.dtype.name] for values in channels.values())
    for name, text in attributes.items():
        spec.attribute(name, text)
    spec.attribute("compression", "zip" if compressed else "none")
    spec.attribute("DateTime", "")  # without this, the library writes the current time
    output = module.ImageOutput.create(path)
    if output is None or not output.open(path, spec):
        raise ValueError(output.geterror() if output else module.geterror())
    stacked = np.stack([v.astype(np.float32) for v in channels.values()], axis=-1)
    if not output.write_image(stacked) or not output.close():
        raise ValueError(output.geterror())


def exr_header(path: StrPath, whole: bool = False) -> ExrHeader:
    """The header of `path`. `whole`: also check that each chunk listed in the header is inside the
    file. No pixel is read.

    Raises InputError unless it is a flat EXR of half and float channels of one plausible size.
    """
    try:
        with open(path, "rb", buffering=0) as file:
            header, end, multipart = _parse(file.read(_LONGEST_HEADER))
            if whole:
                _check_chunks(file, header, end, multipart)
        return header
    except InputError as error:
        raise error.at(path) from None
    except (OSError, ValueError):
        read_bytes(path, "an EXR image")  # raises the InputError
        raise


def _cut() -> InputError:
    return InputError("a whole EXR image", found="a truncated file", hint=_AGAIN)


class _Cursor:
    """Reads little-endian values one after the other.

    Raises InputError for a truncated file at the end of the data.
    """

    def __init__(self, data: bytes, place: int) -> None:
        self.data = data
        self.place = place

    def take(self, count: int) -> bytes:
        if not 0 <= count <= len(self.data) - self.place:
            raise _cut()
        self.place += count
        return self.data[self.place - count : self.place]

    def int32(self) -> int:
        return struct.unpack("<i", self.take(4))[0]

    def text(self) -> str:
        end = self.data.find(b"\0", self.place, self.place + 256)
        if end < 0 and len(self.data) - self.place < 256:
            raise _cut()
        if end < 0:
            raise InputError("an EXR header", found="a name over 255 bytes")
        text = self.take(end - self.place).decode("utf-8", "replace")
        self.place += 1
        return text


def _parse(data: bytes) -> tuple[ExrHeader, int, bool]:
    if not data:
        raise InputError("an EXR image", found="an empty file", hint=_AGAIN)
    if data[:4] != MAGIC:
        found = "PNG" if data[1:4] == b"PNG" else f"a file that starts with {data[:4]!r}"
        raise InputError("an EXR image", found=found)
    cursor = _Cursor(data, 4)
    flags = cursor.int32()
    if flags & 0xFF != 2 or flags & (_TILED | _DEEP):
        kind = f"version {flags & 0xFF}"
        if flags & _TILED:
            kind = "tiles"
        if flags & _DEEP:
            kind = "deep pixels"
        raise InputError("a flat scan-line EXR", found=kind)
    multipart = bool(flags & _MULTIPART)
    parts = [_part(cursor)]
    while multipart and cursor.data[cursor.place : cursor.place + 1] != b"\0":
        parts.append(_part(cursor))
    if multipart:
        cursor.take(1)
    sizes = {(p.width, p.height) for p in parts}
    if len(sizes) > 1:
        raise InputError("parts of one size", found=sorted(sizes))
    channels: dict[str, str] = {}
    for part in parts:
        channels |= part.channels
    return ExrHeader(tuple(parts), *sizes.pop(), channels), cursor.place, multipart


def _part(cursor: _Cursor) -> ExrPart:
    raw: dict[str, bytes] = {}
    text: dict[str, str] = {}
    while name := cursor.text():
        kind = cursor.text()
        size = cursor.int32()
        raw[name] = cursor.take(size)
        if kind == "string":
            text[name] = raw[name].decode("utf-8", "replace")
    if text.get("type", "scanlineimage") != "scanlineimage":
        raise InputError("a flat scan-line EXR", found=text["type"])
    missing = [n for n in ("channels", "compression", "dataWindow") if n not in raw]
    if missing or len(raw["dataWindow"]) != 16 or len(raw["compression"]) != 1:
        lacking = ", ".join(missing) or "valid sizes"
        raise InputError(
            "an EXR header with channels, compression and dataWindow", found=f"no {lacking}"
        )
    code = raw["compression"][0]
    if code >= len(_COMPRESSIONS):
        raise InputError(f"a compression among {', '.join(_COMPRESSIONS)}", found=f"number {code}")
    channels = _channels(raw["channels"])
    left, top, right, bottom = struct.unpack("<4i", raw["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    pixel_bytes = sum(_TYPES[kind].itemsize for kind in channels.values())
    total_bytes = width * height * pixel_bytes
    plausible = 0 < width <= _MAX_SIDE_PX and 0 < height <= _MAX_SIDE_PX
    if not plausible or total_bytes > _MAX_PIXEL_BYTES:
        limits = f"{_MAX_SIDE_PX} pixels a side and {_MAX_PIXEL_BYTES >> 30} GiB"
        found = f"a header with {width} x {height} ({total_bytes / 1e9:.3g} GB)"
        raise InputError(f"an image of at most {limits}", found=found)
    return ExrPart(channels, width, height, _COMPRESSIONS[code], text)


def _channels(raw: bytes) -> dict[str, str]:
    cursor = _Cursor(raw, 0)
    channels = {}
    while name := cursor.text():
        kind, _, x_sampling, y_sampling = struct.unpack("<iiii", cursor.take(16))
        if kind not in (1, 2) or (x_sampling, y_sampling) != (1, 1):
            what = {0: "uint", 1: "subsampled", 2: "subsampled"}.get(kind, f"of type {kind}")
            expected = "half or float channels at full resolution"
            raise InputError(expected, found=f"channel {name} {what}")
        channels[name] = "half" if kind == 1 else "float"
    if not channels:
        raise InputError("an EXR with channels", found="none")
    return channels


def _check_chunks(file: BinaryIO, header: ExrHeader, table: int, multipart: bool) -> None:
    """Check that all chunks are inside the file.

    Each part's offset table follows the headers; a chunk is [part] y size bytes.
    """
    lead = 12 if multipart else 8
    end = file.seek(0, os.SEEK_END)
    for part in header.parts:
        count = -(-part.height // _ROWS_A_CHUNK[part.compression])
        file.seek(table)
        for (offset,) in struct.iter_unpack("<Q", _Cursor(file.read(8 * count), 0).take(8 * count)):
            if offset < table or offset + lead > end:
                raise _cut()
            file.seek(offset + lead - 4)
            if not 0 <= int.from_bytes(file.read(4), "little", signed=True) <= end - offset - lead:
                raise _cut()
        table += 8 * count
