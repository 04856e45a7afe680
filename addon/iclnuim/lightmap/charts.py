"""Surfaces cut into charts: connected faces that look roughly one way, laid flat by parallel projection.

The projection stretches nothing by more than 1 / cos(LIMIT), keeps straight what is straight, and shows flat walls undistorted.
"""

from dataclasses import dataclass

import numpy as np

from .surfaces import Surfaces

#: A face joins a chart when its normal is within this angle of the chart's axis.
LIMIT_DEG = 50.0
#: Turns tried for each chart, besides that of its longest edge, to find a small rectangle around it.
_TURNS = 12


@dataclass(frozen=True, eq=False)
class Charts:
    """chart (F,) of each face, flat_m (C, 2) corners laid flat in metres from (0, 0), size_m (K, 2) of each chart's rectangle."""

    chart: np.ndarray
    flat_m: np.ndarray
    size_m: np.ndarray


def chart(surfaces: Surfaces) -> Charts:
    """Cut and flatten; charts are numbered in the order of their first face."""
    vectors = surfaces.area_vectors()
    label = _connected(surfaces, _axes(vectors, surfaces.face_object))
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


def _connected(surfaces: Surfaces, axis_of_face: np.ndarray) -> np.ndarray:
    """(F,): the lowest face number among those that hang together over edges and look along the same axis."""
    face, vertex = surfaces.face_of_corner, surfaces.vertex
    low, high = (choose(vertex, vertex[surfaces.following]) for choose in (np.minimum, np.maximum))
    order = np.lexsort((high, low))
    same = (np.diff(low[order]) == 0) & (np.diff(high[order]) == 0)
    a, b = face[order[:-1][same]], face[order[1:][same]]
    alike = axis_of_face[a] == axis_of_face[b]
    return components(surfaces.faces, a[alike], b[alike])


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
    """Project each chart along its mean normal, turned so that its rectangle is small."""
    count = int(number.max(initial=-1)) + 1
    axis = np.stack([np.bincount(number, vectors[:, k], count) for k in range(3)], -1)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(length > 0, axis / np.maximum(length, 1e-20), [0.0, 0.0, 1.0])
    of_corner = number[surfaces.face_of_corner]
    along = _longest_edges(surfaces, of_corner, axis)
    across = np.cross(axis, along)
    p = surfaces.corners_m
    base = np.stack([(p * along[of_corner]).sum(1), (p * across[of_corner]).sum(1)], -1)
    return _smallest_rectangle(base, of_corner, count)


def _longest_edges(surfaces: Surfaces, of_corner: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(K, 3) unit directions: each chart's longest edge as the projection shows it."""
    edges = surfaces.corners_m[surfaces.following] - surfaces.corners_m
    edges -= (edges * axis[of_corner]).sum(1, keepdims=True) * axis[of_corner]
    length = np.linalg.norm(edges, axis=1)
    order = np.lexsort((-length, of_corner))
    first = order[np.flatnonzero(np.diff(of_corner[order], prepend=-1))]
    any_across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    along = np.where(length[first, None] > 1e-9, edges[first], any_across)
    return along / np.linalg.norm(along, axis=1, keepdims=True)


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
