"""The surfaces of a scene as arrays in world coordinates, and the surface point of each texel of a
light map.

A texel whose centre is inside a chart has the point at its centre. A texel outside, which
interpolation reaches, has the nearest point on the chart's boundary.
"""

from dataclasses import dataclass

import numpy as np

FRONT = 0
BACK = 1
#: Points on a boundary are moved inwards by this share of a texel, so that they are not inside an
#: adjacent surface.
_INWARDS = 0.1
_PAIRS_AT_ONCE = 4_000_000


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Polygons of all objects. The corners of a face are consecutive, counter-clockwise seen from
    the front.

    corners_m (C, 3) and normals (C, 3), the unit shading normals, in the world; vertex (C,): equal
    for corners of one object at the same position; face_start (F+1,): the corners of face f are
    face_start[f]:face_start[f+1]; triangles (T, 3) corner indices and triangle_face (T,);
    face_object (F,).
    """

    corners_m: np.ndarray
    normals: np.ndarray
    vertex: np.ndarray
    face_start: np.ndarray
    triangles: np.ndarray
    triangle_face: np.ndarray
    face_object: np.ndarray

    @property
    def faces(self) -> int:
        return len(self.face_start) - 1

    @property
    def face_of_corner(self) -> np.ndarray:
        """(C,): the face of each corner."""
        return np.repeat(np.arange(self.faces), np.diff(self.face_start))

    @property
    def following(self) -> np.ndarray:
        """(C,): the next corner of the same face."""
        following = np.arange(len(self.corners_m)) + 1
        following[self.face_start[1:] - 1] = self.face_start[:-1]
        return following

    def area_vectors(self) -> np.ndarray:
        """(F, 3): the geometric normal of each face times its area in square metres."""
        a, b, c = (self.corners_m[self.triangles[:, k]] for k in range(3))
        vectors = np.cross(b - a, c - a) / 2
        return np.stack(
            [np.bincount(self.triangle_face, vectors[:, k], self.faces) for k in range(3)], -1
        )


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of faces that get texels, as separate surfaces: the back of a face has flipped normals
    and the same corners.

    face (S,) and side (S,): face and side that each was made from; corner (C',): original index of
    each corner of `surfaces`.
    """

    surfaces: Surfaces
    face: np.ndarray
    side: np.ndarray
    corner: np.ndarray


def join(parts: list[Surfaces]) -> Surfaces:
    """Join the surfaces of several objects; objects are numbered in the order of the list."""
    corners = np.cumsum([0] + [len(p.corners_m) for p in parts])
    faces = np.cumsum([0] + [p.faces for p in parts])
    vertices = np.cumsum([0] + [int(p.vertex.max(initial=-1)) + 1 for p in parts])
    return Surfaces(
        corners_m=np.concatenate([p.corners_m for p in parts]),
        normals=np.concatenate([p.normals for p in parts]),
        vertex=np.concatenate([p.vertex + v for p, v in zip(parts, vertices, strict=False)]),
        face_start=np.concatenate(
            [p.face_start[:-1] + c for p, c in zip(parts, corners, strict=False)] + [corners[-1:]]
        ),
        triangles=np.concatenate([p.triangles + c for p, c in zip(parts, corners, strict=False)]),
        triangle_face=np.concatenate(
            [p.triangle_face + f for p, f in zip(parts, faces, strict=False)]
        ),
        face_object=np.repeat(np.arange(len(parts)), [p.faces for p in parts]),
    )


def select(surfaces: Surfaces, wanted: np.ndarray) -> Sides:
    """The sides `wanted` (F, 2), fronts first.

    Corners of a side keep the order they have on the face; triangles of backs are reversed.
    """
    sides = [np.flatnonzero(wanted[:, side]) for side in (FRONT, BACK)]
    face = np.concatenate(sides)
    side = np.repeat([FRONT, BACK], [len(s) for s in sides])
    count = np.diff(surfaces.face_start)[face]
    start = np.concatenate([[0], np.cumsum(count)])
    within_face = np.arange(start[-1]) - np.repeat(start[:-1], count)
    corner = within_face + np.repeat(surfaces.face_start[face], count)
    at_back = np.repeat(side, count) == BACK
    place = np.full((surfaces.faces, 2), -1)
    place[face, side] = np.arange(len(face))
    triangles = []
    owners = []
    for which in (FRONT, BACK):
        owner = place[surfaces.triangle_face, which]
        kept = owner >= 0
        owner = owner[owner >= 0]
        face_start = surfaces.face_start[surfaces.triangle_face[kept], None]
        moved = surfaces.triangles[kept] - face_start + start[owner, None]
        if which == BACK:
            moved = moved[:, ::-1]
        triangles.append(moved)
        owners.append(owner)
    after_fronts = int(surfaces.vertex.max(initial=0)) + 1
    chosen = Surfaces(
        corners_m=surfaces.corners_m[corner],
        normals=surfaces.normals[corner] * np.where(at_back, -1.0, 1.0)[:, None],
        vertex=surfaces.vertex[corner] + np.where(at_back, after_fronts, 0),
        face_start=start,
        triangles=np.concatenate(triangles),
        triangle_face=np.concatenate(owners),
        face_object=surfaces.face_object[face],
    )
    return Sides(chosen, face, side, corner)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product (...,) of vectors (..., 2) in the plane: twice the signed area of their
    triangle.
    """
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@dataclass(frozen=True, eq=False)
class Texels:
    """index (N,) = row * size + column, increasing; triangle (N,) and barycentric weights (N, 3) of
    each texel's surface point; chart (N,).
    """

    size: int
    index: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray
    chart: np.ndarray

    def points(self, surfaces: Surfaces) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points in metres and (N, 3) unit shading normals."""
        corners = surfaces.triangles[self.triangle]
        points = np.einsum("nk,nkj->nj", self.weights, surfaces.corners_m[corners])
        normals = np.einsum("nk,nkj->nj", self.weights, surfaces.normals[corners])
        return points, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

    def image(self, values: np.ndarray, empty: float = 0.0) -> np.ndarray:
        """An image (size, size, ...) of values (N, ...) of the texels."""
        image = np.full((self.size * self.size, *values.shape[1:]), empty, values.dtype)
        image[self.index] = values
        return image.reshape(self.size, self.size, *values.shape[1:])


def texels(surfaces: Surfaces, chart: np.ndarray, corners_map: np.ndarray, size: int) -> Texels:
    """All texels that are used by interpolation between texel centres. chart (F,), corners_map (C,
    2) in texels.
    """
    triangles = corners_map[surfaces.triangles] - 0.5
    rim = _rims(surfaces, chart)
    low = np.clip(np.floor(triangles.min(1)).astype(int), 0, size - 1)
    high = np.clip(np.floor(triangles.max(1)).astype(int) + 1, 0, size - 1)
    counts = (high - low + 1).prod(1)
    group = np.cumsum(counts) // _PAIRS_AT_ONCE  # batches limit the memory
    batches = np.split(np.arange(len(counts)), np.flatnonzero(np.diff(group)) + 1)
    found = [_nearest(triangles, rows, low, high, size) for rows in batches]
    index, triangle, weights, distance = (np.concatenate([f[k] for f in found]) for k in range(4))
    order = np.lexsort((distance, index))
    first = order[np.flatnonzero(np.diff(index[order], prepend=-1))]
    index = index[first]
    triangle = triangle[first]
    weights = weights[first]
    weights = _inwards(weights, triangles[triangle], rim[triangle])
    return Texels(size, index, triangle, weights, chart[surfaces.triangle_face[triangle]])


def _rims(surfaces: Surfaces, chart: np.ndarray) -> np.ndarray:
    """(T, 3) bool: whether the edge opposite a corner of a triangle is a boundary of its chart."""
    vertex = surfaces.vertex[surfaces.triangles]
    ends = np.stack([np.roll(vertex, -1, 1), np.roll(vertex, -2, 1)], -1)
    ends.sort(-1)
    owner = np.repeat(chart[surfaces.triangle_face], 3)
    keys = np.concatenate([owner[:, None], ends.reshape(-1, 2)], 1)
    _, place, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    return (count[place.reshape(-1)] == 1).reshape(-1, 3)


def _nearest(
    triangles: np.ndarray, rows: np.ndarray, low: np.ndarray, high: np.ndarray, size: int
) -> tuple:
    """For every triangle of `rows` and every texel near it: texel, triangle, weights of the nearest
    point, and distance in texels.
    """
    span = high[rows] - low[rows] + 1
    counts = span.prod(1)
    triangle = np.repeat(rows, counts)
    k = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    width = np.repeat(span[:, 0], counts)
    column = low[triangle, 0] + k % width
    row = low[triangle, 1] + k // width
    corners = triangles[triangle]
    texel = np.stack([column, row], -1).astype(float)
    weights = _inside(corners, texel)
    outside = np.flatnonzero((weights < 0).any(1))
    weights[outside] = _on_rim(corners[outside], texel[outside])
    offset = np.zeros_like(texel)
    offset[outside] = np.einsum("nk,nkj->nj", weights[outside], corners[outside]) - texel[outside]
    near = np.abs(offset).max(1) < 1.0
    return row[near] * size + column[near], triangle[near], weights[near], np.hypot(*offset[near].T)


def _inside(corners: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Barycentric weights (n, 3) of points p (n, 2) in triangles (n, 3, 2).

    Outside, one is below 0; for a degenerate triangle, all are.
    """
    a = corners[:, 0] - p
    b = corners[:, 1] - p
    c = corners[:, 2] - p
    parts = np.stack([cross(b, c), cross(c, a), cross(a, b)], -1)
    area = parts.sum(1, keepdims=True)
    flat = np.abs(area) < 1e-12
    return np.where(flat, -1.0, parts / np.where(flat, 1.0, area))


def _on_rim(corners: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Barycentric weights (n, 3) of the point on the triangle's edges nearest to p (n, 2)."""
    best = np.zeros((len(p), 3))
    least = np.full(len(p), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start = corners[:, i]
        edge = corners[:, j] - corners[:, i]
        t = np.clip(((p - start) * edge).sum(1) / np.maximum((edge**2).sum(1), 1e-12), 0, 1)
        distance = ((start + t[:, None] * edge - p) ** 2).sum(1)
        rows = distance < least
        best[rows] = 0.0
        best[rows, i] = 1 - t[rows]
        best[rows, j] = t[rows]
        least[rows] = distance[rows]
    return best


def _inwards(weights: np.ndarray, corners: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Weights (n, 3) of points closer than _INWARDS to a boundary edge are changed: the points are
    moved perpendicular to it, to that distance.

    In a narrow triangle a point may cross another, inner edge; the neighbouring triangle continues
    there in nearly the same plane.
    """
    edge = np.roll(corners, -2, 1) - np.roll(corners, -1, 1)  # edge k is opposite corner k
    squared = np.maximum((edge**2).sum(2), 1e-12)
    area = np.abs(cross(edge[:, 0], edge[:, 1]))
    height = area[:, None] / np.sqrt(squared)
    for k in range(3):
        wanted = np.minimum(_INWARDS, height[:, k] / 3)
        lacking = np.maximum(wanted - weights[:, k] * height[:, k], 0)
        shift = np.where(rim[:, k] & (height[:, k] > 1e-6), lacking, 0)
        gain = shift / np.maximum(height[:, k], 1e-6)
        step = np.zeros_like(weights)
        # weights change in proportion to the edges' projections on edge k
        for j in ((k + 1) % 3, (k + 2) % 3):
            step[:, j] = (edge[:, j] * edge[:, k]).sum(1) / squared[:, k] * gain
        step[:, k] = gain
        weights = weights + step
    return weights
