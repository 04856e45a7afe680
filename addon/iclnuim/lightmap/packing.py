"""Charts placed in one square map: texel density by bisection, rows of falling height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .charts import Charts

#: Empty texels between charts; filled with their neighbours' light afterwards.
GUTTER = 1


@dataclass(frozen=True, eq=False)
class Packing:
    """Where charts lie in a map of size x size texels.

    texels (K, 2): columns and rows of each chart, its rectangle reaching from the first texel's centre to the last one's;
    origin (K, 2): its first texel; turned (K,): whether its two axes are swapped; density: texels per metre.
    """

    size: int
    texels: np.ndarray
    origin: np.ndarray
    turned: np.ndarray
    density: float


def pack(charts: Charts, size: int, weight: np.ndarray | None = None) -> Packing:
    """The highest texel density at which all charts fit; `weight` (K,) multiplies it chart by chart.

    Raises InputError where even the smallest charts (2 x 2 texels) do not fit.
    """
    weight = np.ones(len(charts.size_m)) if weight is None else weight
    low, high, best = 0.0, 2.0 * size / np.sqrt(max(float((charts.size_m.prod(1) * weight**2).sum()), 1e-12)), None
    for _ in range(18):
        density = (low + high) / 2
        placed = _place(charts, size, density, weight)
        if placed is None:
            high = density
        else:
            low, best = density, placed
    best = best or _place(charts, size, 0.0, weight)
    if best is None:
        raise InputError(f"a light map that holds {len(charts.size_m)} charts", found=f"{size} texels", hint="a larger map size")
    return best


def _place(charts: Charts, size: int, density: float, weight: np.ndarray) -> Packing | None:
    texels = np.maximum(np.ceil(charts.size_m * (density * weight)[:, None] - 1e-6).astype(int), 1) + 1
    turned = texels[:, 1] > texels[:, 0]
    texels = np.where(turned[:, None], texels[:, ::-1], texels)
    cells = texels + GUTTER
    if len(cells) and (cells[:, 0].max() > size or cells.prod(1).sum() > size * size):
        return None
    origin = np.zeros_like(texels)
    x = y = row = 0
    for k in np.lexsort((-cells[:, 0], -cells[:, 1])):
        w, h = cells[k]
        if x + w > size:
            x, y, row = 0, y + row, 0
        if y + h > size:
            return None
        origin[k], x, row = (x, y), x + w, max(row, h)
    return Packing(size, texels, origin, turned, density)


def map_coordinates(charts: Charts, packing: Packing, chart_of_corner: np.ndarray) -> np.ndarray:
    """(C, 2): where each corner lies in the map, in texels (the centre of texel i is at i + 0.5)."""
    k = chart_of_corner
    flat = np.where(packing.turned[k, None], charts.flat_m[:, ::-1], charts.flat_m)
    size = np.where(packing.turned[:, None], charts.size_m[:, ::-1], charts.size_m)
    step = (packing.texels - 1) / np.maximum(size, 1e-9)
    step = np.where(size > 1e-9, step, 0.0)
    return flat * step[k] + packing.origin[k] + 0.5
