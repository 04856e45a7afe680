"""Charts placed in one square map: texel density by bisection, rows of falling height.

Charts get more texels where faces are narrow: along bevels, folds and mouldings, where light changes fast.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .charts import Charts
from .surfaces import Surfaces, cross

#: Empty texels between charts; filled with their neighbours' light afterwards.
GUTTER = 1
_BISECTIONS = 14
#: A stretch of a chart narrower than a texel is widened towards one texel, at most by this factor.
_MAX_STRETCH = 3.0


@dataclass(frozen=True, eq=False)
class Packing:
    """Where charts lie in a map of size x size texels: corners (C, 2), the centre of texel i at i + 0.5; density: texels per metre."""

    size: int
    corners: np.ndarray
    density: float


def pack(surfaces: Surfaces, charts: Charts, size: int, weight: np.ndarray) -> Packing:
    """The highest texel density at which all charts fit; `weight` (K,) multiplies it chart by chart.

    A chart's rectangle reaches from its first texel's centre to its last one's. Raises InputError where even the smallest charts,
    2 x 2 texels each, do not fit.
    """
    ruler = Ruler(charts, charts.chart[surfaces.face_of_corner])
    plain = np.zeros(len(weight), bool)
    while True:
        density, origin, turned = _densest(ruler, size, weight, plain, charts)
        coordinates, extent = ruler.measure(density * weight, plain)
        broken = folded(surfaces, charts, coordinates) & ~plain
        if not broken.any():
            return Packing(size, _corners(ruler.chart_of_corner, coordinates, extent, origin, turned), density)
        plain |= broken


def _densest(
    ruler: "Ruler", size: int, weight: np.ndarray, plain: np.ndarray, charts: Charts
) -> tuple[float, np.ndarray, np.ndarray]:
    """Density, first texel (K, 2) and whether its axes are swapped (K,) for each chart."""
    low, high, best = 0.0, 2.0 * size / np.sqrt(max(float((charts.size_m.prod(1) * weight**2).sum()), 1e-12)), None
    for _ in range(_BISECTIONS):
        density = (low + high) / 2
        placed = _place(ruler.measure(density * weight, plain)[1], size)
        if placed is None:
            high = density
        else:
            low, best = density, placed
    best = best or _place(np.zeros_like(charts.size_m), size)
    if best is None:
        expected = f"a light map that holds {len(weight)} charts"
        raise InputError(expected, found=f"{size} texels", hint="a larger map size")
    return low, *best


def _texels(extent: np.ndarray) -> np.ndarray:
    """Columns and rows (K, 2): at least two, so that interpolation has something on both sides."""
    return np.maximum(np.ceil(extent - 1e-6).astype(int), 1) + 1


def _place(extent: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Charts in rows of falling height, lying on their longer side; None where they do not fit."""
    cells = _texels(extent) + GUTTER
    turned = cells[:, 1] > cells[:, 0]
    cells = np.where(turned[:, None], cells[:, ::-1], cells)
    if len(cells) and (cells[:, 0].max() > size or cells.prod(1).sum() > size * size):
        return None
    origin = np.zeros_like(cells)
    x = y = row = 0
    for k in np.lexsort((-cells[:, 0], -cells[:, 1])):
        w, h = cells[k]
        if x + w > size:
            x, y, row = 0, y + row, 0
        if y + h > size:
            return None
        origin[k], x, row = (x, y), x + w, max(row, h)
    return origin, turned


def _corners(
    of_corner: np.ndarray, coordinates: np.ndarray, extent: np.ndarray, origin: np.ndarray, turned: np.ndarray
) -> np.ndarray:
    """(C, 2) in the map."""
    step = np.where(extent > 1e-9, (_texels(extent) - 1) / np.maximum(extent, 1e-9), 0.0)
    placed = coordinates * step[of_corner]
    return np.where(turned[of_corner, None], placed[:, ::-1], placed) + origin[of_corner] + 0.5


class Ruler:
    """Widths of charts at any density. Along each axis of a chart, the corners' coordinates cut it into intervals."""

    def __init__(self, charts: Charts, chart_of_corner: np.ndarray) -> None:
        self.chart_of_corner, self.count = chart_of_corner, len(charts.size_m)
        self.orders = [np.lexsort((charts.flat_m[:, axis], chart_of_corner)) for axis in (0, 1)]
        self.first = np.searchsorted(chart_of_corner[self.orders[0]], np.arange(self.count))
        self.sorted_chart = chart_of_corner[self.orders[0]]
        self.gaps = [np.diff(charts.flat_m[order, axis], prepend=0.0) for axis, order in enumerate(self.orders)]
        for gaps in self.gaps:
            gaps[self.first] = 0.0

    def measure(self, density: np.ndarray, plain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(C, 2) coordinates in texels from each chart's first one, (K, 2) extents; density (K,) texels per metre.

        Charts that are `plain` (K,) keep their proportions.
        """
        coordinates, extent = np.zeros((len(self.chart_of_corner), 2)), np.zeros((self.count, 2))
        most = np.where(plain, 1.0, _MAX_STRETCH)[self.sorted_chart]
        for axis, (order, gaps) in enumerate(zip(self.orders, self.gaps, strict=True)):
            width = gaps * density[self.sorted_chart]
            width = np.maximum(width, np.minimum(1.0, most * width))
            along = np.cumsum(width)
            along -= along[self.first][self.sorted_chart]
            coordinates[order, axis] = along
            extent[:, axis] = np.maximum.reduceat(along, self.first)
        return coordinates, extent


def folded(surfaces: Surfaces, charts: Charts, coordinates: np.ndarray) -> np.ndarray:
    """(K,) charts in which stretching has turned a triangle over."""
    areas = []
    for flat in (charts.flat_m, coordinates):
        a, b, c = (flat[surfaces.triangles[:, k]] for k in range(3))
        areas.append(cross(b - a, c - a))
    turned = areas[0] * areas[1] < 0
    result = np.zeros(len(charts.size_m), bool)
    result[charts.chart[surfaces.triangle_face[turned]]] = True
    return result
