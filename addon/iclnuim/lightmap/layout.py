"""The layout of a light map: which sides of faces get texels, how densely, and where."""

from dataclasses import dataclass

import numpy as np

from .charts import Charts, chart
from .packing import Packing, pack
from .surfaces import BACK, FRONT, Sides, Surfaces, select
from .texels import Texels, texels

#: Texels per metre may differ between charts by these factors from the usual.
SPARSEST, DENSEST = 0.3, 1.6
#: And by these where light is even, or changes fast.
EVENEST, SHARPEST = 0.6, 3.0


@dataclass(frozen=True, eq=False)
class Layout:
    """Charts of the sides of `surfaces` that have texels, packed into a square map."""

    surfaces: Surfaces
    sides: Sides
    charts: Charts
    packing: Packing
    texels: Texels

    @property
    def face_of_texel(self) -> np.ndarray:
        """(N,)."""
        return self.sides.face[self.sides.surfaces.triangle_face[self.texels.triangle]]

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points in metres and (N, 3) unit normals, one a texel."""
        return self.texels.points(self.sides.surfaces)

    def uv(self) -> tuple[np.ndarray, np.ndarray]:
        """For the corners (C,) of all surfaces: (2, C, 2) place in the map, 0..1, of front and back; (2, C) whether there is one."""
        count = len(self.surfaces.corners_m)
        uv, has = np.zeros((2, count, 2)), np.zeros((2, count), bool)
        side = self.sides.side[self.sides.surfaces.face_of_corner]
        for which in (FRONT, BACK):
            corner = self.sides.corner[side == which]
            uv[which, corner] = self.packing.corners[side == which] / self.packing.size
            has[which, corner] = True
        return uv, has

    def per_side(self, values: np.ndarray) -> np.ndarray:
        """(F, 2): the mean of texel values (N,) over the chart of each side; 0 for sides without texels."""
        chart, count = self.texels.chart, len(self.charts.size_m)
        mean = np.bincount(chart, values, count) / np.maximum(np.bincount(chart, minlength=count), 1)
        result = np.zeros((self.surfaces.faces, 2))
        result[self.sides.face, self.sides.side] = mean[self.charts.chart]
        return result

    def summary(self) -> str:
        """One line for people."""
        count, size = len(self.texels.index), self.packing.size
        return f"{len(self.charts.size_m)} charts, {count} texels ({count / size**2:.0%} of {size} x {size}), {1000 / self.packing.density:.1f} mm"


def lay_out(
    surfaces: Surfaces,
    wanted: np.ndarray,
    size: int,
    exposure: np.ndarray | None = None,
    contrast: np.ndarray | None = None,
) -> Layout:
    """A map of size x size texels for the sides `wanted` (F, 2).

    `exposure` (F, 2) says how much of a camera's image a square metre of each side may fill; texels are laid in proportion.
    `contrast` (F, 2) says how much light changes there from place to place, squared: shadows' edges get more texels.
    """
    sides = select(surfaces, wanted)
    charts = chart(sides.surfaces)
    area = np.linalg.norm(sides.surfaces.area_vectors(), axis=1) + 1e-12
    total = np.bincount(charts.chart, area, len(charts.size_m))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(charts.chart, area * values[sides.face, sides.side], len(total)) / total

    weight = np.ones(len(total))
    if exposure is not None:
        weight *= _by_exposure(mean(exposure), total)
    if contrast is not None:
        weight *= _by_contrast(mean(contrast), total)
    packing = pack(sides.surfaces, charts, size, weight)
    return Layout(surfaces, sides, charts, packing, texels(sides.surfaces, charts.chart, packing.corners, size))


def _by_exposure(mean: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(K,) relative density: the root of a chart's mean exposure, against the usual: the median by area."""
    order = np.argsort(mean)
    place = np.searchsorted(np.cumsum(area[order]), area.sum() / 2)
    usual = max(float(mean[order[min(place, len(order) - 1)]]), 1e-12)
    return np.clip(np.sqrt(mean / usual), SPARSEST, DENSEST)


def _by_contrast(mean: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(K,) relative density. The error at an edge is in proportion to texel size, so the cube root makes the sum of errors least."""
    usual = max(float(np.average(mean, weights=area)), 1e-12)
    return np.clip(np.cbrt(np.maximum(mean, 0) / usual), EVENEST, SHARPEST)
