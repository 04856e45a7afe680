"""The layout of a light map: surfaces are cut into charts, and the charts are packed into one
square map; their texel density, and which sides get texels.

A chart consists of connected faces with similar normals, flattened by parallel projection: lengths
are foreshortened by at most cos(LIMIT), straight lines stay straight, and flat walls are not
distorted. Texel density is found by bisection; charts are placed in rows of decreasing height.
Narrow faces get more texels: bevels, folds and mouldings, where light changes fast.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .surfaces import BACK, FRONT, Sides, Surfaces, Texels, cross, select, texels

#: A face belongs to a chart if its normal is within this angle of the chart's axis.
LIMIT_DEG = 50.0
#: Number of rotations tried for each chart, starting with that of its longest edge, to find a small
#: bounding rectangle.
_ROTATIONS = 12
#: Empty texels between charts; they are filled with their neighbours' light afterwards.
GUTTER = 1
_BISECTIONS = 14
#: A part of a chart that is narrower than a texel is widened towards one texel, by at most this
#: factor.
_MAX_STRETCH = 3.0
#: Limits of a chart's factor on texels per metre because of its visibility, relative to the median.
SPARSEST = 0.3
DENSEST = 1.6
#: Limits of the factor because of its contrast: even light, or light that changes fast.
EVENEST = 0.6
SHARPEST = 3.0


@dataclass(frozen=True, eq=False)
class Charts:
    """chart (F,): number of each face's chart; flat_m (C, 2): flattened corners in metres from (0,
    0); size_m (K, 2) of each chart's rectangle.
    """

    chart: np.ndarray
    flat_m: np.ndarray
    size_m: np.ndarray


def chart(surfaces: Surfaces) -> Charts:
    """Cut the surfaces into charts of faces that are connected by edges and have the same axis;
    charts are numbered by their first face.
    """
    vectors = surfaces.area_vectors()
    axis = _axes(vectors, surfaces.face_object)
    face = surfaces.face_of_corner
    vertex = surfaces.vertex
    low, high = (choose(vertex, vertex[surfaces.following]) for choose in (np.minimum, np.maximum))
    order = np.lexsort((high, low))
    same = (np.diff(low[order]) == 0) & (np.diff(high[order]) == 0)
    a, b = face[order[:-1][same]], face[order[1:][same]]
    alike = axis[a] == axis[b]
    label = components(surfaces.faces, a[alike], b[alike])
    number = np.unique(label, return_inverse=True)[1].reshape(-1)
    return Charts(number, *_flatten(surfaces, number, vectors))


def _axes(vectors: np.ndarray, face_object: np.ndarray) -> np.ndarray:
    """(F,): the number of the axis of each face; different objects have different numbers."""
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
    """Axes (A, 3) so that every face is near one of them.

    Greedy: the next axis is always the direction with the largest remaining area.
    """
    area = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(area, 1e-20)[:, None]
    cells = np.unique(np.round(normals * 6).astype(int), axis=0, return_inverse=True)[1].reshape(-1)
    axes = []
    left = area > 0
    while left.any():
        heavy = np.bincount(cells[left], area[left]).argmax()
        axis = vectors[left & (cells == heavy)].sum(0)
        axis /= np.linalg.norm(axis)
        axes.append(axis)
        left &= normals @ axis < np.cos(np.radians(LIMIT_DEG))
        left &= cells != heavy
    return np.array(axes or [[0.0, 0.0, 1.0]])


def components(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(count,): the lowest member of each element's connected component, where a[i] and b[i] are
    connected.
    """
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


def _flatten(
    surfaces: Surfaces, number: np.ndarray, vectors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Project each chart along its mean normal, and rotate it so that its bounding rectangle is
    small; the first rotation aligns it with its longest projected edge.
    """
    count = int(number.max(initial=-1)) + 1
    axis = np.stack([np.bincount(number, vectors[:, k], count) for k in range(3)], -1)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0, axis / np.maximum(length, 1e-20), [0.0, 0.0, 1.0])
    of_corner = number[surfaces.face_of_corner]
    p = surfaces.corners_m
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


def _smallest_rectangle(
    base: np.ndarray, of_corner: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(of_corner, kind="stable")
    starts = np.searchsorted(of_corner[order], np.arange(count))
    best = np.full(count, np.inf)
    flat = np.zeros_like(base)
    size = np.zeros((count, 2))
    for step in range(_ROTATIONS):
        c = np.cos(np.pi / 2 * step / _ROTATIONS)
        s = np.sin(np.pi / 2 * step / _ROTATIONS)
        rotated = base @ np.array([[c, -s], [s, c]])
        low = np.minimum.reduceat(rotated[order], starts)
        extent = np.maximum.reduceat(rotated[order], starts) - low
        area = (extent[:, 0] + 1e-3) * (extent[:, 1] + 1e-3)
        better = area < best * 0.98
        best[better] = area[better]
        size[better] = extent[better]
        flat = np.where(better[of_corner, None], rotated - low[of_corner], flat)
    return flat, size


def pack(
    surfaces: Surfaces, charts: Charts, size: int, weight: np.ndarray
) -> tuple[np.ndarray, float]:
    """Pack the charts into a map of size x size texels at the highest density at which all fit;
    `weight` (K,) is a factor for each chart.

    Returns corners (C, 2), with the centre of texel i at i + 0.5, and texels per metre. A chart's
    rectangle extends from its first texel's centre to its last texel's centre. Raises InputError if
    even the smallest charts, 2 x 2 texels each, do not fit.
    """
    ruler = Ruler(charts, of_corner := charts.chart[surfaces.face_of_corner])
    plain = np.zeros(len(weight), bool)
    while True:
        low = 0.0
        high = 2.0 * size / np.sqrt(max(float((charts.size_m.prod(1) * weight**2).sum()), 1e-12))
        best = None
        for _ in range(_BISECTIONS):
            density = (low + high) / 2
            placed = _place(ruler.measure(density * weight, plain)[1], size)
            if placed is None:
                high = density
            else:
                low = density
                best = placed
        best = best or _place(np.zeros_like(charts.size_m), size)
        if best is None:
            expected = f"a light map large enough for {len(weight)} charts"
            raise InputError(expected, found=f"{size} texels", hint="a larger map size")
        coordinates, extent = ruler.measure(low * weight, plain)
        broken = folded(surfaces, charts, coordinates) & ~plain
        if not broken.any():
            break
        plain |= broken
    origin, rotated = best
    step = np.where(extent > 1e-9, (_texels(extent) - 1) / np.maximum(extent, 1e-9), 0.0)
    placed = coordinates * step[of_corner]
    return np.where(rotated[of_corner, None], placed[:, ::-1], placed) + origin[
        of_corner
    ] + 0.5, low


def _texels(extent: np.ndarray) -> np.ndarray:
    """Columns and rows (K, 2): at least two, so that interpolation has texels on both sides."""
    return np.maximum(np.ceil(extent - 1e-6).astype(int), 1) + 1


def _place(extent: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Place charts in rows of decreasing height, with their longer side horizontal. Returns their
    origins and whether they were rotated by 90 degrees; None if they do not fit.
    """
    cells = _texels(extent) + GUTTER
    rotated = cells[:, 1] > cells[:, 0]
    cells = np.where(rotated[:, None], cells[:, ::-1], cells)
    if len(cells) and (cells[:, 0].max() > size or cells.prod(1).sum() > size * size):
        return None
    origin = np.zeros_like(cells)
    x = y = row = 0
    for k in np.lexsort((-cells[:, 0], -cells[:, 1])):
        w, h = cells[k]
        if x + w > size:
            x = 0
            y = y + row
            row = 0
        if y + h > size:
            return None
        origin[k] = (x, y)
        x = x + w
        row = max(row, h)
    return origin, rotated


class Ruler:
    """Computes the sizes of charts at any density.

    Along each axis of a chart, the corners' coordinates divide it into intervals.
    """

    def __init__(self, charts: Charts, chart_of_corner: np.ndarray) -> None:
        self.chart_of_corner = chart_of_corner
        self.count = len(charts.size_m)
        self.orders = [np.lexsort((charts.flat_m[:, axis], chart_of_corner)) for axis in (0, 1)]
        self.first = np.searchsorted(chart_of_corner[self.orders[0]], np.arange(self.count))
        self.sorted_chart = chart_of_corner[self.orders[0]]
        self.gaps = []
        for axis, order in enumerate(self.orders):
            gaps = np.diff(charts.flat_m[order, axis], prepend=0.0)
            gaps[self.first] = 0.0
            self.gaps.append(gaps)

    def measure(self, density: np.ndarray, plain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(C, 2) coordinates in texels from each chart's first texel, and (K, 2) extents; density
        (K,) in texels per metre.

        Narrow intervals of charts that are `plain` (K,) are not widened.
        """
        coordinates = np.zeros((len(self.chart_of_corner), 2))
        extent = np.zeros((self.count, 2))
        factor = np.where(plain, 1.0, _MAX_STRETCH)[self.sorted_chart]
        for axis, (order, gaps) in enumerate(zip(self.orders, self.gaps, strict=True)):
            width = gaps * density[self.sorted_chart]
            width = np.maximum(width, np.minimum(1.0, factor * width))
            along = np.cumsum(width)
            along -= along[self.first][self.sorted_chart]
            coordinates[order, axis] = along
            extent[:, axis] = np.maximum.reduceat(along, self.first)
        return coordinates, extent


def folded(surfaces: Surfaces, charts: Charts, coordinates: np.ndarray) -> np.ndarray:
    """(K,) whether widening has flipped a triangle of the chart."""
    areas = []
    for flat in (charts.flat_m, coordinates):
        a, b, c = (flat[surfaces.triangles[:, k]] for k in range(3))
        areas.append(cross(b - a, c - a))
    flipped = areas[0] * areas[1] < 0
    result = np.zeros(len(charts.size_m), bool)
    result[charts.chart[surfaces.triangle_face[flipped]]] = True
    return result


@dataclass(frozen=True, eq=False)
class Layout:
    """The charts of the sides of `surfaces` that have texels, packed into a square map. corners
    (C', 2) of the sides, in texels; density in texels per metre.
    """

    surfaces: Surfaces
    sides: Sides
    charts: Charts
    corners: np.ndarray
    density: float
    texels: Texels

    @property
    def face_of_texel(self) -> np.ndarray:
        """(N,) number of the face of each texel."""
        return self.sides.face[self.sides.surfaces.triangle_face[self.texels.triangle]]

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points in metres and (N, 3) unit normals, one per texel."""
        return self.texels.points(self.sides.surfaces)

    def uv(self) -> tuple[np.ndarray, np.ndarray]:
        """For the corners (C,) of all surfaces: (2, C, 2) position in the map, 0..1, of front and
        back; (2, C) whether the side has texels.
        """
        count = len(self.surfaces.corners_m)
        uv = np.zeros((2, count, 2))
        has = np.zeros((2, count), bool)
        side = self.sides.side[self.sides.surfaces.face_of_corner]
        for which in (FRONT, BACK):
            corner = self.sides.corner[side == which]
            uv[which, corner] = self.corners[side == which] / self.texels.size
            has[which, corner] = True
        return uv, has

    def per_side(self, values: np.ndarray) -> np.ndarray:
        """(F, 2): mean of the texel values (N,) over the chart of each side; 0 for sides without
        texels.
        """
        chart = self.texels.chart
        count = len(self.charts.size_m)
        texels = np.maximum(np.bincount(chart, minlength=count), 1)
        mean = np.bincount(chart, values, count) / texels
        result = np.zeros((self.surfaces.faces, 2))
        result[self.sides.face, self.sides.side] = mean[self.charts.chart]
        return result


def lay_out(
    surfaces: Surfaces,
    wanted: np.ndarray,
    size: int,
    exposure: np.ndarray | None = None,
    contrast: np.ndarray | None = None,
) -> Layout:
    """The layout of a map of size x size texels for the sides `wanted` (F, 2).

    `exposure` (F, 2): how much of a camera's image a square metre of each side may fill; the number
    of texels is proportional to it. `contrast` (F, 2): squared change of light between neighbouring
    texels; edges of shadows get more texels.
    """
    sides = select(surfaces, wanted)
    charts = chart(sides.surfaces)
    area = np.linalg.norm(sides.surfaces.area_vectors(), axis=1) + 1e-12
    total = np.bincount(charts.chart, area, len(charts.size_m))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(charts.chart, area * values[sides.face, sides.side], len(total)) / total

    weight = np.ones(len(total))
    if exposure is not None:
        # the square root of a chart's mean exposure, relative to the median by area
        seen = mean(exposure)
        order = np.argsort(seen)
        place = np.searchsorted(np.cumsum(total[order]), total.sum() / 2)
        usual = max(float(seen[order[min(place, len(order) - 1)]]), 1e-12)
        weight *= np.clip(np.sqrt(seen / usual), SPARSEST, DENSEST)
    if contrast is not None:
        # an edge's error grows with texel size: the cube root minimises the sum of errors
        changes = mean(contrast)
        usual = max(float(np.average(changes, weights=total)), 1e-12)
        weight *= np.clip(np.cbrt(np.maximum(changes, 0) / usual), EVENEST, SHARPEST)
    corners, density = pack(sides.surfaces, charts, size, weight)
    found = texels(sides.surfaces, charts.chart, corners, size)
    return Layout(surfaces, sides, charts, corners, density, found)
