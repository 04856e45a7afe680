"""Removes the smallest features of meshes: chamfers become edges, thin bars lose their rounding.

Numpy only; metres.
"""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, _compact, _drop_repeated_corners, cross

#: At half the detail, features up to this size go; at a quarter three times it; at full detail
#: none.
FEATURE_M = 0.004
#: Corners whose surfaces turn away from each other more than this cosine says are the two sides of
#: something thin, and stay apart.
_SAME_SIDE = -0.2
#: Groups whose normals' mean is shorter than this go round a wire or a pin, which would be lost; at
#: a box's corner it is 0.58.
_RING = 0.4
#: Added to every limit of length: many lengths are equal by design, and rounding must not decide
#: which of them is below it.
_TIE_M = 3.3e-7
#: Share of a cluster's faces' weight that draws its corner to the cluster's middle, where the faces
#: leave it open.
_HOLD = 1e-3


def feature_m(detail: float) -> float:
    """The size in metres of the features that are removed at this level of detail; 0 at full detail
    and above.
    """
    return max(0.0, FEATURE_M * (1 / detail - 1))


def coarser(mesh: Mesh, within_m: float) -> Mesh:
    """Like `_merged`, the smallest features first: otherwise they would connect larger ones."""
    for halvings in (3, 2, 1, 0):
        mesh = _merged(mesh, within_m / 2**halvings)
    return mesh


def _merged(mesh: Mesh, within_m: float) -> Mesh:
    """`mesh` with vertices merged that are connected by edges and within `within_m` of each other;
    the new vertex is where the planes of the remaining faces meet.

    So a chamfered box becomes its bounding box, not a smaller box. Round shapes stay round: a group
    around a wire, or wider than twice `within_m`, is not merged, and neither are the two sides of a
    sheet.
    """
    group = _groups(mesh, within_m)
    if within_m <= 0 or len(np.unique(group)) == len(mesh.verts):
        return mesh
    faces, uv, kept = _drop_repeated_corners(
        np.where(mesh.faces < 0, -1, group[mesh.faces]), mesh.uv
    )
    if not len(kept):
        return mesh
    verts = _placed(mesh, group, kept, within_m)
    return _compact(Mesh(verts, faces, uv, mesh.material[kept]))


def _groups(mesh: Mesh, within_m: float) -> np.ndarray:
    """(N,) the lowest index of the vertices that each vertex is merged with."""
    a, b = _edges(mesh.faces)
    normal = _vertex_normals(mesh)
    near = np.linalg.norm(mesh.verts[a] - mesh.verts[b], axis=1) <= within_m + _TIE_M
    near &= np.einsum("ij,ij->i", normal[a], normal[b]) > _SAME_SIDE
    group = _components(len(mesh.verts), a[near], b[near])
    low, high = np.full_like(mesh.verts, np.inf), np.full_like(mesh.verts, -np.inf)
    np.minimum.at(low, group, mesh.verts)
    np.maximum.at(high, group, mesh.verts)
    members = np.bincount(group, minlength=len(group))
    mean = np.stack([np.bincount(group, normal[:, k], len(group)) for k in range(3)], 1)
    whole = np.linalg.norm(mean, axis=1) < _RING * members
    wide = np.linalg.norm(high - low, axis=1) > 2 * within_m + _TIE_M
    return np.where((wide | whole)[group], np.arange(len(group)), group)


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends (E,), (E,) of all edges, each edge once."""
    after = np.roll(faces, -1, axis=1)
    is_tri = faces[:, 3] < 0
    after[is_tri, 2] = faces[is_tri, 0]
    pairs = np.sort(np.stack([faces, after], -1)[faces >= 0], axis=1)
    low, high = np.divmod(np.unique(pairs[:, 0] * (faces.max() + 1) + pairs[:, 1]), faces.max() + 1)
    return low, high


def _components(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(count,) the lowest index that each vertex is connected to."""
    group = np.arange(count)
    while True:
        least = np.minimum(group[a], group[b])
        new = group.copy()
        np.minimum.at(new, a, least)
        np.minimum.at(new, b, least)
        new = new[new]
        if np.array_equal(new, group):
            return group
        group = new


def _area_normals(mesh: Mesh) -> np.ndarray:
    """(F, 3) face normals whose length is the area of the face."""
    a, b, c = (mesh.verts[mesh.faces[:, k]] for k in range(3))
    d = mesh.verts[np.where(mesh.faces[:, 3] < 0, mesh.faces[:, 0], mesh.faces[:, 3])]
    return cross(c - a, d - b) / 2


def _vertex_normals(mesh: Mesh) -> np.ndarray:
    """(N, 3) unit vertex normals, weighted by area."""
    total = np.zeros_like(mesh.verts)
    area = _area_normals(mesh)
    for k in range(4):
        there = mesh.faces[:, k] >= 0
        np.add.at(total, mesh.faces[there, k], area[there])
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)


def _placed(mesh: Mesh, group: np.ndarray, kept: np.ndarray, within_m: float) -> np.ndarray:
    """(N, 3): the position of each group's vertex, nearest to the planes of the remaining faces,
    weighted by area (quadric error).

    Garland and Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997, section
    4.
    """
    count = len(mesh.verts)
    members = np.bincount(group, minlength=count)
    total = np.stack([np.bincount(group, mesh.verts[:, k], count) for k in range(3)], 1)
    middle = total / np.maximum(members, 1)[:, None]
    area = _area_normals(mesh)[kept]
    size = np.linalg.norm(area, axis=1)
    normal = area / np.maximum(size, 1e-30)[:, None]
    A = np.zeros((count, 3, 3))
    b = np.zeros((count, 3))
    weight = np.zeros(count)
    for k in range(4):
        there = mesh.faces[kept, k] >= 0
        corner = mesh.faces[kept[there], k]
        own = group[corner]
        n = normal[there]
        w = size[there]
        ahead = np.einsum("ij,ij->i", n, mesh.verts[corner] - middle[own])
        np.add.at(A, own, w[:, None, None] * n[:, :, None] * n[:, None, :])
        np.add.at(b, own, (w * ahead)[:, None] * n)
        np.add.at(weight, own, w)
    A += (_HOLD * weight + 1e-12)[:, None, None] * np.eye(3)
    step = np.linalg.solve(A, b[..., None])[..., 0]
    far = np.linalg.norm(step, axis=1) > 2 * within_m
    moved = middle + np.where(far[:, None], 0.0, step)
    return np.where((members > 1)[:, None], moved, mesh.verts)
