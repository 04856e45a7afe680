"""Repairs a user-provided scene so that it can be rendered: invalid numbers, missing images, vertex
colours without a material, displacement by
materials, coincident faces, drivers written in Python.

Everything is done in memory. Functions that return sentences report what was found and changed.
"""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector, geometry

from . import compat, lit_scene, preflight
from .compat import temporarily
from .surfaces import array_of, as_rendered

_ATTRIBUTE = "displaced position"
#: Larger coordinates are treated as invalid: float32 cannot represent millimetres there.
_MAX_COORDINATE = 1e7
#: A face with less area than this (file units squared) is degenerate: a line or a point.
_MIN_AREA = 1e-14
#: Corners closer than this are at the same position. Maximum number of coincident faces that are
#: checked for visibility.
_SAME_PLACE_M, _PROBES = 1e-5, 64
#: An object with at least this share of its surface in the plane of another object is moved by this
#: distance in front of it. Smaller areas are ignored, and at most this number of pairs is checked.
_LARGE, _RAISED_M, _SMALLEST_M2, _PAIRS = 0.1, 5e-5, 1e-4, 2000
#: Maximum number of faces that are checked for overlap: the largest of those that share a plane
#: with others.
_OVERLAPS = 1000


def sanitize(scene: bpy.types.Scene) -> list[str]:
    """Repair all meshes, images and materials of the open session. Returns what was done."""
    lost = [o for o in scene.objects if not np.isfinite(np.array(o.matrix_world)).all()]
    for thing in lost:  # its position is not finite
        thing.hide_render = thing.hide_viewport = True
    gone = flat = texture = repaired = 0
    for mesh in bpy.data.meshes:
        gone += _without_lost_vertices(mesh)
        repaired += bool(mesh.validate(clean_customdata=False))
        flat += int((~(array_of(mesh.polygons, "area") > _MIN_AREA)).sum())
        for layer in mesh.uv_layers:
            uv = array_of(layer.data, "uv", 2).ravel()
            wrong = ~np.isfinite(uv)
            if wrong.any():
                layer.data.foreach_set("uv", np.where(wrong, 0.0, uv).astype(np.float32))
                texture += int(wrong.sum())
    images, coloured = _missing_images(), _show_vertex_colours(scene)
    scripts = [t for t in bpy.data.texts if t.use_module]
    found = {
        f"objects without a valid position ({_names(lost)}): left out": lost,
        f"{gone} vertices have NaN or coordinates beyond {_MAX_COORDINATE:.0e}: left out with their faces": gone,
        f"{repaired} meshes had faces with missing vertices, or duplicate faces: these faces are left out": repaired,
        f"{flat} faces have no area: no ray hits them": flat,
        f"{texture} texture coordinates are NaN or infinite: set to 0": texture,
        f"textures that are missing or broken ({images}): replaced by plain colour": images,
        "surfaces without a material show the colours of their vertices": coloured,
        f"scripts in the file ({_names(scripts)}): not run": scripts,
    }
    return [sentence for sentence, is_so in found.items() if is_so]


def without_false_glass(path: Path) -> list[str]:
    """Make materials of the OBJ at `path` opaque if only `Tf` makes them glass: 3ds Max writes `Tf
    1 1 1` for all, with `d 1` and `illum 2`.
    """
    named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    libraries = {path.parent / os.fsdecode(name).strip('"') for name in named} | {
        path.with_suffix(".mtl")
    }
    texts = [
        library.read_text("utf-8", "replace") for library in sorted(libraries) if library.is_file()
    ]
    opaque = []
    for block in (
        block
        for text in texts
        for block in re.split(r"^\s*newmtl[ \t]+", text, flags=re.MULTILINE)[1:]
    ):
        name, *lines = block.splitlines()
        values = {
            word.lower(): rest for word, *rest in (line.split() for line in lines if line.strip())
        }
        solid = values.get("illum") in (["0"], ["1"], ["2"]) and re.fullmatch(
            r"1(\.0*)?", values.get("d", ["1"])[-1]
        )
        material = bpy.data.materials.get(name.strip()[:63]) if solid and "tf" in values else None
        for node in material.node_tree.nodes if material else ():
            if (
                node.type == "BSDF_PRINCIPLED"
                and node.inputs["Transmission Weight"].default_value > 0
            ):
                node.inputs["Transmission Weight"].default_value = 0.0
                opaque.append(material)
    return [f"Tf of opaque materials ({_names(opaque)}): not treated as glass"] if opaque else []


def _without_lost_vertices(mesh: bpy.types.Mesh) -> int:
    places = array_of(mesh.vertices, "co", 3)
    lost = np.flatnonzero(~(np.abs(places) < _MAX_COORDINATE).all(1))
    if len(lost):
        # set to 0 first: the deletion needs edges of finite length
        places[lost] = 0.0
        mesh.vertices.foreach_set("co", places.ravel())
        edited = bmesh.new()
        try:
            edited.from_mesh(mesh)
            edited.verts.ensure_lookup_table()
            bmesh.ops.delete(edited, geom=[edited.verts[int(k)] for k in lost], context="VERTS")
            edited.to_mesh(mesh)
        finally:
            edited.free()
    return len(lost)


def _missing_images() -> str:
    """Remove missing or unreadable images from the materials, so that their plain values are shown
    instead of magenta. Returns the names.
    """
    missing = [image for image in bpy.data.images if _is_missing(image)]
    owners = [*bpy.data.materials, *bpy.data.worlds, *bpy.data.lights]
    trees = [
        *bpy.data.node_groups,
        *(block.node_tree for block in owners if block.node_tree is not None),
    ]
    shown = [n for tree in trees for n in tree.nodes if getattr(n, "image", None) in missing]
    for output in (output for node in shown for output in node.outputs):
        compat.unlink(output)
    names = _names(missing)
    for image in missing:
        bpy.data.images.remove(image)
    return names if shown else ""


def _is_missing(image: bpy.types.Image) -> bool:
    if image.source in ("GENERATED", "VIEWER"):
        return False
    with suppress(RuntimeError, OSError, ValueError):
        if image.source in ("SEQUENCE", "TILED"):
            return not any(
                Path(bpy.path.abspath(image.filepath, library=image.library)).parent.glob("*")
            )
        return not (image.size[0] and image.size[1])
    return True


def _show_vertex_colours(scene: bpy.types.Scene) -> bool:
    """Show the vertex colours of meshes without any material, such as a scan as PLY.

    Returns whether there are any.
    """
    bare = [
        o
        for o in scene.objects
        if o.type == "MESH" and not any(s.material for s in o.material_slots)
    ]
    coloured = [o for o in bare if o.data.color_attributes]
    for thing in coloured:
        attribute = thing.data.color_attributes[0].name
        material = bpy.data.materials.get(name := f"colours of {attribute}")
        if material is None:
            material, matt = compat.matt_material(name)
            source = material.node_tree.nodes.new("ShaderNodeAttribute")
            source.attribute_name = attribute
            material.node_tree.links.new(source.outputs["Color"], matt.inputs["Color"])
        thing.data.materials.clear()
        thing.data.materials.append(material)
    return bool(coloured)


def _names(things: Iterable) -> str:
    names = sorted(t if isinstance(t, str) else t.name for t in things)
    shown = ", ".join(names[:5])
    return shown[:160] + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def displace_meshes(scene: bpy.types.Scene) -> list[str]:
    """Give every object with displacement in its materials a separate mesh, evaluated and
    displaced, also if the object is only instanced.
    """
    materials = {m for m in bpy.data.materials if _displaces(m)}
    adaptive = _without_adaptive_subdivision()
    things = [o for o in bpy.data.objects if o.type == "MESH" and o.users]
    moved = [o for o in things if {s.material for s in o.material_slots} & materials]
    if moved:
        with _in_view(scene, moved):
            _as_rendered_meshes(scene, moved)
            with _without_others(moved):
                for thing in moved:
                    _displace(scene, thing)
    for material in materials:
        # the meshes are displaced now, so the material no longer displaces; on objects without a
        # separate mesh it becomes a bump map
        material.displacement_method = "BUMP"
        if all(o in moved for o in bpy.data.objects if material.name in o.material_slots):
            compat.unlink(material.node_tree.get_output_node("CYCLES").inputs["Displacement"])
    names = ", ".join(sorted(o.name for o in moved))[:120]
    return [
        *([f"displaced surfaces ({names}): moved vertex by vertex"] if moved else []),
        *adaptive,
    ]


@contextmanager
def _in_view(scene: bpy.types.Scene, things: list[bpy.types.Object]) -> Iterator[None]:
    """Make all these objects rendered objects of the scene temporarily, so that instanced or unused
    ones are evaluated and baked, too.
    """
    with ExitStack() as stack:
        for thing in things:
            stack.enter_context(temporarily(thing, hide_render=False, hide_viewport=False))
            if bpy.context.view_layer.objects.get(thing.name) != thing:
                scene.collection.objects.link(thing)
                stack.callback(scene.collection.objects.unlink, thing)
        yield


@contextmanager
def _without_others(things: list[bpy.types.Object]) -> Iterator[None]:
    """Hide all other objects and instances temporarily: baking identifies an object by its name,
    which its instances share.
    """
    here = set(things)
    with ExitStack() as stack:
        for thing in bpy.data.objects:
            hidden = thing.hide_render or thing not in here
            stack.enter_context(temporarily(thing, hide_render=hidden, instance_type="NONE"))
        yield


def _displaces(material: bpy.types.Material) -> bool:
    if material.node_tree is None or material.displacement_method == "BUMP":
        return False
    output = material.node_tree.get_output_node("CYCLES")
    return output is not None and output.inputs["Displacement"].is_linked


def _without_adaptive_subdivision() -> list[str]:
    """Disable adaptive subdivision: it depends on the camera and would give every frame a different
    surface.
    """
    found = []
    for thing in bpy.data.objects:
        for owner in (*thing.modifiers, getattr(thing, "cycles", None)):
            if getattr(owner, "use_adaptive_subdivision", False):
                owner.use_adaptive_subdivision = False
                found.append(thing.name)
    compat.leave_out_experiments(bpy.context.scene)
    names = ", ".join(sorted(found))[:120]
    return [f"adaptive subdivision ({names}): the levels for rendering are used"] if found else []


def _as_rendered_meshes(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    """Apply the modifiers at the levels for rendering; each object then has its own mesh."""
    with as_rendered(scene) as depsgraph:
        kept = {"preserve_all_data_layers": True, "depsgraph": depsgraph}
        made = [
            bpy.data.meshes.new_from_object(o.evaluated_get(depsgraph), **kept) for o in objects
        ]
    for thing, mesh in zip(objects, made, strict=True):
        slots = [slot.material for slot in thing.material_slots]
        space = tuple(thing.data.texspace_location), tuple(thing.data.texspace_size)
        thing.modifiers.clear()
        thing.data = mesh
        mesh.use_auto_texspace = (
            False  # generated coordinates refer to its bounding box before the modifiers
        )
        mesh.texspace_location, mesh.texspace_size = space
        for slot, material in zip(thing.material_slots, slots, strict=False):
            slot.material = material


def _displace(scene: bpy.types.Scene, thing: bpy.types.Object) -> None:
    """Move vertices to the positions in Cycles' position pass; loose vertices are not moved."""
    thing.hide_set(False)
    mesh = thing.data
    mesh.color_attributes.active_color = mesh.color_attributes.new(
        _ATTRIBUTE, "FLOAT_COLOR", "POINT"
    )
    with (
        temporarily(scene.cycles, samples=1, use_denoising=False),
        temporarily(scene.render, engine="CYCLES"),
        temporarily(
            scene.render.bake, target="VERTEX_COLORS", use_clear=False, use_selected_to_active=False
        ),
    ):
        compat.bake(thing, type="POSITION", target="VERTEX_COLORS", use_clear=False)
    places = array_of(mesh.color_attributes[_ATTRIBUTE].data, "color", 4)[:, :3].astype(float)
    to_object = np.linalg.inv(np.array(thing.matrix_world))
    places = places @ to_object[:3, :3].T + to_object[:3, 3]
    mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
    mesh.color_attributes.remove(mesh.color_attributes[_ATTRIBUTE])
    mesh.update()


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
    _as_rendered_meshes(scene, list({**left_out, **lifted_of}))
    for thing in {**left_out, **lifted_of}:
        _edit_faces(thing, left_out.get(thing, ()), lifted_of.get(thing, ()), directions[thing])
    black = "because Cycles would show both black"
    millimetres = f"moved by {_RAISED_M * 1e3:g} mm, {black}"
    notes = {
        f"faces that lie exactly on others ({len(again)}, of {_names(left_out)}): left out, {black}": left_out,
        f"sheets that lie in the plane of others ({_names(raised)}): {millimetres}": raised,
        f"faces that overlap larger ones in one plane ({len(lifted)}, of {_names(lifted_of)}): {millimetres}": lifted_of,
        f"sheets that overlap the back of others in one plane ({_names(reversed_)}): black or flickering in path tracing; "
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
    return shows and not any(node in outputs or lit_scene.is_glass(node) for node in nodes)


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


def remove_python_drivers(things: Iterable[bpy.types.Object | None]) -> int:
    """Remove drivers that need Python from objects, their data, shape keys and materials, before
    they are evaluated. Returns their number.
    """
    removed = 0
    for block in {block for thing in things if thing is not None for block in _blocks_of(thing)}:
        animation = getattr(block, "animation_data", None)
        if animation is None:
            continue
        for curve in list(animation.drivers):
            if curve.driver.type == "SCRIPTED" and not curve.driver.is_simple_expression:
                animation.drivers.remove(curve)
                removed += 1
    return removed


def _blocks_of(thing: bpy.types.Object) -> list[bpy.types.ID]:
    data = thing.data
    materials = [slot.material for slot in thing.material_slots if slot.material]
    blocks = [thing, data, getattr(data, "shape_keys", None), getattr(data, "node_tree", None)]
    blocks += [*materials, *(m.node_tree for m in materials)]
    blocks += [m.node_group for m in thing.modifiers if m.type == "NODES"]
    return [block for block in blocks if block is not None]
