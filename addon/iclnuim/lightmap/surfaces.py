"""The surfaces of a scene as plain arrays, in world coordinates: what a light map is laid out over."""

from dataclasses import dataclass

import numpy as np

FRONT, BACK = 0, 1


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Polygons of all objects, corners of a face one after another, counter-clockwise seen from the front.

    corners_m (C, 3) and normals (C, 3), the unit shading normals, in the world; vertex (C,): equal where corners of one object
    meet; face_start (F+1,): the corners of face f are face_start[f]:face_start[f+1]; triangles (T, 3) corner indices and
    triangle_face (T,); face_object (F,).
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
        """(C,)."""
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
        return np.stack([np.bincount(self.triangle_face, vectors[:, k], self.faces) for k in range(3)], -1)


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of faces that get texels, as surfaces of their own: the back of a face has flipped normals, the same corners.

    face (S,) and side (S,) say which; corner (C',) leads from the corners of `surfaces` to those they were taken from.
    """

    surfaces: Surfaces
    face: np.ndarray
    side: np.ndarray
    corner: np.ndarray


def join(parts: list[Surfaces]) -> Surfaces:
    """Several objects' surfaces as one; objects are numbered in the order of the list."""
    corners = np.cumsum([0] + [len(p.corners_m) for p in parts])
    faces = np.cumsum([0] + [p.faces for p in parts])
    vertices = np.cumsum([0] + [int(p.vertex.max(initial=-1)) + 1 for p in parts])
    return Surfaces(
        corners_m=np.concatenate([p.corners_m for p in parts]),
        normals=np.concatenate([p.normals for p in parts]),
        vertex=np.concatenate([p.vertex + v for p, v in zip(parts, vertices, strict=False)]),
        face_start=np.concatenate(
            [*(p.face_start[:-1] + c for p, c in zip(parts, corners, strict=False)), corners[-1:]]
        ),
        triangles=np.concatenate([p.triangles + c for p, c in zip(parts, corners, strict=False)]),
        triangle_face=np.concatenate([p.triangle_face + f for p, f in zip(parts, faces, strict=False)]),
        face_object=np.repeat(np.arange(len(parts)), [p.faces for p in parts]),
    )


def select(surfaces: Surfaces, wanted: np.ndarray) -> Sides:
    """The sides (F, 2) asked for, front ones first. Corners of a side keep the order they have on the face."""
    sides = [np.flatnonzero(wanted[:, side]) for side in (FRONT, BACK)]
    face = np.concatenate(sides)
    side = np.repeat([FRONT, BACK], [len(s) for s in sides])
    count = np.diff(surfaces.face_start)[face]
    start = np.concatenate([[0], np.cumsum(count)])
    corner = np.arange(start[-1]) - np.repeat(start[:-1], count) + np.repeat(surfaces.face_start[face], count)
    at_back = np.repeat(side, count) == BACK
    triangles, triangle_face = _selected_triangles(surfaces, face, side, start)
    chosen = Surfaces(
        corners_m=surfaces.corners_m[corner],
        normals=surfaces.normals[corner] * np.where(at_back, -1.0, 1.0)[:, None],
        vertex=surfaces.vertex[corner] + np.where(at_back, int(surfaces.vertex.max(initial=0)) + 1, 0),
        face_start=start,
        triangles=triangles,
        triangle_face=triangle_face,
        face_object=surfaces.face_object[face],
    )
    return Sides(chosen, face, side, corner)


def _selected_triangles(
    surfaces: Surfaces, face: np.ndarray, side: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of the chosen sides; those of backs are turned over."""
    triangles, owners = [], []
    for which in (FRONT, BACK):
        place = np.full(surfaces.faces, -1)
        rows = np.flatnonzero(side == which)
        place[face[rows]] = rows
        kept = place[surfaces.triangle_face] >= 0
        owner = place[surfaces.triangle_face[kept]]
        moved = surfaces.triangles[kept] - surfaces.face_start[surfaces.triangle_face[kept], None] + start[owner, None]
        triangles.append(moved[:, ::-1] if which == BACK else moved)
        owners.append(owner)
    return np.concatenate(triangles), np.concatenate(owners)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...,) of vectors (..., 2) in the plane: twice the area of the triangle between them, with its sign."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
