"""Conversion between scene-linear RGB and 8 bits by the sRGB transfer function (IEC 61966-2-1)."""

import functools

import numpy as np

from ..errors import InputError
from ..geometry.se3 import read_only

#: Pixels' values that are looked up at once.
_PIECE = 1 << 15


def srgb8(light: np.ndarray) -> np.ndarray:
    """Scene-linear light, 1 = white, any shape -> uint8 of the same shape, rounded to the nearest.

    Values are clipped to 0..1; NaN becomes 0. The light is first rounded to half precision (11
    bits, an error of at most 1/20 of an 8-bit step). Then a table of all half-precision numbers
    gives the exact value, without computing a power per pixel.
    """
    with np.errstate(over="ignore"):
        half = np.ascontiguousarray(light, np.float16)
    return _looked_up(_srgb8_of_half(), half.view(np.uint16))


def srgb8_in_place(light: np.ndarray) -> np.ndarray:
    """Like srgb8, for float32 light without NaN, which is overwritten. It uses a table of 65536
    equal steps of light, each at most 1/20 of an 8-bit step, and takes half the time of rounding
    to half precision.
    """
    np.clip(light, 0, 1, out=light)
    light *= np.float32(65535)
    light += np.float32(0.5)
    return _srgb8_of_steps().take(light.astype(np.uint16), mode="clip")


def linear_from_srgb8(image: np.ndarray) -> np.ndarray:
    """uint8, any shape -> float32 scene-linear light of the same shape; srgb8 of it gives exactly
    the same image.
    """
    if image.dtype != np.uint8:
        raise InputError("an 8-bit image", found=image.dtype)
    return _light_of_srgb8().take(image)


def srgb_from_light(light: np.ndarray) -> np.ndarray:
    """The sRGB transfer function, 0..1 -> 0..1, float64."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(
        light <= 0.0031308,
        12.92 * light,
        1.055 * np.power(np.maximum(light, 1e-9), 1 / 2.4) - 0.055,
    )


def light_from_srgb(value: np.ndarray) -> np.ndarray:
    """The inverse of the sRGB transfer function, 0..1 -> 0..1, float64."""
    return np.where(value <= 0.04045, value / 12.92, np.power((value + 0.055) / 1.055, 2.4))


def _looked_up(table: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """The entries of a table for codes of any shape, in pieces whose indices of 8 bytes stay in the
    processor's cache.
    """
    values = np.empty(codes.shape, table.dtype)
    codes = codes.ravel()
    flat = values.ravel()
    for start in range(0, len(codes), _PIECE):
        piece = slice(start, start + _PIECE)
        table.take(codes[piece], mode="clip", out=flat[piece])
    return values


@functools.cache
def _srgb8_of_half() -> np.ndarray:
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float64)
    return _rounded(np.nan_to_num(halves, nan=0.0, posinf=1.0, neginf=0.0))


@functools.cache
def _srgb8_of_steps() -> np.ndarray:
    return _rounded(np.arange(1 << 16) / 65535)


def _rounded(light: np.ndarray) -> np.ndarray:
    return read_only(np.floor(srgb_from_light(light) * 255 + 0.5).astype(np.uint8))


@functools.cache
def _light_of_srgb8() -> np.ndarray:
    return read_only(light_from_srgb(np.arange(256) / 255).astype(np.float32))
