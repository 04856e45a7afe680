"""Periodic noise and weaving patterns for textures, as numpy arrays in 0..1 or of unit spread.

Every pattern tiles.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike


def cloud(
    rng: np.random.Generator,
    shape: tuple[int, int],
    slope: float = 1.5,
    low: float = 1.0,
    high: float = 1e9,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> np.ndarray:
    """Fractal noise (rows, columns), mean 0, spread 1: amplitude ~ f^-slope between low and high
    periods a tile.
    """
    gain = _gain(shape, slope, low, high, stretch)
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * gain, s=shape)
    return (noise - noise.mean()) / max(noise.std(), 1e-12)


@functools.lru_cache(maxsize=4)
def _gain(
    shape: tuple[int, int], slope: float, low: float, high: float, stretch: tuple[float, float]
) -> np.ndarray:
    """The amplitude of each frequency of `cloud`; cached, because boards and threads use the same
    ones.
    """
    fy = np.fft.fftfreq(shape[0], 1 / shape[0])[:, None] * stretch[0]
    fx = np.fft.rfftfreq(shape[1], 1 / shape[1])[None, :] * stretch[1]
    f = np.hypot(fy, fx)
    return np.where((f >= low) & (f <= high), np.maximum(f, 1e-9) ** -slope, 0.0)


def smoothstep(edge0: float, edge1: float, x: np.ndarray) -> np.ndarray:
    t = np.clip((x - edge0) / (edge1 - edge0), 0, 1)
    return t * t * (3 - 2 * t)


def blend(a: ArrayLike, b: ArrayLike, t: np.ndarray) -> np.ndarray:
    """Colours a, b (3,) or (h,w,3) mixed by t (h,w)."""
    return np.asarray(a, float) * (1 - t[..., None]) + np.asarray(b, float) * t[..., None]


def weave(rng: np.random.Generator, size: int, threads: int, irregular: float = 0.15) -> np.ndarray:
    """Plain weave seen from above (size,size) in 0..1: dark gaps between threads, threads bright
    along their crowns.
    """
    y, x = np.mgrid[0:size, 0:size] / size * threads
    x = x + irregular * 1.2 * cloud(rng, (size, size), 1.2, 1, threads)
    y = y + irregular * 1.2 * cloud(rng, (size, size), 1.2, 1, threads)
    warp_up = (np.floor(x) + np.floor(y)) % 2 == 0
    across_warp = np.sin(np.pi * (x % 1))
    along_warp = np.sin(np.pi * (y % 1))
    crown = np.where(
        warp_up, across_warp * (0.55 + 0.45 * along_warp), along_warp * (0.55 + 0.45 * across_warp)
    )
    thread_tone = 1 + irregular * cloud(rng, (size, size), 0.6, 2, threads)
    return np.clip(crown**0.7 * thread_tone, 0, 1.2)


def grain(rng: np.random.Generator, shape: tuple[int, int], rings: float = 9.0) -> np.ndarray:
    """Wood grain along the rows' direction (columns run along the board), in 0..1: 1 is the dark
    late wood.
    """
    wander = cloud(rng, shape, 1.8, 1, 24, (1.0, 5.0))
    figure = cloud(rng, shape, 1.5, 1, 6, (1.0, 6.0))
    rows = np.arange(shape[0])[:, None] / shape[0]
    ring = 0.5 + 0.5 * np.sin(2 * np.pi * (np.round(rings) * rows + 0.35 * wander + 1.1 * figure))
    pores = cloud(rng, shape, 0.3, 8, 1e9, (1.0, 18.0))
    return np.clip(0.62 * ring**2.2 + 0.13 * pores + 0.12 * wander + 0.15, 0, 1)


def to_bytes(rgb: np.ndarray) -> np.ndarray:
    """sRGB colours in 0..1 to bytes."""
    return np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


def enlarged(coarse: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Repeat the cells of a coarse pattern up to `shape`."""
    rows = np.arange(shape[0]) * coarse.shape[0] // shape[0]
    cols = np.arange(shape[1]) * coarse.shape[1] // shape[1]
    return coarse[rows][:, cols]
