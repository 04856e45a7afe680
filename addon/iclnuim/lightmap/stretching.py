"""Charts measured in texels, with more of them where faces are narrow: along bevels, folds and mouldings, where light changes fast."""

from __future__ import annotations

import numpy as np

from .charts import Charts
from .surfaces import Surfaces

#: A stretch of a chart narrower than a texel is widened towards one texel, at most by this factor.
MOST = 3.0


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
        most = np.where(plain, 1.0, MOST)[self.sorted_chart]
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
    turned = _doubled_area(charts.flat_m[surfaces.triangles]) * _doubled_area(coordinates[surfaces.triangles]) < 0
    result = np.zeros(len(charts.size_m), bool)
    result[charts.chart[surfaces.triangle_face[turned]]] = True
    return result


def _doubled_area(triangles: np.ndarray) -> np.ndarray:
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
