"""Faces of user-provided scenes that lie in one plane: each would shadow the other, and Cycles
shows both black.

Of equal faces only the first is kept. Objects that overlap larger ones in one plane, and other
faces that overlap larger ones, are moved in front of them. Moving objects, glass, volumes,
instances, and faces that are never visible, between touching boxes, are not changed.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import permutations

import bmesh
import numpy as np
from bpy.types import DepsgraphObjectInstance, Object, Scene
from mathutils import Matrix, Vector, geometry

from .. import compat, materials
from ..notes import names_of
from ..surfaces import as_rendered
from .displacement import as_rendered_meshes
from .faces import OFFSET_M, PARALLEL, Faces
from .motion import all_moving_names

#: Faces and objects are moved by this distance: Cycles' rays then meet one after the other, and
#: depth changes by less than any sensor resolves.
_RAISED_M = 5e-5
#: Smaller areas of coincident faces are ignored: 1 cm x 1 cm fills less than a pixel of a room.
_SMALLEST_M2 = 1e-4
#: An object is moved as a whole if at least this share of its surface is in the plane of another:
#: half of a thin sheet, a sixth of a box.
_LARGE = 0.1
#: Limits of the time for large scenes: coincident faces checked for visibility; objects of one
#: plane that are compared (more are the tiles of a pattern); pairs of objects; faces checked for
#: overlap, the largest.
_MAX_PROBES = 64
_MAX_IN_PLANE = 64
_MAX_PAIRS = 2000
_MAX_OVERLAPS = 1000
#: Sample points of a polygon are moved from its corners to its centre by this share, so that
#: polygons that only touch do not overlap.
_INWARD = 0.04


@dataclass(frozen=True, eq=False)
class _Edit:
    """Changes of a mesh: faces to remove, and faces to move along directions (n, 3)."""

    left_out: np.ndarray
    lifted: np.ndarray
    directions: np.ndarray


def remove_coincident_faces(scene: Scene) -> list[str]:
    """Remove or move the faces that lie in the plane of others. Returns notes."""
    found = _found(scene, set())
    # what moves takes long to find, and few scenes have such faces
    if any(found) and (moving := set(all_moving_names(scene))):
        found = _found(scene, moving)
    edits, raised, _ = found
    for thing, shift_m in raised.items():
        thing.matrix_world = Matrix.Translation(shift_m) @ thing.matrix_world
    as_rendered_meshes(scene, list(edits))
    for thing, edit in edits.items():
        _edit_faces(thing, edit)
    return _notes(*found)


def _found(
    scene: Scene, moving: set[str]
) -> tuple[dict[Object, _Edit], dict[Object, Vector], set[str]]:
    """Edits of meshes, translations of sheets, and names of sheets that overlap the back of others,
    without the objects that move.
    """
    with as_rendered(scene) as depsgraph:
        shown = [i.object for i in depsgraph.object_instances if i.show_self and not i.is_instance]
        copied = {i.object.name for i in depsgraph.object_instances if _is_copy(i)}
        meshes = [t for t in shown if t.type == "MESH" and t.name not in moving | copied]
        things = [thing for thing in meshes if _is_opaque(thing.original)]
        if not any(len(thing.data.polygons) for thing in things):
            return {}, {}, set()
        faces = Faces(depsgraph, things)
        again = _equal(faces)
        raised = _raised_sheets(faces, again)
        lifted, reversed_names = _overlapping(faces, again, raised)
        return _edits(faces, again, lifted), raised, reversed_names


def _is_copy(instance: DepsgraphObjectInstance) -> bool:
    """Whether it is an object at another place, which would be edited with it."""
    return instance.is_instance and instance.parent.original != instance.object.original


def _edits(faces: Faces, again: np.ndarray, lifted: dict[int, int]) -> dict[Object, _Edit]:
    edits = {}
    rows = np.array(sorted(lifted), int)
    for k, thing in enumerate(faces.things):
        gone = faces.rows_of(k, again)
        moved = faces.rows_of(k, rows)
        if len(gone) or len(moved):
            start = faces.starts[k]
            layers = np.array([lifted[row] for row in moved])[:, None]
            directions = faces.normals[moved] * layers
            edits[thing.original] = _Edit(gone - start, moved - start, directions)
    return edits


def _notes(edits: dict[Object, _Edit], raised: Iterable[Object], reversed_: set[str]) -> list[str]:
    black = "because Cycles would show both black"
    moved = f"moved by {_RAISED_M * 1e3:g} mm a layer, {black}"
    notes = []
    if gone := [thing for thing, edit in edits.items() if len(edit.left_out)]:
        count = sum(len(edit.left_out) for edit in edits.values())
        where = f"faces that lie exactly on others ({count}, of {names_of(gone)})"
        notes.append(f"{where}: left out, {black}")
    if raised:
        notes.append(f"sheets that lie in the plane of others ({names_of(raised)}): {moved}")
    if lifted := [thing for thing, edit in edits.items() if len(edit.lifted)]:
        count = sum(len(edit.lifted) for edit in edits.values())
        where = f"faces that overlap larger ones in one plane ({count}, of {names_of(lifted)})"
        notes.append(f"{where}: {moved}")
    if reversed_:
        where = f"sheets that overlap the back of others in one plane ({names_of(reversed_)})"
        advice = "flip them, or move them apart by 0.1 mm"
        notes.append(f"{where}: black or flickering in path tracing; {advice}")
    return notes


def _edit_faces(thing: Object, edit: _Edit) -> None:
    to_object = thing.matrix_world.inverted_safe().to_3x3()
    edited = bmesh.new()
    edited.from_mesh(thing.data)
    edited.faces.ensure_lookup_table()
    gone = [edited.faces[int(k)] for k in edit.left_out]
    moved = [edited.faces[int(k)] for k in edit.lifted]
    for face, direction in zip(moved, edit.directions, strict=True):
        alone = bmesh.ops.split(edited, geom=[face])["geom"]
        corners = [v for v in alone if isinstance(v, bmesh.types.BMVert)]
        bmesh.ops.translate(edited, verts=corners, vec=to_object @ Vector(direction * _RAISED_M))
    bmesh.ops.delete(edited, geom=gone, context="FACES_ONLY")
    edited.to_mesh(thing.data)
    edited.free()


def _is_opaque(thing: Object) -> bool:
    """Whether an object is opaque and visible to all rays."""
    if not thing.visible_camera or not thing.visible_shadow or thing.hide_render:
        return False
    volumes = set(compat.volume_outputs())
    for slot in thing.material_slots:
        if slot.material and slot.material.node_tree:
            nodes = compat.nodes_of(slot.material.node_tree)
            if any(node in volumes or materials.is_glass(node) for node in nodes):
                return False
    return True


# Equal faces


def _equal(faces: Faces) -> np.ndarray:
    """Rows of faces that are equal to an earlier face, unless they are never visible."""
    _, first, group = np.unique(faces.keys, return_index=True, return_inverse=True)
    first = first[group]
    again = np.flatnonzero((faces.keys != 0) & (first != np.arange(len(first))))
    owner = faces.owner[again]
    again = again[np.bincount(owner, faces.area_m2[again])[owner] > _SMALLEST_M2]
    cosine = (faces.normals[again] * faces.normals[first[again]]).sum(1)
    opposed = faces.keys[again[cosine < 0]]
    for k in np.linspace(0, len(again) - 1, min(len(again), _MAX_PROBES)).astype(int):
        row = again[k]
        owners = (faces.owner[row], faces.owner[first[row]])
        for direction in (faces.normals[row], -faces.normals[row]):
            if _leaves(faces, row, owners, direction, opposed):
                return again
    return again[:0]


def _leaves(
    faces: Faces,
    row: int,
    owners: tuple[int, int],
    direction: np.ndarray,
    opposed: np.ndarray,
) -> bool:
    """Whether a ray from the face leaves the two objects that share it, instead of hitting a back
    face of one of them, or a face that equals another one which faces the opposite direction.
    """
    for owner in owners:
        hit = faces.cast_from(row, owner, direction)
        if hit is not None:
            _, normal, face = hit
            if normal.dot(Vector(direction)) > 0 or faces.keys[face] in opposed:
                return False
    return True


# Sheets in the plane of larger objects


def _raised_sheets(faces: Faces, again: np.ndarray) -> dict[Object, Vector]:
    """Sheets that are in the plane of larger objects and face the same direction -> their
    translation in metres.
    """
    normals: dict[int, Vector] = {}
    pairs = []
    for row, over in _sharing_planes(faces):
        hit = None if row in again else faces.at(row, faces.owner[over])
        if hit is None:
            continue
        if hit[1].dot(Vector(faces.normals[row])) > PARALLEL and faces.is_sheet(row):
            normals[row] = hit[1]
            pairs.append((row, over))
    raised = {}
    for row, layer in _layers(faces, pairs).items():
        raised[faces.things[faces.owner[row]].original] = normals[row] * layer * _RAISED_M
    return raised


def _layers(faces: Faces, pairs: Iterable[tuple[int, int]]) -> dict[int, int]:
    """The number of faces below each smaller face of pairs (smaller, larger), from 1 on: those that
    overlap one another move by different distances.
    """

    def from_largest(pair: tuple[int, int]) -> tuple[float, float, int]:
        large = pair[1]
        return -round(float(faces.spread_m2[large]), 6), -faces.area_m2[large], large

    layers: dict[int, int] = {}
    for small, large in sorted(pairs, key=from_largest):
        layers[small] = max(layers.get(small, 0), layers.get(large, 0) + 1)
    return layers


def _sharing_planes(faces: Faces) -> list[tuple[int, int]]:
    """Pairs of faces, each the largest of its object in their plane, of which the second has more
    area in it; a limited number of pairs.
    """
    order = np.lexsort((-faces.area_m2, faces.owner, faces.plane))
    large = faces.spread_m2 > _LARGE * np.bincount(faces.owner, faces.area_m2)[faces.owner]
    order = order[((faces.area_m2 > _SMALLEST_M2) & large)[order]]
    keys = np.stack([faces.plane[order], faces.owner[order]])
    is_first = np.any(np.diff(keys, prepend=keys[:, :1] + 1) != 0, axis=0)
    largest = order[is_first]  # of each object in each plane
    pairs = []
    for group in np.split(largest, np.flatnonzero(np.diff(faces.plane[largest])) + 1):
        if len(group) <= _MAX_IN_PLANE:
            for a, b in permutations(group, 2):
                if a == faces.smaller(a, b):
                    pairs.append((a, b))
    return pairs[:: 1 + len(pairs) // _MAX_PAIRS]


# Other faces that overlap


def _overlapping(
    faces: Faces, again: np.ndarray, raised: Iterable[Object]
) -> tuple[dict[int, int], set[str]]:
    """Rows of faces that overlap larger ones that face the same direction -> their layer, and names
    of sheets that overlap others that face the opposite direction.
    """
    pairs: set[tuple[int, int]] = set()
    reversed_: set[str] = set()
    for row, other in _overlaps(faces, again, raised):
        small = faces.smaller(row, other)
        large = row + other - small
        if (faces.normals[row] * faces.normals[other]).sum() > 0:
            if _may_be_seen(faces, small, large):
                pairs.add((small, large))
        elif faces.owner[row] != faces.owner[other] and faces.is_sheet(small):
            reversed_.add(faces.things[faces.owner[small]].name)
    return _layers(faces, pairs), reversed_


def _overlaps(
    faces: Faces, again: np.ndarray, raised: Iterable[Object]
) -> Iterator[tuple[int, int]]:
    """Pairs of faces that overlap in one plane, among the largest faces that share a plane."""
    is_raised = np.array([thing.original in raised for thing in faces.things])
    shared = (np.bincount(faces.plane)[faces.plane] > 1) & (faces.area_m2 > _SMALLEST_M2)
    shared &= ~is_raised[faces.owner]
    shared[again] = False
    rows = np.flatnonzero(shared)
    rows = rows[np.argsort(-faces.area_m2[rows], kind="stable")][:_MAX_OVERLAPS]
    for plane in np.unique(faces.plane[rows]):
        yield from _overlaps_in_plane(faces, rows[faces.plane[rows] == plane])


def _overlaps_in_plane(faces: Faces, rows: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of overlapping faces among faces in one plane: a sample point of one is inside the
    other.
    """
    flat = np.delete(np.arange(3), np.abs(faces.normals[rows[0]]).argmax())
    outlines = [faces.outline(int(row))[:, flat] for row in rows]
    low = np.array([outline.min(0) for outline in outlines])
    high = np.array([outline.max(0) for outline in outlines])
    for row, outline in zip(rows, outlines, strict=True):
        places = _places_in(outline)
        near = ((places[:, None] > low) & (places[:, None] < high)).all(-1).any(0)
        for k in np.flatnonzero(near & (rows != row)):
            if _within(outlines[k], places).any():
                yield int(row), int(rows[k])


def _may_be_seen(faces: Faces, small: int, large: int) -> bool:
    """False for a box on a floor whose front faces downwards, with nothing below it."""
    if faces.owner[small] == faces.owner[large] or not faces.is_sheet(large):
        return True
    normal = faces.normals[small]
    start = Vector(faces.centres_m[small] + OFFSET_M * normal)
    return bool(faces.depsgraph.scene.ray_cast(faces.depsgraph, start, Vector(normal))[0])


def _places_in(outline: np.ndarray) -> np.ndarray:
    """Sample points (n, 2) in a polygon (k, 2): near its corners, at the centres of its first and
    last triangle, and at its own centre if it has at most four corners.
    """
    ears = geometry.tessellate_polygon([[Vector((*corner, 0.0)) for corner in outline]])
    picked = [outline[list(ear)] for ear in (*ears[:1], *ears[1:][-1:])]
    triangles = np.array(picked).reshape(-1, 3, 2)
    centres = triangles.mean(1, keepdims=True)
    corners = (1 - _INWARD) * triangles + _INWARD * centres
    places = np.concatenate([corners, centres], 1).reshape(-1, 2)
    return np.vstack([places, outline.mean(0)]) if len(outline) <= 4 else places


def _within(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n,) whether the points `places` (n, 2) are inside a polygon (k, 2): a ray along x crosses it
    an odd number of times.
    """
    x0, y0 = outline.T[:, :, None]
    x1, y1 = np.roll(outline, -1, 0).T[:, :, None]
    x, y = places.T[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return (((y0 > y) != (y1 > y)) & (x < crossing)).sum(0) % 2 == 1
