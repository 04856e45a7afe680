"""Surfaces to lay a map over: a bent strip, a bevelled box, loose triangles."""

import numpy as np
import pytest
from iclnuim.lightmap.surfaces import Surfaces, join


def polygons(corners_m, faces) -> Surfaces:
    """Surfaces of one object from (V, 3) vertices and faces (tuples), flat-shaded, fans of
    triangles.
    """
    corners_m = np.asarray(corners_m, float)
    vertex = np.concatenate([np.asarray(f) for f in faces])
    start = np.cumsum([0] + [len(f) for f in faces])
    triangles = [
        (s, s + k, s + k + 1)
        for s, f in zip(start, faces, strict=False)
        for k in range(1, len(f) - 1)
    ]
    owners = [i for i, f in enumerate(faces) for _ in range(len(f) - 2)]
    triangles, owners = np.array(triangles), np.array(owners)
    points = corners_m[vertex]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.zeros((len(faces), 3))
    np.add.at(normal, owners, np.cross(b - a, c - a))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Surfaces(
        points,
        np.repeat(normal, np.diff(start), 0),
        vertex,
        start,
        triangles,
        owners,
        np.zeros(len(faces), int),
    )


def box(size=(1.0, 0.7, 0.4), at=(0.0, 0.0, 0.0)) -> Surfaces:
    x, y, z = np.array(size) / 2
    corners = (
        np.array([(sx * x, sy * y, sz * z) for sz in (-1, 1) for sy in (-1, 1) for sx in (-1, 1)])
        + at
    )
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return polygons(corners, faces)


@pytest.fixture
def scene() -> Surfaces:
    """A box, a small box beside it, and a strip of narrow faces bent like a moulding."""
    angle = np.linspace(0, np.pi / 2, 9)
    rim = np.stack([0.02 * np.cos(angle), 0.02 * np.sin(angle)], 1)
    corners = np.concatenate([np.c_[rim[:, 0], np.full(9, y), rim[:, 1]] for y in (0.0, 1.5)]) + (
        2.0,
        0,
        0,
    )
    strip = polygons(corners, [(k, k + 1, k + 10, k + 9) for k in range(8)])
    return join([box(), box((0.1, 0.1, 0.1), (0.9, 0, 0)), strip])
