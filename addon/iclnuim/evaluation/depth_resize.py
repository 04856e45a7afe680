"""Predicted depth of another size than the true depth, resampled to the true size."""

import numpy as np

from ..errors import InputError

RESIZES = {
    "none": "refused",
    "nearest": "nearest pixel",
    "bilinear": "between the four nearest pixels, the nearest one where one of them is missing",
}
#: Networks round the sides of their input to multiples of a patch of at most 16 pixels; this is the
#: largest difference that rounding to the nearest multiple makes.
_MAX_ROUNDING_PX = 8


def resized(values: np.ndarray, shape: tuple[int, ...], how: str) -> np.ndarray:
    """Values (h, w), NaN, infinite or 0 = missing, at the pixel centres of an image of `shape` that
    shows the same.

    Raises InputError for `how` = none, and for another aspect ratio: an image with a border or a
    crop shows something else.
    """
    if how == "none":
        expected = f"a prediction of {shape[1]} x {shape[0]}, as the true image"
        found = f"{values.shape[1]} x {values.shape[0]}"
        raise InputError(expected, found=found, hint="{resize} nearest or bilinear")
    nearest = values[nearest_pixels(values.shape, shape)]
    if how == "nearest":
        return nearest
    rows, columns = (_places(a, b) for a, b in zip(values.shape, shape, strict=True))
    values = np.where(np.isfinite(values) & (values != 0), values, np.nan)
    between = _between(_between(values, rows, 0), columns, 1)
    return np.where(np.isnan(between), nearest, between)


def nearest_pixels(size: tuple[int, ...], shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows (h, 1) and columns (1, w) of the pixels of an image of `size` that are nearest to those of
    one of `shape` (h, w), which shows the same.

    Raises InputError for another aspect ratio.
    """
    height, width = size
    if abs(height - width * shape[0] / shape[1]) > _MAX_ROUNDING_PX:
        expected = f"a prediction with the aspect ratio of the true image, {shape[1]} x {shape[0]}"
        raise InputError(expected, found=f"{width} x {height}", hint="removing its border")
    rows, columns = (_places(a, b) for a, b in zip(size, shape, strict=True))
    rows = np.floor(rows + 0.5).astype(int).clip(0, height - 1)
    columns = np.floor(columns + 0.5).astype(int).clip(0, width - 1)
    return rows[:, None], columns[None]


def _places(count: int, wanted: int) -> np.ndarray:
    """The pixel centres of a side of `wanted` pixels, in those of one of `count` pixels."""
    return (np.arange(wanted) + 0.5) * count / wanted - 0.5


def _between(values: np.ndarray, places: np.ndarray, axis: int) -> np.ndarray:
    """Values at places between the pixels along an axis; beyond the outer pixels' centres, theirs."""
    count = values.shape[axis]
    places = places.clip(0, count - 1)
    low = np.minimum(places.astype(int), max(count - 2, 0))
    share = np.expand_dims(places - low, 1 - axis)
    first = values.take(low, axis)
    second = values.take(np.minimum(low + 1, count - 1), axis)
    # where the share is 0 or 1, a missing neighbour does not matter
    mixed = (1 - share) * first + share * second
    return np.where(share == 0, first, np.where(share == 1, second, mixed))
