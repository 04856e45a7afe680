"""The layout of a light map: surfaces cut into charts, charts placed in one square map, how densely, and which sides get texels.

A chart is connected faces that look roughly one way, laid flat by parallel projection: it stretches nothing by more than
1 / cos(LIMIT), keeps straight what is straight, and shows flat walls undistorted. Texel density is found by bisection, charts lie in
rows of falling height. They get more texels where faces are narrow: along bevels, folds and mouldings, where light changes fast.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .surfaces import BACK, FRONT, Sides, Surfaces, Texels, cross, select, texels

#: A face joins a chart when its normal is within this angle of the chart's axis.
LIMIT_DEG = 50.0
#: Turns tried for each chart, besides that of its longest edge, to find a small rectangle around it.
_TURNS = 12
#: Empty texels between charts; filled with their neighbours' light afterwards.
GUTTER = 1
_BISECTIONS = 14
#: A stretch of a chart narrower than a texel is widened towards one texel, at most by this factor.
_MAX_STRETCH = 3.0
#: Texels per metre may differ between charts by these factors from the usual.
SPARSEST, DENSEST = 0.3, 1.6
#: And by these where light is even, or changes fast.
EVENEST, SHARPEST = 0.6, 3.0


@dataclass(frozen=True, eq=False)
class Charts:
    """chart (F,) of each face, flat_m (C, 2) corners laid flat in metres from (0, 0), size_m (K, 2) of each chart's rectangle."""

    chart: np.ndarray
    flat_m: np.ndarray
    size_m: np.ndarray


def chart(surfaces: Surfaces) -> Charts:
    """Faces that hang together over edges and look along the same axis, laid flat; numbered in the order of their first face."""
    vectors = surfaces.area_vectors()
    axis, face, vertex = _axes(vectors, surfaces.face_object), surfaces.face_of_corner, surfaces.vertex
    low, high = (choose(vertex, vertex[surfaces.following]) for choose in (np.minimum, np.maximum))
    order = np.lexsort((high, low))
    same = (np.diff(low[order]) == 0) & (np.diff(high[order]) == 0)
    a, b = face[order[:-1][same]], face[order[1:][same]]
    alike = axis[a] == axis[b]
    label = components(surfaces.faces, a[alike], b[alike])
    number = np.unique(label, return_inverse=True)[1].reshape(-1)
    return Charts(number, *_flatten(surfaces, number, vectors))


def _axes(vectors: np.ndarray, face_object: np.ndarray) -> np.ndarray:
    """(F,): which axis of its object each face looks along; numbers differ between objects."""
    label = np.zeros(len(vectors), int)
    order = np.argsort(face_object, kind="stable")
    bounds = np.flatnonzero(np.diff(face_object[order], prepend=-1, append=-1))
    used = 0
    for first, last in zip(bounds[:-1], bounds[1:], strict=True):
        rows = order[first:last]
        axes = _object_axes(vectors[rows])
        label[rows] = used + (vectors[rows] @ axes.T).argmax(1)
        used += len(axes)
    return label


def _object_axes(vectors: np.ndarray) -> np.ndarray:
    """Directions (A, 3) so that every face is near one: always the one that most area looks along is taken next."""
    area = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(area, 1e-20)[:, None]
    cells = np.unique(np.round(normals * 6).astype(int), axis=0, return_inverse=True)[1].reshape(-1)
    axes, left = [], area > 0
    while left.any():
        heavy = np.bincount(cells[left], area[left]).argmax()
        axis = vectors[left & (cells == heavy)].sum(0)
        axis /= np.linalg.norm(axis)
        axes.append(axis)
        left &= normals @ axis < np.cos(np.radians(LIMIT_DEG))
        left &= cells != heavy
    return np.array(axes) if axes else np.array([[0.0, 0.0, 1.0]])


def components(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(count,): the lowest member of each one's component, when a[i] and b[i] hang together."""
    label = np.arange(count)
    while True:
        low = np.minimum(label[a], label[b])
        new = label.copy()
        np.minimum.at(new, label[a], low)
        np.minimum.at(new, label[b], low)
        new = new[new]
        if (new == label).all():
            return label
        label = new


def _flatten(surfaces: Surfaces, number: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project each chart along its mean normal, turned so that its rectangle is small; first along the longest edge in the projection."""
    count = int(number.max(initial=-1)) + 1
    axis = np.stack([np.bincount(number, vectors[:, k], count) for k in range(3)], -1)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0, axis / np.maximum(length, 1e-20), [0.0, 0.0, 1.0])
    of_corner, p = number[surfaces.face_of_corner], surfaces.corners_m
    edges = p[surfaces.following] - p
    edges -= (edges * axis[of_corner]).sum(1, keepdims=True) * axis[of_corner]
    length = np.linalg.norm(edges, axis=1)
    order = np.lexsort((-length, of_corner))
    first = order[np.flatnonzero(np.diff(of_corner[order], prepend=-1))]
    any_across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    along = np.where(length[first, None] > 1e-9, edges[first], any_across)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(axis, along)
    base = np.stack([(p * along[of_corner]).sum(1), (p * across[of_corner]).sum(1)], -1)
    return _smallest_rectangle(base, of_corner, count)


def _smallest_rectangle(base: np.ndarray, of_corner: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(of_corner, kind="stable")
    starts = np.searchsorted(of_corner[order], np.arange(count))
    best = np.full(count, np.inf)
    flat, size = np.zeros_like(base), np.zeros((count, 2))
    for turn in range(_TURNS):
        c, s = np.cos(np.pi / 2 * turn / _TURNS), np.sin(np.pi / 2 * turn / _TURNS)
        turned = base @ np.array([[c, -s], [s, c]])
        low = np.minimum.reduceat(turned[order], starts)
        extent = np.maximum.reduceat(turned[order], starts) - low
        area = (extent[:, 0] + 1e-3) * (extent[:, 1] + 1e-3)
        better = area < best * 0.98
        best[better], size[better] = area[better], extent[better]
        flat = np.where(better[of_corner, None], turned - low[of_corner], flat)
    return flat, size


def pack(surfaces: Surfaces, charts: Charts, size: int, weight: np.ndarray) -> tuple[np.ndarray, float]:
    """Where charts lie in a map of size x size texels at the highest density at which all fit; `weight` (K,) multiplies it chart by chart.

    Returns corners (C, 2), the centre of texel i at i + 0.5, and texels per metre. A chart's rectangle reaches from its first texel's
    centre to its last one's. Raises InputError where even the smallest charts, 2 x 2 texels each, do not fit.
    """
    ruler = Ruler(charts, of_corner := charts.chart[surfaces.face_of_corner])
    plain = np.zeros(len(weight), bool)
    while True:
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
        coordinates, extent = ruler.measure(low * weight, plain)
        broken = folded(surfaces, charts, coordinates) & ~plain
        if not broken.any():
            break
        plain |= broken
    origin, turned = best
    step = np.where(extent > 1e-9, (_texels(extent) - 1) / np.maximum(extent, 1e-9), 0.0)
    placed = coordinates * step[of_corner]
    return np.where(turned[of_corner, None], placed[:, ::-1], placed) + origin[of_corner] + 0.5, low


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


@dataclass(frozen=True, eq=False)
class Layout:
    """Charts of the sides of `surfaces` that have texels, packed into a square map; corners (C', 2) of the sides in texels; texels per metre."""

    surfaces: Surfaces
    sides: Sides
    charts: Charts
    corners: np.ndarray
    density: float
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
            uv[which, corner] = self.corners[side == which] / self.texels.size
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
        count, size = len(self.texels.index), self.texels.size
        return f"{len(self.charts.size_m)} charts, {count} texels ({count / size**2:.0%} of {size} x {size}), {1000 / self.density:.1f} mm"


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
    if exposure is not None:  # the root of a chart's mean exposure, against the usual: the median by area
        seen = mean(exposure)
        order = np.argsort(seen)
        place = np.searchsorted(np.cumsum(total[order]), total.sum() / 2)
        usual = max(float(seen[order[min(place, len(order) - 1)]]), 1e-12)
        weight *= np.clip(np.sqrt(seen / usual), SPARSEST, DENSEST)
    if contrast is not None:  # an edge's error grows with texel size: the cube root makes the sum of errors least
        changes = mean(contrast)
        usual = max(float(np.average(changes, weights=total)), 1e-12)
        weight *= np.clip(np.cbrt(np.maximum(changes, 0) / usual), EVENEST, SHARPEST)
    corners, density = pack(sides.surfaces, charts, size, weight)
    return Layout(surfaces, sides, charts, corners, density, texels(sides.surfaces, charts.chart, corners, size))
