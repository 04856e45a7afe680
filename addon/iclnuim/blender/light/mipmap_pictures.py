"""The pictures of a scene that get mipmaps: their sizes, decoded only if nothing is known of them,
and the images with their levels, from files or in memory.
"""

from pathlib import Path

import numpy as np
from bpy.types import Image

from .mipmap_files import MipmapFiles
from .mipmap_images import in_memory, levels_of
from .mipmap_memory import BYTE, FLOAT

#: Pictures beyond these bytes do not stay decoded until their levels are made.
_MAX_DECODED = 1_000_000_000


class Pictures:
    """Pictures, each with the way in which it ends at its borders (REPEAT or EXTEND).

    files: those that images made here are read from.
    """

    def __init__(self, stored: MipmapFiles) -> None:
        self.files: list[Path] = []
        self._stored = stored
        self._keys: dict[tuple[Image, str], str] = {}
        self._sizes: dict[tuple[Image, str], tuple[int, int]] = {}
        self._texel: dict[tuple[Image, str], int] = {}
        self._decoded = 0

    def size(self, image: Image, extension: str) -> tuple[int, int]:
        """Width and height; (0, 0) if it cannot be filtered."""
        own = (image, extension)
        if own not in self._sizes:
            self._keys[own] = self._stored.key(image, extension)
            known = self._stored.size(self._keys[own])
            self._texel[own] = BYTE
            if known is None:
                known = decoded_size(image)
                self._texel[own] = FLOAT if image.is_float else BYTE
                self._decoded += image.size[0] * image.size[1] * 4
                if self._decoded > _MAX_DECODED:
                    _free(image)
            self._sizes[own] = known
        return self._sizes[own]

    def of(self, image: Image, extension: str) -> tuple[int, int, int]:
        """Width, height, and bytes of a texel of its levels."""
        width, height = self.size(image, extension)
        return width, height, self._texel[image, extension]

    def with_levels(self, image: Image, extension: str, halvings: int) -> Image:
        """The image with the levels of the picture, which is halved this often."""
        key = self._keys[image, extension]
        if made := self._read(image, key, halvings):
            return made
        levels = levels_of(image, extension, halvings)
        is_stored = False
        if key and not image.is_float:
            texels = (levels[..., :3] * 255 + 0.5).astype(np.uint8)
            is_stored = self._stored.store(key, self.size(image, extension), halvings, texels)
        made = self._read(image, key, halvings) if is_stored else None
        made = made or in_memory(image, levels)
        _free(image)
        return made

    def _read(self, image: Image, key: str, halvings: int) -> Image | None:
        made = self._stored.load(key, halvings)
        if made is None:
            return None
        self.files.append(Path(made.filepath))
        made.name = f"{image.name} mipmaps"
        made.colorspace_settings.name = image.colorspace_settings.name
        return made


def decoded_size(image: Image) -> tuple[int, int]:
    """Width and height of an image; (0, 0) without colours."""
    width, height = image.size
    return (width, height) if image.channels == 4 else (0, 0)


def _free(image: Image) -> None:
    """Free the pixels of an image that can be read from its file again."""
    if not image.is_dirty:
        image.buffers_free()
