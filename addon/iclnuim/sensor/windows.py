"""Sums, maxima and correlated noise over square windows of an image, in a time that hardly depends
on the window's size.
"""

import numpy as np

from .noise_model import gaussian


def correlated(rng: np.random.Generator, shape: tuple[int, ...], side_px: float) -> np.ndarray:
    """(h, w) float32 samples of N(0, 1): the mean of independent samples over a window of side
    `side_px` (rounded, at least 1), scaled to variance 1. The correlation of two pixels is the
    share of their windows that overlaps.
    """
    side = max(1, round(side_px))
    height, width = shape
    independent = gaussian(rng, (height + side - 1, width + side - 1))
    rows = _running_sum(independent, side)
    return _running_sum(rows.T, side).T / np.float32(side)


def _running_sum(image: np.ndarray, side: int) -> np.ndarray:
    """Sums over `side` neighbouring rows: (h + side - 1, w) -> (h, w)."""
    if side == 1:
        return image
    total = np.cumsum(image, axis=0, dtype=np.float64)
    sums = total[side - 1 :].copy()
    sums[1:] -= total[:-side]
    return sums.astype(np.float32)


def largest(image: np.ndarray, reach_px: int) -> np.ndarray:
    """The largest value (h, w) within `reach_px` rows and columns; outside counts as nothing."""
    return _largest_of_rows(_largest_of_rows(image, reach_px).T, reach_px).T


def _largest_of_rows(image: np.ndarray, reach: int) -> np.ndarray:
    result = image.copy()
    for step in range(1, min(reach, len(image) - 1) + 1):
        np.maximum(result[step:], image[:-step], out=result[step:])
        np.maximum(result[:-step], image[step:], out=result[:-step])
    return result
