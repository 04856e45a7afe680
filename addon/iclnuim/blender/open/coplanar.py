"""Faces of different objects in one plane: Cycles would show both black."""

from collections.abc import Iterable, Iterator

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector, geometry

from .. import compat, materials
from ..notes import names_of
from ..surfaces import array_of, as_rendered
from . import preflight
from .displacement import as_rendered_meshes

#: Corners closer than this are at the same position. Maximum number of coincident faces that are
#: checked for visibility.
_SAME_PLACE_M, _PROBES = 1e-5, 64
#: An object with at least this share of its surface in the plane of another object is moved by this
#: distance in front of it. Smaller areas are ignored, and at most this number of pairs is checked.
_LARGE, _RAISED_M, _SMALLEST_M2, _PAIRS = 0.1, 5e-5, 1e-4, 2000
#: Maximum number of faces that are checked for overlap: the largest of those that share a plane
#: with others.
_OVERLAPS = 1000


def remove_coincident_faces(scene: bpy.types.Scene) -> list[str]:
    """Of equal faces at the same position, keep only the first. Objects that overlap larger ones in
    one plane, and other faces that overlap larger
    ones, are moved in front of them: otherwise each face would shadow the other, and Cycles shows
    both black. Moving objects, glass, volumes, instances, and faces that are never visible, between
    touching boxes, are not changed.
    """
    moving = set(preflight.moving_names(scene))
    with as_rendered(scene) as depsgraph:
        shown = [i.object for i in depsgraph.object_instances if i.show_self and not i.is_instance]
        things = [
            t for t in shown if t.type == "MESH" and t.name not in moving and _is_opaque(t.original)
        ]
        if not any(len(thing.data.polygons) for thing in things):
            return []
        faces = _Faces(depsgraph, things)
        again = faces.equal()
        raised = faces.sheets(again)
        lifted, reversed_ = faces.overlapping(again, raised)
        left_out, lifted_of = faces.by_object(again), faces.by_object(lifted)
        directions = {
            t.original: faces.normals[rows]
            for t, rows in zip(things, faces.rows_of(lifted), strict=True)
        }
    for thing, shift in raised.items():
        thing.matrix_world = Matrix.Translation(shift) @ thing.matrix_world
    as_rendered_meshes(scene, list({**left_out, **lifted_of}))
    for thing in {**left_out, **lifted_of}:
        _edit_faces(thing, left_out.get(thing, ()), lifted_of.get(thing, ()), directions[thing])
    black = "because Cycles would show both black"
    millimetres = f"moved by {_RAISED_M * 1e3:g} mm, {black}"
    notes = {
        f"faces that lie exactly on others ({len(again)}, of {names_of(left_out)}): left out, {black}": left_out,
        f"sheets that lie in the plane of others ({names_of(raised)}): {millimetres}": raised,
        f"faces that overlap larger ones in one plane ({len(lifted)}, of {names_of(lifted_of)}): {millimetres}": lifted_of,
        f"sheets that overlap the back of others in one plane ({names_of(reversed_)}): black or flickering in path tracing; "
        "flip them, or move them apart by 0.1 mm": reversed_,
    }
    return [sentence for sentence, is_so in notes.items() if is_so]


def _edit_faces(
    thing: bpy.types.Object, left_out: Iterable[int], lifted: Iterable[int], directions: np.ndarray
) -> None:
    """Remove faces of a mesh, and move others separately along `directions` (n, 3), unit vectors in
    the world.
    """
    to_object = thing.matrix_world.inverted_safe().to_3x3()
    edited = bmesh.new()
    edited.from_mesh(thing.data)
    edited.faces.ensure_lookup_table()
    gone, moved = ([edited.faces[int(k)] for k in rows] for rows in (left_out, lifted))
    for face, direction in zip(moved, directions, strict=True):
        alone = bmesh.ops.split(edited, geom=[face])["geom"]
        corners = [v for v in alone if isinstance(v, bmesh.types.BMVert)]
        bmesh.ops.translate(edited, verts=corners, vec=to_object @ Vector(direction * _RAISED_M))
    bmesh.ops.delete(edited, geom=gone, context="FACES_ONLY")
    edited.to_mesh(thing.data)
    edited.free()


class _Faces:
    """The faces of evaluated meshes in the world, in one list: keys (F,), centres_m (F, 3), normals
    (F, 3), area_m2 (F,), see _faces_in_world;
    owner (F,): index into things; plane (F,): equal for faces in the same plane; spread_m2 (F,):
    area of all faces of the same owner in the same plane.
    """

    def __init__(self, depsgraph: bpy.types.Depsgraph, things: list[bpy.types.Object]) -> None:
        self.depsgraph, self.things = depsgraph, things
        faces = [_faces_in_world(thing) for thing in things]
        self.keys, self.centres_m, self.normals, self.area_m2 = (
            np.concatenate([f[k] for f in faces]) for k in range(4)
        )
        self.starts = np.cumsum([0, *(len(f[0]) for f in faces)])
        self.owner = np.repeat(np.arange(len(things)), np.diff(self.starts))
        self.plane = np.unique(_planes(self.centres_m, self.normals), return_inverse=True)[
            1
        ].reshape(-1)
        own = np.unique(self.plane * len(things) + self.owner, return_inverse=True)[1].reshape(-1)
        self.spread_m2 = np.bincount(own, self.area_m2)[own]

    def rows_of(self, rows: np.ndarray) -> list[np.ndarray]:
        """For each object, the rows that belong to it."""
        return [
            rows[(rows >= a) & (rows < b)]
            for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)
        ]

    def by_object(self, rows: np.ndarray) -> dict[bpy.types.Object, np.ndarray]:
        """Objects that own some of the rows -> the indices of these faces in their meshes."""
        own = zip(self.things, self.rows_of(rows), self.starts, strict=False)
        return {thing.original: found - start for thing, found, start in own if len(found)}

    def cast(
        self, k: int, start_m: np.ndarray, direction: np.ndarray, reach_m: float
    ) -> tuple[np.ndarray, Vector, int] | None:
        """Like _cast, for object k; the face is returned as a row."""
        hit = _cast(self.depsgraph, self.things[k], start_m, direction, reach_m)
        return hit and (hit[0], hit[1], hit[2] + int(self.starts[k]))

    def equal(self) -> np.ndarray:
        """Rows of faces that are equal to an earlier face, unless they are never visible."""
        again = np.setdiff1d(np.flatnonzero(self.keys), np.unique(self.keys, return_index=True)[1])
        owner = self.owner
        again = again[
            np.bincount(owner[again], self.area_m2[again], len(self.things))[owner[again]]
            > _SMALLEST_M2
        ]
        _, first, group = np.unique(self.keys, return_index=True, return_inverse=True)
        opposed = self.keys[
            again[(self.normals[again] * self.normals[first][group[again]]).sum(1) < 0]
        ]

        def is_seen(row: int, direction: np.ndarray) -> bool:
            """Whether a ray from the face leaves the two objects that share it, instead of hitting
            a back face of one of them.
            """
            for k in (owner[row], owner[first[group[row]]]):
                hit = self.cast(
                    k, self.centres_m[row] + 10 * _SAME_PLACE_M * direction, direction, 1e4
                )
                if hit is not None and (
                    hit[1].dot(Vector(direction)) > 0 or self.keys[hit[2]] in opposed
                ):
                    return False
            return True

        picked = again[np.linspace(0, len(again) - 1, min(len(again), _PROBES)).astype(int)]
        return (
            again
            if any(is_seen(k, sign * self.normals[k]) for k in picked for sign in (1, -1))
            else again[:0]
        )

    def sheets(self, again: np.ndarray) -> dict[bpy.types.Object, Vector]:
        """Sheets that are in the plane of larger objects and face the same direction -> their
        translation in metres.
        """
        raised: dict[bpy.types.Object, Vector] = {}
        for face, over in self._sharing_planes():
            one, other = self.things[self.owner[face]].original, self.things[over].original
            if one in raised or other in raised or face in again:
                continue
            hit = self._on(over, self.centres_m[face], self.normals[face])
            if (
                hit is not None
                and hit[1].dot(Vector(self.normals[face])) > 0.999
                and self._is_sheet(face)
            ):
                raised[one] = hit[1] * _RAISED_M
        return raised

    def _sharing_planes(self) -> Iterator[tuple[int, int]]:
        """Pairs of a face, the largest of its object in its plane, and another object with more
        area in that plane; a limited number of pairs.
        """
        order = np.lexsort((-self.area_m2, self.owner, self.plane))
        large = self.spread_m2 > _LARGE * np.bincount(self.owner, self.area_m2)[self.owner]
        order = order[((self.area_m2 > _SMALLEST_M2) & large)[order]]
        new = np.any(
            [np.diff(a[order], prepend=a[order][:1] + 1) != 0 for a in (self.plane, self.owner)],
            axis=0,
        )
        largest = order[new]  # of each object in each plane
        groups = [
            g
            for g in np.split(largest, np.flatnonzero(np.diff(self.plane[largest])) + 1)
            if 1 < len(g) <= _PROBES
        ]
        pairs = [
            (a, self.owner[b])
            for g in groups
            for a in g
            for b in g
            if a != b and a == self._smaller(a, b)
        ]
        yield from pairs[:: 1 + len(pairs) // _PAIRS]

    def _smaller(self, a: int, b: int) -> int:
        """Which of two faces in one plane should be in front: the one with less area in it, such as
        a rug on a floor of many tiles.
        """
        area = self.area_m2 if self.owner[a] == self.owner[b] else self.spread_m2
        return int(min(a, b, key=lambda row: (round(float(area[row]), 6), self.area_m2[row], -row)))

    def _on(
        self, k: int, place_m: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, Vector, int] | None:
        """The face of object k at this position, in the plane perpendicular to the normal."""
        reach_m = 10 * _SAME_PLACE_M
        hit = self.cast(k, place_m + reach_m * normal, -normal, 2 * reach_m)
        at = (
            hit is not None
            and abs(hit[1].dot(Vector(normal))) > 0.999
            and np.linalg.norm(hit[0] - place_m) <= _SAME_PLACE_M
        )
        return hit if at else None

    def _is_sheet(self, face: int) -> bool:
        """Whether the object of a face is a sheet.

        A box on the floor is not: a ray to one side of its face passes through it.
        """
        outline = self._outline(face)
        ears = geometry.tessellate_polygon([[Vector(corner) for corner in outline]])
        place_m = (
            outline[list(ears[0])].mean(0) if ears else self.centres_m[face]
        )  # the centre of an L-shape may be outside it
        directions, reach_m = (self.normals[face], -self.normals[face]), 10 * _SAME_PLACE_M
        return all(
            self.cast(self.owner[face], place_m + reach_m * w, w, 1e4) is None for w in directions
        )

    def overlapping(
        self, again: np.ndarray, raised: Iterable[bpy.types.Object]
    ) -> tuple[np.ndarray, set[str]]:
        """Rows of faces that overlap larger ones that face the same direction, and names of sheets
        that overlap others that face the opposite
        direction. Only the _OVERLAPS largest faces that share a plane with others are checked.
        """
        shared = (np.bincount(self.plane)[self.plane] > 1) & (self.area_m2 > _SMALLEST_M2)
        shared &= np.array([thing.original not in raised for thing in self.things])[self.owner]
        shared[again] = False
        rows = np.flatnonzero(shared)
        rows = rows[np.argsort(-self.area_m2[rows], kind="stable")][:_OVERLAPS]
        lifted: set[int] = set()
        reversed_: set[str] = set()
        for row, other in (
            pair
            for plane in np.unique(self.plane[rows])
            for pair in self._pairs(rows[self.plane[rows] == plane])
        ):
            small = self._smaller(row, other)
            if (self.normals[row] * self.normals[other]).sum() > 0:
                lifted |= {small} if self._may_be_seen(small, row + other - small) else set()
            elif self.owner[row] != self.owner[other] and self._is_sheet(small):
                reversed_.add(self.things[self.owner[small]].name)
        return np.array(sorted(lifted), int), reversed_

    def _may_be_seen(self, small: int, large: int) -> bool:
        """False for a box on a floor whose front faces downwards, with nothing below it."""
        if self.owner[small] == self.owner[large] or not self._is_sheet(large):
            return True
        start = Vector(self.centres_m[small] + 10 * _SAME_PLACE_M * self.normals[small])
        return bool(
            self.depsgraph.scene.ray_cast(self.depsgraph, start, Vector(self.normals[small]))[0]
        )

    def _pairs(self, rows: np.ndarray) -> Iterator[tuple[int, int]]:
        """Pairs of overlapping faces among faces in one plane: a sample point of one is inside the
        other.
        """
        flat = np.delete(np.arange(3), np.abs(self.normals[rows[0]]).argmax())
        outlines = [self._outline(int(row))[:, flat] for row in rows]
        low, high = (
            np.array([extreme(outline, axis=0) for outline in outlines])
            for extreme in (np.min, np.max)
        )
        for row, outline in zip(rows, outlines, strict=True):
            places = _places_in(outline)
            near = ((places[:, None] > low) & (places[:, None] < high)).all(-1).any(0)
            for k in np.flatnonzero(near & (rows != row)):
                if _within(outlines[k], places).any():
                    yield int(row), int(rows[k])

    def _outline(self, row: int) -> np.ndarray:
        """The corners (n, 3) of a face in metres."""
        thing, face = self.things[self.owner[row]], row - self.starts[self.owner[row]]
        return np.array(
            [
                thing.matrix_world @ thing.data.vertices[k].co
                for k in thing.data.polygons[int(face)].vertices
            ]
        )


def _places_in(outline: np.ndarray) -> np.ndarray:
    """Sample points (n, 2) in a polygon (k, 2): near its corners, at the centres of its first and
    last triangle, and at its own centre.
    """
    ears = geometry.tessellate_polygon([[Vector((*corner, 0.0)) for corner in outline]])
    picked = np.array([outline[list(ear)] for ear in (*ears[:1], *ears[1:][-1:])]).reshape(-1, 3, 2)
    centres = picked.mean(1, keepdims=True)
    places = np.concatenate([0.96 * picked + 0.04 * centres, centres], 1).reshape(-1, 2)
    return np.vstack([places, outline.mean(0)]) if len(outline) <= 4 else places


def _within(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n,) whether the points `places` (n, 2) are inside a polygon (k, 2): a ray along x crosses it
    an odd number of times.
    """
    (x0, y0), (x1, y1) = outline.T[:, :, None], np.roll(outline, -1, 0).T[:, :, None]
    x, y = places.T[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return (((y0 > y) != (y1 > y)) & (x < crossing)).sum(0) % 2 == 1


def _planes(centres_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(F,) uint64, equal for faces in one plane, whichever direction they face."""
    sign = np.sign(np.take_along_axis(normals, np.abs(normals).argmax(1)[:, None], 1))
    offset_m = (sign * normals * centres_m).sum(1)
    return _mixed(
        np.column_stack([np.round(sign * normals * 1e4), np.round(offset_m / _SAME_PLACE_M)])
    )


def _cast(
    depsgraph: bpy.types.Depsgraph,
    thing: bpy.types.Object,
    start_m: np.ndarray,
    direction: np.ndarray,
    reach_m: float,
) -> tuple[np.ndarray, Vector, int] | None:
    """The hit of a ray in the world with one object: position (3,) in metres, unit normal, face;
    None if there is no hit.
    """
    inverse, matrix = thing.matrix_world.inverted_safe(), thing.matrix_world
    step = inverse.to_3x3() @ Vector(reach_m * direction)
    if not step.length:
        return None
    start = inverse @ Vector(start_m)
    hit, place, normal, face = thing.ray_cast(
        start, step.normalized(), distance=step.length, depsgraph=depsgraph
    )
    return (
        (np.array(matrix @ place), (inverse.to_3x3().transposed() @ normal).normalized(), face)
        if hit
        else None
    )


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """(n,) uint64 hashes of rows (n, up to 4) of whole numbers."""
    with np.errstate(over="ignore"):
        factors = np.array(
            [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5],
            np.uint64,
        )
        mixed = (numbers.astype(np.int64).astype(np.uint64) * factors[: numbers.shape[1]]).sum(1)
        mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        return mixed ^ (mixed >> np.uint64(32))


def _is_opaque(thing: bpy.types.Object) -> bool:
    """Whether an object is opaque and visible to all rays."""
    trees = [
        slot.material.node_tree
        for slot in thing.material_slots
        if slot.material and slot.material.node_tree
    ]
    outputs = set(compat.volume_outputs())
    nodes = [node for tree in trees for node in compat.nodes_of(tree)]
    shows = thing.visible_camera and thing.visible_shadow and not thing.hide_render
    return shows and not any(node in outputs or materials.is_glass(node) for node in nodes)


def _faces_in_world(
    thing: bpy.types.Object,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The faces of an evaluated mesh: keys (F,), equal for faces with the same corners in any
    order, 0 for faces without area; (F, 3) centres in
    metres; (F, 3) unit normals; (F,) areas in square metres.
    """
    mesh, matrix = thing.data, np.array(thing.matrix_world)
    if not len(mesh.polygons):
        return np.zeros(0, np.uint64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    starts = array_of(mesh.polygons, "loop_start", 1, np.int32)
    points = array_of(mesh.vertices, "co", 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    corners = points[array_of(mesh.loops, "vertex_index", 1, np.int32)]
    following = np.arange(len(corners)) + 1
    following[np.append(starts[1:], len(corners)) - 1] = starts
    normals = np.add.reduceat(np.cross(corners, corners[following]), starts) / 2
    normals *= (
        -1 if thing.matrix_world.is_negative else 1
    )  # a mirrored object's faces have reversed winding
    area = np.linalg.norm(normals, axis=1)
    with np.errstate(over="ignore"):
        keys = np.add.reduceat(_mixed(np.round(corners / _SAME_PLACE_M)), starts)
    counts = np.diff(np.append(starts, len(corners)))
    centres_m = np.add.reduceat(corners, starts) / counts[:, None]
    return (
        np.where(area > _SAME_PLACE_M**2, keys, np.uint64(0)),
        centres_m,
        normals / np.maximum(area, 1e-30)[:, None],
        area,
    )
