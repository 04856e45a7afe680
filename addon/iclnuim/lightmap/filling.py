"""Light carried into texels that have none of their own: hidden ones, and the gutters between charts."""

from __future__ import annotations

import numpy as np

_NEIGHBOURS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0)]


def shifted(image: np.ndarray, dy: int, dx: int, outside: float | int) -> np.ndarray:
    """result[y, x] = image[y + dy, x + dx], or `outside` beyond the border."""
    result = np.full_like(image, outside)
    h, w = image.shape[:2]
    ys, xs = slice(max(0, -dy), min(h, h - dy)), slice(max(0, -dx), min(w, w - dx))
    yt, xt = slice(max(0, dy), min(h, h + dy)), slice(max(0, dx), min(w, w + dx))
    result[ys, xs] = image[yt, xt]
    return result


def beside_known(known: np.ndarray, chart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flat places of unknown texels inside charts that have a known one of their chart beside them, and of the nearest such."""
    place = np.arange(known.size).reshape(known.shape)
    nearest = np.full(known.shape, -1)
    for dy, dx in sorted(_NEIGHBOURS, key=lambda step: abs(step[0]) + abs(step[1])):
        usable = ~known & (nearest < 0) & shifted(known, dy, dx, False) & (shifted(chart, dy, dx, -2) == chart)
        nearest[usable] = place[usable] + dy * known.shape[1] + dx
    rows = np.flatnonzero((nearest >= 0) & (chart >= 0))
    return rows, nearest.ravel()[rows]


def fill(light: np.ndarray, known: np.ndarray, chart: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Unknown texels get the mean of their known neighbours in the same chart, `steps` rings deep.

    light (h, w, 3), known (h, w) bool, chart (h, w) int with -1 outside charts: such texels take light from any chart.
    Returns the new light and what is known then.
    """
    light, known = light.copy(), known.copy()
    for _ in range(steps):
        rows = np.nonzero(~known & _beside(known))
        if not len(rows[0]):
            break
        total, count = np.zeros((len(rows[0]), light.shape[2])), np.zeros(len(rows[0]))
        for dy, dx in _NEIGHBOURS:
            y, x = rows[0] + dy, rows[1] + dx
            inside = (y >= 0) & (y < known.shape[0]) & (x >= 0) & (x < known.shape[1])
            y, x = np.where(inside, y, 0), np.where(inside, x, 0)
            usable = inside & known[y, x] & ((chart[rows] < 0) | (chart[y, x] == chart[rows]))
            weight = usable * (1.0 if dy == 0 or dx == 0 else 0.5)
            total += light[y, x] * weight[:, None]
            count += weight
        reached = count > 0
        y, x = rows[0][reached], rows[1][reached]
        light[y, x] = total[reached] / count[reached, None]
        known[y, x] = True
    return light, known


def _beside(known: np.ndarray) -> np.ndarray:
    """Texels with a known one among their eight neighbours, or known themselves."""
    rows = known | shifted(known, 1, 0, False) | shifted(known, -1, 0, False)
    return rows | shifted(rows, 0, 1, False) | shifted(rows, 0, -1, False)
