"""Images that hold a texture and smaller versions of it side by side (levels of mipmaps).

From right to left, levels 0, 1, ..., each with margins. Level k is smaller by s = 2^-k, and begins
at s times the width of level 0, so a position in it is s p in units of the image's width, if p is
the position in level 0. No position is outside, so the image is not repeated: that would take
Cycles a division for every coordinate.
"""

import math
from collections.abc import Callable

import bpy
import numpy as np
from bpy.types import Image

from ...sensor.transfer import light_from_srgb, srgb_from_light

#: Levels of a texture, including itself; the coarsest is smaller by 2^(LEVELS - 1) = 32: texels of
#: 0.5 mm are then as wide as a pixel at the far end of a room, 8 m away.
LEVELS = 6
#: Width of a cell with one value of the noise, in texels of level 0: two to four pixels where level
#: 3 is read. If a pixel holds more than one cell, each frame sees another one of them, and texture
#: cannot be tracked (frames 560 to 1059 of noisy office kt3, ORB-SLAM3: 66 mm with 8, 14 with 32).
_CELL = 32
#: Rows of a level that are computed at once, so that they stay in the processor's cache.
_BAND = 16
#: Light of all 8-bit sRGB values, and sRGB values of 16-bit light.
_LINEAR = light_from_srgb(np.linspace(0, 1, 256)).astype(np.float32)
_SRGB = srgb_from_light(np.linspace(0, 1, 65536)).astype(np.float32)


def margins(size: int) -> tuple[int, int]:
    """Texels of the repeated texture before and after a side, so that every level has whole texels
    and at least one texel of margin.
    """
    unit = 2 ** (LEVELS - 1)
    return unit, unit + -size % unit


def levels_shape(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of the image with all levels of a picture."""
    return height + sum(margins(height)), 2 * (width + sum(margins(width)))


def levels_of(image: Image, extension: str, halvings: int = 0) -> np.ndarray:
    """(rows, columns, 4) float32, row 0 at the bottom: all levels of `image` side by side. Levels
    are averages of light, not of encoded values.

    extension: REPEAT or EXTEND, which determines the margins. halvings: how often the picture is
    halved before, whose sides are multiples of 2^halvings.
    """
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    picture = pixels.reshape(height, width, 4)
    is_encoded = not image.is_float and image.colorspace_settings.name == "sRGB"
    if halvings:
        picture = _smaller(picture, halvings, is_encoded)
    height, width = picture.shape[:2]
    rows, columns = levels_shape(width, height)
    atlas = np.zeros((rows, columns, 4), np.float32)
    level = atlas[:, columns // 2 :]
    _fill(level, picture, extension)
    level[..., 3] = 1.0
    light = level[..., :3]
    for k in range(1, LEVELS):
        light = halved(light, _light if is_encoded and k == 1 else np.asarray)
        rows, columns = light.shape[:2]
        part = atlas[:rows, columns : 2 * columns]
        part[..., :3] = _encoded(light) if is_encoded else light
        part[..., 3] = 1.0
    return atlas


def in_memory(image: Image, levels: np.ndarray) -> Image:
    """An image in memory that holds the levels of `image`."""
    name = f"{image.name} mipmaps"
    made = bpy.data.images.new(name, *levels.shape[1::-1], float_buffer=image.is_float)
    made.colorspace_settings.name = image.colorspace_settings.name
    made.pixels.foreach_set(levels.ravel())
    made.update()
    return made


def noise_cells(rows: int, columns: int) -> Image:
    """An image whose alpha is noise between 0 and 1 in cells, for an image with levels of this
    size.
    """
    made = bpy.data.images.new("footprint noise", columns // _CELL, rows // _CELL, alpha=True)
    made.colorspace_settings.name = "Non-Color"
    made.alpha_mode = "CHANNEL_PACKED"
    pixels = np.ones((math.prod(made.size), 4), np.float32)
    pixels[:, 3] = np.random.default_rng(0).random(len(pixels))
    made.pixels.foreach_set(pixels.ravel())
    made.update()
    return made


def _fill(target: np.ndarray, texture: np.ndarray, extension: str) -> None:
    """Fill the target with the texture, and its margins with the texture repeated, or with its
    borders.
    """
    height, width = texture.shape[:2]
    top, _ = margins(height)
    left, _ = margins(width)
    target[top : top + height, left : left + width] = texture
    for rows, size in ((target, height), (target.swapaxes(0, 1), width)):
        before, after = margins(size)
        outside = np.r_[-before:0, size : size + after]
        inside = outside % size if extension == "REPEAT" else outside.clip(0, size - 1)
        rows[outside + before] = rows[inside + before]


def _smaller(picture: np.ndarray, halvings: int, is_encoded: bool) -> np.ndarray:
    """(h, w, 4) -> (h / 2^halvings, w / 2^halvings, 4), whose alpha is 1."""
    light = _light(picture[..., :3]) if is_encoded else picture[..., :3]
    for _ in range(halvings):
        light = halved(light)
    found = np.ones((*light.shape[:2], 4), np.float32)
    found[..., :3] = _encoded(light) if is_encoded else light
    return found


def _encoded(light: np.ndarray) -> np.ndarray:
    return _SRGB[(light * 65535 + 0.5).astype(np.uint16)]


def _light(encoded: np.ndarray) -> np.ndarray:
    return _LINEAR[(encoded * 255 + 0.5).astype(np.uint8)]


def halved(level: np.ndarray, light: Callable[[np.ndarray], np.ndarray] = np.asarray) -> np.ndarray:
    """light(level), (2 n, 2 m, 3) -> (n, m, 3), filtered by the binomial (1, 3, 3, 1) / 8: then all
    levels have a filter of the same width.
    """
    rows = level.shape[0] // 2
    columns = level.shape[1] // 2
    half = np.empty((rows, columns, 3), np.float32)
    for top in range(0, rows, _BAND):
        bottom = min(top + _BAND, rows)
        band = light(level[np.arange(2 * top - 1, 2 * bottom + 1).clip(0, len(level) - 1)])
        band = (band[:-3:2] + 3 * (band[1:-2:2] + band[2:-1:2]) + band[3::2]) / 8
        band = np.concatenate([band[:, :1], band, band[:, -1:]], axis=1)
        inner = band[:, 1:-2:2] + band[:, 2:-1:2]
        half[top:bottom] = (band[:, :-3:2] + 3 * inner + band[:, 3::2]) / 8
    return half
