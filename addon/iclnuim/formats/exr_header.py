"""The header of an EXR file, read without any library: parts, size, channels, and whether every chunk is there.

Layout: OpenEXR's "File Layout" page. The libraries print to standard error on a broken file, and trust the size that a
header claims; so every header is checked here first.
"""

import os
import struct
from dataclasses import dataclass
from typing import BinaryIO

from ..errors import InputError
from .files import read_bytes

_MAGIC = b"\x76\x2f\x31\x01"
_TILED, _DEEP, _MULTIPART = 0x200, 0x800, 0x1000
_COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab")
_ROWS_A_CHUNK = dict(zip(_COMPRESSIONS, (1, 1, 1, 16, 32, 16, 32, 32, 32, 256), strict=True))
_PIXEL_TYPES = ("uint", "half", "float")
#: A frame beyond these counts as a broken or hostile header.
_MAX_SIDE_PX, _MAX_PIXEL_BYTES = 65536, 1 << 30
_LONGEST_HEADER = 1 << 18


@dataclass(frozen=True)
class ExrPart:
    """One part: channel name -> "half" or "float", in file order; size in pixels; text attributes."""

    channels: dict[str, str]
    width: int
    height: int
    compression: str
    attributes: dict[str, str]


@dataclass(frozen=True)
class ExrHeader:
    """All parts of a file; one, unless the writer splits passes into parts, as Blender 5 does."""

    parts: tuple[ExrPart, ...]

    @property
    def channels(self) -> dict[str, str]:
        return {name: kind for part in self.parts for name, kind in part.channels.items()}

    @property
    def width(self) -> int:
        return self.parts[0].width

    @property
    def height(self) -> int:
        return self.parts[0].height


def exr_header(path: str | os.PathLike[str], whole: bool = False) -> ExrHeader:
    """The header of `path`; with `whole`, also that each chunk the header promises lies inside the file. No pixel is read.

    Raises InputError for what is not a flat EXR of half and float channels of one sane size.
    """
    try:
        with open(path, "rb") as file:
            header, end, multipart = _parse(file.read(_LONGEST_HEADER))
            if whole:
                _check_chunks(file, header, end, multipart)
        return header
    except _Wrong as wrong:
        raise InputError(wrong.expected, path=path, found=wrong.found, hint=wrong.hint) from None
    except (OSError, ValueError):
        read_bytes(path, "an EXR image")  # for its error
        raise


class _Wrong(Exception):
    def __init__(self, expected: str, found: object, hint: str | None = None) -> None:
        self.expected, self.found, self.hint = expected, found, hint


_CUT = ("a whole EXR image", "a truncated file", "rendering or copying this frame again")


class _Cursor:
    """Reads little-endian values one after the other; running out of bytes means a truncated file."""

    def __init__(self, data: bytes, place: int) -> None:
        self.data, self.place = data, place

    def take(self, count: int) -> bytes:
        if not 0 <= count <= len(self.data) - self.place:
            raise _Wrong(*_CUT)
        self.place += count
        return self.data[self.place - count : self.place]

    def int32(self) -> int:
        return struct.unpack("<i", self.take(4))[0]

    def text(self) -> str:
        end = self.data.find(b"\0", self.place, self.place + 256)
        if end < 0:
            cut = len(self.data) - self.place < 256
            raise _Wrong(*_CUT) if cut else _Wrong("an EXR header", "a name over 255 bytes")
        text = self.take(end - self.place).decode("utf-8", "replace")
        self.place += 1
        return text


def _parse(data: bytes) -> tuple[ExrHeader, int, bool]:
    if not data:
        raise _Wrong("an EXR image", "an empty file", _CUT[2])
    if data[:4] != _MAGIC:
        raise _Wrong("an EXR image", "PNG" if data[1:4] == b"PNG" else f"a file that starts with {data[:4]!r}")
    cursor = _Cursor(data, 4)
    flags = cursor.int32()
    if flags & 0xFF != 2 or flags & (_TILED | _DEEP):
        kind = "deep pixels" if flags & _DEEP else "tiles" if flags & _TILED else f"version {flags & 0xFF}"
        raise _Wrong("a flat scan-line EXR", kind)
    multipart = bool(flags & _MULTIPART)
    parts = [_part(cursor)]
    while multipart and cursor.data[cursor.place : cursor.place + 1] != b"\0":
        parts.append(_part(cursor))
    if multipart:
        cursor.take(1)
    sizes = {(p.width, p.height) for p in parts}
    if len(sizes) > 1:
        raise _Wrong("parts of one size", sorted(sizes))
    return ExrHeader(tuple(parts)), cursor.place, multipart


def _part(cursor: _Cursor) -> ExrPart:
    raw: dict[str, bytes] = {}
    text: dict[str, str] = {}
    while name := cursor.text():
        kind, size = cursor.text(), cursor.int32()
        raw[name] = cursor.take(size)
        if kind == "string":
            text[name] = raw[name].decode("utf-8", "replace")
    if text.get("type", "scanlineimage") != "scanlineimage":
        raise _Wrong("a flat scan-line EXR", text["type"])
    missing = [n for n in ("channels", "compression", "dataWindow") if n not in raw]
    if missing or len(raw["dataWindow"]) != 16 or len(raw["compression"]) != 1:
        lacking = ", ".join(missing) or "valid sizes"
        raise _Wrong("an EXR header with channels, compression and dataWindow", f"no {lacking}")
    code = raw["compression"][0]
    if code >= len(_COMPRESSIONS):
        raise _Wrong(f"a compression among {', '.join(_COMPRESSIONS)}", f"number {code}")
    channels = _channels(raw["channels"])
    width, height = _size(raw["dataWindow"], channels)
    return ExrPart(channels, width, height, _COMPRESSIONS[code], text)


def _channels(raw: bytes) -> dict[str, str]:
    cursor, channels = _Cursor(raw, 0), {}
    while name := cursor.text():
        kind, _, x_sampling, y_sampling = struct.unpack("<iiii", cursor.take(16))
        if kind not in (1, 2) or (x_sampling, y_sampling) != (1, 1):
            what = "subsampled" if kind in (1, 2) else _PIXEL_TYPES[0] if kind == 0 else f"of type {kind}"
            raise _Wrong("half or float channels at full resolution", f"channel {name} {what}")
        channels[name] = _PIXEL_TYPES[kind]
    if not channels:
        raise _Wrong("an EXR with channels", "none")
    return channels


def _size(window: bytes, channels: dict[str, str]) -> tuple[int, int]:
    left, top, right, bottom = struct.unpack("<4i", window)
    width, height = right - left + 1, bottom - top + 1
    total_bytes = width * height * sum(2 if kind == "half" else 4 for kind in channels.values())
    sane = 1 <= width <= _MAX_SIDE_PX and 1 <= height <= _MAX_SIDE_PX and total_bytes <= _MAX_PIXEL_BYTES
    if not sane:
        claim = f"a header that claims {width} x {height} ({total_bytes / 1e9:.3g} GB)"
        raise _Wrong(f"an image of at most {_MAX_SIDE_PX} pixels a side and {_MAX_PIXEL_BYTES >> 30} GiB", claim)
    return width, height


def _check_chunks(file: BinaryIO, header: ExrHeader, table: int, multipart: bool) -> None:
    """Each part's table of offsets follows the headers; a chunk is [part] y size bytes."""
    lead, end = 12 if multipart else 8, file.seek(0, os.SEEK_END)
    for part in header.parts:
        count = -(-part.height // _ROWS_A_CHUNK[part.compression])
        for offset in struct.unpack(f"<{count}Q", _bytes_at(file, table, 8 * count)):
            if offset < table or offset + lead > end:
                raise _Wrong(*_CUT)
            size = struct.unpack("<i", _bytes_at(file, offset + lead - 4, 4))[0]
            if not 0 <= size <= end - offset - lead:
                raise _Wrong(*_CUT)
        table += 8 * count


def _bytes_at(file: BinaryIO, place: int, count: int) -> bytes:
    file.seek(place)
    data = file.read(count)
    if len(data) < count:
        raise _Wrong(*_CUT)
    return data
