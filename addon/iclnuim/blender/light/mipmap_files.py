"""Levels of mipmaps on disk, so that they are made once: uncompressed 24-bit BMP files in the
cache, which Cycles reads itself, without a copy in Blender's memory.

A file is named KEY-WIDTHxHEIGHT-HALVINGS.bmp: the key is a hash of the picture's own file and of
what else decides the levels, the size is that of the picture, and `halvings` says how often it was
halved before (see mipmap_memory.py). Only pictures of 8 bits are kept.
"""

import hashlib
import os
import re
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Image

from ...errors import IclnuimError
from ...formats.files import atomic_write
from .. import compat
from .mipmap_images import levels_shape

#: What the files take at most, in bytes. A run needs at most three quarters of it: see MAX_BYTES of
#: mipmap_memory.py, which counts four bytes a texel.
MAX_BYTES = 2_000_000_000
#: A file that was used within this time is not removed: its process may not have read it yet.
_IN_USE_S = 3600.0
#: Bytes before the pixels of a BMP: its two headers.
_START = 14 + 40
_NAME = re.compile(r"([0-9a-f]+)-(\d+)x(\d+)-(\d+)\.bmp")


class MipmapFiles:
    """The files in a folder, which take at most `limit` bytes. version: of the levels
    (mipmaps.VERSION).
    """

    def __init__(self, folder: Path, version: int, limit: int = MAX_BYTES) -> None:
        self.folder = folder
        self.limit = limit
        self._made_by = f"{version} {compat.version_line()}"

    def key(self, image: Image, extension: str) -> str:
        """A key of a picture's levels; "" if it has no file, or was changed in memory."""
        content = _content(image)
        if content is None:
            return ""
        space = image.colorspace_settings.name
        text = f"{self._made_by} {extension} {space} {image.alpha_mode} "
        return hashlib.sha256(text.encode() + hashlib.sha256(content).digest()).hexdigest()[:32]

    def size(self, key: str) -> tuple[int, int] | None:
        """Width and height of the picture with levels in the folder; None if there are none."""
        for name in self._names(key):
            return int(name[2]), int(name[3])
        return None

    def load(self, key: str, halvings: int) -> Image | None:
        """The image with the levels; None if there is none."""
        for name in self._names(key):
            width, height, times = map(int, name.groups()[1:])
            path = self.folder / name[0]
            rows, columns = levels_shape(width >> times, height >> times)
            with suppress(OSError, RuntimeError):  # it was removed meanwhile
                if times == halvings and path.stat().st_size == _START + 3 * rows * columns:
                    os.utime(path)
                    return bpy.data.images.load(str(path), check_existing=False)
        return None

    def store(self, key: str, size: tuple[int, int], halvings: int, levels: np.ndarray) -> bool:
        """Keep levels (rows, columns, 3) uint8, row 0 at the bottom. Returns False where there is
        no space for them, or the cache cannot be written.
        """
        name = f"{key}-{size[0]}x{size[1]}-{halvings}.bmp"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if not self._make_space(levels.size):
                return False
            atomic_write(self.folder / name, lambda temporary: write_bmp(temporary, levels))
        except (IclnuimError, OSError):
            return False
        return True

    def _names(self, key: str) -> Iterator[re.Match[str]]:
        for path in self.folder.glob(f"{key}-*.bmp") if key else ():
            if name := _NAME.fullmatch(path.name):
                yield name

    def _make_space(self, needed: int) -> bool:
        """Remove the files that were not used for the longest time. Returns whether there is space
        for a file of this size.
        """
        files = [(path.stat(), path) for path in self.folder.iterdir()]
        there = sorted((stat.st_mtime, stat.st_size, path) for stat, path in files)
        total = needed + sum(size for _, size, _ in there)
        for used, size, path in there:
            if total <= self.limit or used > time.time() - _IN_USE_S:
                break
            path.unlink(missing_ok=True)
            total -= size
        return total <= self.limit


def write_bmp(path: Path, pixels: np.ndarray) -> None:
    """Write (rows, columns, 3) uint8 RGB, row 0 at the bottom, as BMP of 24 bits. The number of
    columns is a multiple of 4.
    """
    rows, columns = pixels.shape[:2]
    head = struct.pack("<2sIHHI", b"BM", _START + pixels.size, 0, 0, _START)
    head += struct.pack("<IiiHHIIiiII", 40, columns, rows, 1, 24, 0, pixels.size, 2835, 2835, 0, 0)
    with open(path, "wb") as file:
        file.write(head)
        file.write(pixels[..., ::-1].tobytes())


def _content(image: Image) -> bytes | None:
    if image.source != "FILE" or image.is_dirty:
        return None
    if image.packed_file is not None:
        return image.packed_file.data
    file = Path(bpy.path.abspath(image.filepath, library=image.library))
    return file.read_bytes() if image.filepath and file.is_file() else None
