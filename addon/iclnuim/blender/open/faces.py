"""The faces of evaluated objects in the world, in one list: which are equal or in one plane, and
what a ray from them hits.
"""

from collections.abc import Sequence

import numpy as np
from bpy.types import Depsgraph, Object
from mathutils import Vector, geometry

from ..surfaces import array_of

#: Corners closer than this are at the same position: float32 coordinates in a room differ by less
#: where they were meant to be equal, and surfaces meant to be apart by more.
SAME_PLACE_M = 1e-5
#: Rays start at this distance from a face, so that they do not hit the face itself.
OFFSET_M = 10 * SAME_PLACE_M
#: Length of a ray that is not limited: 10 km.
_FAR_M = 1e4
#: Two directions are equal if their cosine is above this: 2.6 degrees, more than what rounded
#: coordinates turn the normal of a face by.
PARALLEL = 0.999
#: Normals whose components are equal when rounded to one part of this many are those of one plane:
#: over a metre, they differ by less than 0.1 mm.
_NORMAL_PARTS = 1e4

#: A hit: position (3,) in metres, unit normal, face.
Hit = tuple[np.ndarray, Vector, int]


class Faces:
    """The faces of the objects `things`, one row each.

    keys (F,): equal for faces with the same corners in any order, 0 for faces without area;
    centres_m (F, 3); normals (F, 3), unit length; area_m2 (F,); owner (F,): index into things;
    plane (F,): equal for faces in the same plane, whichever direction they face; spread_m2 (F,):
    area of all faces of the same owner in the same plane.
    """

    def __init__(self, depsgraph: Depsgraph, things: list[Object]) -> None:
        self.depsgraph = depsgraph
        self.things = things
        columns = zip(*map(_faces_of, things), strict=True)
        self.keys, self.centres_m, self.normals, self.area_m2 = map(np.concatenate, columns)
        counts = [len(thing.data.polygons) for thing in things]
        self.starts = np.cumsum([0, *counts])
        self.owner = np.repeat(np.arange(len(things)), counts)
        self.plane = _numbered(_planes(self.centres_m, self.normals))
        in_plane = _numbered(self.plane * len(things) + self.owner)
        self.spread_m2 = np.bincount(in_plane, self.area_m2)[in_plane]

    def rows_of(self, k: int, rows: np.ndarray) -> np.ndarray:
        """Those of the rows that belong to object k."""
        return rows[(rows >= self.starts[k]) & (rows < self.starts[k + 1])]

    def cast(self, k: int, start_m: np.ndarray, ray_m: np.ndarray) -> Hit | None:
        """The hit of a ray in the world, which ends at start_m + ray_m, with object k. The face is
        a row.
        """
        matrix = self.things[k].matrix_world
        inverse = matrix.inverted_safe()
        step = inverse.to_3x3() @ Vector(ray_m)
        if not step.length:
            return None
        hit, place, normal, face = self.things[k].ray_cast(
            inverse @ Vector(start_m),
            step.normalized(),
            distance=step.length,
            depsgraph=self.depsgraph,
        )
        if not hit:
            return None
        normal_in_world = (inverse.to_3x3().transposed() @ normal).normalized()
        return np.array(matrix @ place), normal_in_world, face + int(self.starts[k])

    def cast_from(self, row: int, k: int, direction: np.ndarray) -> Hit | None:
        """The hit of an unlimited ray from the centre of a face with object k."""
        return self.cast(k, self.centres_m[row] + OFFSET_M * direction, _FAR_M * direction)

    def at(self, row: int, k: int) -> Hit | None:
        """The face of object k at the centre of the face `row`, parallel to it."""
        centre_m = self.centres_m[row]
        normal = self.normals[row]
        hit = self.cast(k, centre_m + OFFSET_M * normal, 2 * OFFSET_M * -normal)
        if hit is None or abs(hit[1].dot(Vector(normal))) <= PARALLEL:
            return None
        return hit if np.linalg.norm(hit[0] - centre_m) <= SAME_PLACE_M else None

    def is_sheet(self, row: int) -> bool:
        """Whether the object of a face is a sheet.

        A box on the floor is not: a ray to one side of its face passes through it.
        """
        outline = self.outline(row)
        ears = geometry.tessellate_polygon([[Vector(corner) for corner in outline]])
        # the centre of an L-shape may be outside it
        place_m = outline[list(ears[0])].mean(0) if ears else self.centres_m[row]
        for direction in (self.normals[row], -self.normals[row]):
            start_m = place_m + OFFSET_M * direction
            if self.cast(self.owner[row], start_m, _FAR_M * direction) is not None:
                return False
        return True

    def smaller(self, a: int, b: int) -> int:
        """Which of two faces in one plane should be in front: the one with less area in it, such as
        a rug on a floor of many tiles.
        """
        area = self.area_m2 if self.owner[a] == self.owner[b] else self.spread_m2
        return int(min(a, b, key=lambda row: (round(float(area[row]), 6), self.area_m2[row], -row)))

    def outline(self, row: int) -> np.ndarray:
        """(n, 3) the corners of a face in metres."""
        thing = self.things[self.owner[row]]
        face = thing.data.polygons[int(row - self.starts[self.owner[row]])]
        return np.array([thing.matrix_world @ thing.data.vertices[k].co for k in face.vertices])


def _numbered(values: np.ndarray) -> np.ndarray:
    """(n,) numbers from 0 on, equal for equal values."""
    return np.unique(values, return_inverse=True)[1].reshape(-1)


def _faces_of(thing: Object) -> Sequence[np.ndarray]:
    """keys, centres_m, normals, area_m2 of an evaluated mesh, see Faces."""
    mesh = thing.data
    if not len(mesh.polygons):
        return np.zeros(0, np.uint64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    matrix = np.array(thing.matrix_world)
    starts = array_of(mesh.polygons, "loop_start", 1, np.int32)
    points = array_of(mesh.vertices, "co", 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    corners = points[array_of(mesh.loops, "vertex_index", 1, np.int32)]
    ends = np.append(starts[1:], len(corners))
    following = np.arange(len(corners)) + 1
    following[ends - 1] = starts
    normals = np.add.reduceat(np.cross(corners, corners[following]), starts) / 2
    if thing.matrix_world.is_negative:
        normals *= -1  # a mirrored object's faces have reversed winding
    area_m2 = np.linalg.norm(normals, axis=1)
    with np.errstate(over="ignore"):
        keys = np.add.reduceat(_hashed(np.round(corners / SAME_PLACE_M)), starts)
    keys = np.where(area_m2 > SAME_PLACE_M**2, keys, np.uint64(0))
    centres_m = np.add.reduceat(corners, starts) / (ends - starts)[:, None]
    return keys, centres_m, normals / np.maximum(area_m2, 1e-30)[:, None], area_m2


def _planes(centres_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(F,) uint64, equal for faces in one plane, whichever direction they face."""
    largest = np.abs(normals).argmax(1)[:, None]
    upward = np.sign(np.take_along_axis(normals, largest, 1)) * normals
    offset_m = (upward * centres_m).sum(1)
    rounded = np.round(upward * _NORMAL_PARTS)
    return _hashed(np.column_stack([rounded, np.round(offset_m / SAME_PLACE_M)]))


def _hashed(numbers: np.ndarray) -> np.ndarray:
    """(n,) uint64 hashes of rows (n, up to 4) of whole numbers: sums of products with odd numbers,
    mixed as in splitmix64.
    """
    factors = np.array(
        [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64
    )
    with np.errstate(over="ignore"):
        whole = numbers.astype(np.int64).astype(np.uint64)
        mixed = (whole * factors[: numbers.shape[1]]).sum(1)
        mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return mixed ^ (mixed >> np.uint64(32))
