"""Arrays of vertices and triangles."""

import numpy as np

from ..errors import InputError


def check_mesh(vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raises InputError unless vertices are (n, 3), triangles (m, 3) of integers, and all indices
    are those of a vertex.
    """
    if (
        vertices.ndim != 2
        or vertices.shape[1] != 3
        or triangles.ndim != 2
        or triangles.shape[1] != 3
    ):
        raise InputError(
            "vertices (n, 3) and triangles (m, 3)", found=f"{vertices.shape} and {triangles.shape}"
        )
    if triangles.dtype.kind not in "iu":
        raise InputError("triangles as integers", found=triangles.dtype)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        found = f"{triangles.min()} to {triangles.max()}"
        raise InputError(f"indices of the {len(vertices)} vertices in triangles", found=found)


def fans(corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The triangles (m, 3) int64 of polygons, each as a fan from its first corner: the corners of
    all polygons one after the other, and the number of corners of each (n,). Polygons of fewer than
    three corners have none.
    """
    if (counts == 3).all():
        return corners.reshape(-1, 3).astype(np.int64)
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    second = first + step + 1
    return np.stack([corners[first], corners[second], corners[second + 1]], -1).astype(np.int64)


def strips(corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The triangles (m, 3) int64 of triangle strips, given as in `fans`. Every second triangle is
    turned around, -1 begins a new strip, and triangles of an edge or a point are left out.
    """
    ends = np.cumsum(counts)
    place = np.arange(len(corners))
    begins = np.zeros(len(corners), np.int64)
    starts = (ends - counts)[counts > 0]
    begins[starts] = starts
    restarts = np.flatnonzero(corners == -1)
    begins[restarts] = restarts
    after = restarts[restarts + 1 < len(corners)] + 1
    begins[after] = after
    step = place - np.maximum.accumulate(begins)
    third = place[step >= 2]
    triangles = np.stack([corners[third - 2], corners[third - 1], corners[third]], -1)
    odd = step[third] % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)].astype(np.int64)
