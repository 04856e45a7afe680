"""Makes a scene that came from outside safe to render: broken numbers, missing pictures, colours that only vertices carry, displacement
by materials, drivers written in Python.

All in memory. Functions that return sentences say what was found and done.
"""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector

from . import compat, lit_scene, preflight
from .compat import temporarily
from .surfaces import array_of, as_rendered

_ATTRIBUTE = "displaced position"
#: Coordinates beyond this are as good as no number: float32 has no millimetres there.
_MAX_COORDINATE = 1e7
#: A face of less area than this (file units squared) is a line or a point.
_MIN_AREA = 1e-14
#: Corners nearer than this are in one place; so many of the faces in one place are looked at, whether they can be seen.
_SAME_PLACE_M, _PROBES = 1e-5, 64
#: What lies in the plane of another object with this share of its surface goes so far in front of it. Less area, and more pairs than
#: these, are not looked at.
_LARGE, _RAISED_M, _SMALLEST_M2, _PAIRS = 0.1, 5e-5, 1e-4, 2000


def sanitize(scene: bpy.types.Scene) -> list[str]:
    """All of it, on the open session."""
    lost = [o for o in scene.objects if not np.isfinite(np.array(o.matrix_world)).all()]
    for thing in lost:  # where no numbers say where it stands
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
        f"objects without a place ({_names(lost)}): left out": lost,
        f"{gone} vertices are no numbers or farther than {_MAX_COORDINATE:.0e}: left out with their faces": gone,
        f"{repaired} meshes named vertices that are not there, or faces twice: such faces are left out": repaired,
        f"{flat} faces have no area: no ray meets them": flat,
        f"{texture} texture coordinates are no numbers: taken as 0": texture,
        f"textures that are missing or broken ({images}): plain colour in their place": images,
        "surfaces without a material show the colours of their vertices": coloured,
        f"scripts in the file ({_names(scripts)}): not run": scripts,
    }
    return [sentence for sentence, is_so in found.items() if is_so]


def without_false_glass(path: Path) -> list[str]:
    """Materials of the OBJ at `path` that `Tf` alone makes glass are opaque: 3ds Max writes `Tf 1 1 1` for all, with `d 1` and `illum 2`."""
    named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    libraries = {path.parent / os.fsdecode(name).strip('"') for name in named} | {path.with_suffix(".mtl")}
    texts = [library.read_text("utf-8", "replace") for library in sorted(libraries) if library.is_file()]
    opaque = []
    for block in (block for text in texts for block in re.split(r"^\s*newmtl[ \t]+", text, flags=re.MULTILINE)[1:]):
        name, *lines = block.splitlines()
        values = {word.lower(): rest for word, *rest in (line.split() for line in lines if line.strip())}
        solid = values.get("illum") in (["0"], ["1"], ["2"]) and re.fullmatch(r"1(\.0*)?", values.get("d", ["1"])[-1])
        material = bpy.data.materials.get(name.strip()[:63]) if solid and "tf" in values else None
        for node in material.node_tree.nodes if material else ():
            if node.type == "BSDF_PRINCIPLED" and node.inputs["Transmission Weight"].default_value > 0:
                node.inputs["Transmission Weight"].default_value = 0.0
                opaque.append(material)
    return [f"Tf of opaque materials ({_names(opaque)}): not taken for glass"] if opaque else []


def _without_lost_vertices(mesh: bpy.types.Mesh) -> int:
    places = array_of(mesh.vertices, "co", 3)
    lost = np.flatnonzero(~(np.abs(places) < _MAX_COORDINATE).all(1))
    if len(lost):
        # far away first: deleting walks over edges whose length must be a number
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
    """Pictures that are not there, or cannot be read, are taken out of the materials: their plain values show, not magenta. Their names."""
    missing = [image for image in bpy.data.images if _is_missing(image)]
    owners = [*bpy.data.materials, *bpy.data.worlds, *bpy.data.lights]
    trees = [*bpy.data.node_groups, *(block.node_tree for block in owners if block.node_tree is not None)]
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
            return not any(Path(bpy.path.abspath(image.filepath, library=image.library)).parent.glob("*"))
        return not (image.size[0] and image.size[1])
    return True


def _show_vertex_colours(scene: bpy.types.Scene) -> bool:
    """Whether meshes without any material carry colours (a scan as PLY): they show them then."""
    bare = [o for o in scene.objects if o.type == "MESH" and not any(s.material for s in o.material_slots)]
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
    """Every object of the scene whose materials displace gets a mesh of its own, evaluated and displaced."""
    materials = {m for m in bpy.data.materials if _displaces(m)}
    adaptive = _without_adaptive_subdivision(scene)
    shown = [o for o in scene.objects if o.type == "MESH" and not o.hide_render]
    moved = [o for o in shown if {s.material for s in o.material_slots} & materials]
    if moved:
        _as_rendered_meshes(scene, moved)
        for thing in moved:
            _displace(scene, thing)
    for material in materials:
        # what the meshes hold now, the material no longer does; where it displaces things that have no own mesh it becomes a bump
        material.displacement_method = "BUMP"
        if all(o in moved for o in bpy.data.objects if material.name in o.material_slots):
            compat.unlink(material.node_tree.get_output_node("CYCLES").inputs["Displacement"])
    names = ", ".join(sorted(o.name for o in moved))[:120]
    return [*([f"displaced surfaces ({names}): moved vertex by vertex"] if moved else []), *adaptive]


def _displaces(material: bpy.types.Material) -> bool:
    if material.node_tree is None or material.displacement_method == "BUMP":
        return False
    output = material.node_tree.get_output_node("CYCLES")
    return output is not None and output.inputs["Displacement"].is_linked


def _without_adaptive_subdivision(scene: bpy.types.Scene) -> list[str]:
    """Dicing by the camera would give every frame another surface."""
    found = []
    for thing in scene.objects:
        for owner in (*thing.modifiers, getattr(thing, "cycles", None)):
            if getattr(owner, "use_adaptive_subdivision", False):
                owner.use_adaptive_subdivision = False
                found.append(thing.name)
    compat.leave_out_experiments(scene)
    names = ", ".join(sorted(found))[:120]
    return [f"adaptive subdivision ({names}): the levels for rendering are used"] if found else []


def _as_rendered_meshes(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    """Modifiers applied at the levels for rendering; each object owns its mesh then."""
    with as_rendered(scene) as depsgraph:
        kept = {"preserve_all_data_layers": True, "depsgraph": depsgraph}
        made = [bpy.data.meshes.new_from_object(o.evaluated_get(depsgraph), **kept) for o in objects]
    for thing, mesh in zip(objects, made, strict=True):
        slots = [slot.material for slot in thing.material_slots]
        thing.modifiers.clear()
        thing.data = mesh
        for slot, material in zip(thing.material_slots, slots, strict=False):
            slot.material = material


def _displace(scene: bpy.types.Scene, thing: bpy.types.Object) -> None:
    """Vertices go where Cycles' position pass has them; loose ones stay."""
    thing.hide_viewport = False
    thing.hide_set(False)
    mesh = thing.data
    mesh.color_attributes.active_color = mesh.color_attributes.new(_ATTRIBUTE, "FLOAT_COLOR", "POINT")
    with (
        temporarily(scene.cycles, samples=1, use_denoising=False),
        temporarily(scene.render, engine="CYCLES"),
        temporarily(scene.render.bake, target="VERTEX_COLORS", use_clear=False, use_selected_to_active=False),
    ):
        compat.bake(thing, type="POSITION", target="VERTEX_COLORS", use_clear=False)
    places = array_of(mesh.color_attributes[_ATTRIBUTE].data, "color", 4)[:, :3].astype(float)
    to_object = np.linalg.inv(np.array(thing.matrix_world))
    places = places @ to_object[:3, :3].T + to_object[:3, 3]
    mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
    mesh.color_attributes.remove(mesh.color_attributes[_ATTRIBUTE])
    mesh.update()


def remove_coincident_faces(scene: bpy.types.Scene) -> list[str]:
    """Of equal faces in one place, the first stays, and objects that overlap larger ones in one plane are moved in front of them: each
    face would shade the other, and Cycles shows both black. What moves is left alone, as are glass, volumes, instances, and faces that
    nobody sees, between boxes that touch.
    """
    moving = set(preflight.moving_names(scene))
    with as_rendered(scene) as depsgraph:
        shown = [i.object for i in depsgraph.object_instances if i.show_self and not i.is_instance]
        things = [t for t in shown if t.type == "MESH" and t.name not in moving and _is_opaque(t.original)]
        faces = [_faces_in_world(thing) for thing in things]
        if not faces:
            return []
        keys, centres_m, normals, area_m2 = (np.concatenate([f[k] for f in faces]) for k in range(4))
        again = np.setdiff1d(np.flatnonzero(keys), np.unique(keys, return_index=True)[1])
        starts = np.cumsum([0, *(len(f[0]) for f in faces)])
        owner = np.repeat(np.arange(len(things)), np.diff(starts))
        again = again[np.bincount(owner[again], area_m2[again], len(things))[owner[again]] > _SMALLEST_M2]
        _, first, group = np.unique(keys, return_index=True, return_inverse=True)
        turned = keys[again[(normals[again] * normals[first][group[again]]).sum(1) < 0]]

        def is_seen(row: int, way: np.ndarray) -> bool:
            """Whether the way from a face leads out of the two objects that share it, not through one of them to a back."""
            for k in (owner[row], owner[first[group[row]]]):
                hit = _cast(depsgraph, things[k], centres_m[row] + 10 * _SAME_PLACE_M * way, way, 1e4)
                if hit is not None and (hit[1].dot(Vector(way)) > 0 or keys[starts[k] + hit[2]] in turned):
                    return False
            return True

        picked = again[np.linspace(0, len(again) - 1, min(len(again), _PROBES)).astype(int)]
        if not any(is_seen(k, sign * normals[k]) for k in picked for sign in (1, -1)):
            again = again[:0]
        rows = {
            t.original: again[(again >= a) & (again < b)] - a
            for t, a, b in zip(things, starts[:-1], starts[1:], strict=True)
        }
        raised: dict[bpy.types.Object, Vector] = {}
        for face, over in _in_one_plane(owner, centres_m, normals, area_m2):
            one, other = things[owner[face]].original, things[over]
            if one in raised or other.original in raised or face in again:
                continue
            place_m, way, reach_m = centres_m[face], normals[face], 10 * _SAME_PLACE_M
            hit = _cast(depsgraph, other, place_m + reach_m * way, -way, 2 * reach_m)
            if hit is None or hit[1].dot(Vector(way)) < 0.999 or np.linalg.norm(hit[0] - place_m) > _SAME_PLACE_M:
                continue
            # a box on the floor is no sheet: one of the ways leads through it
            ways = (sign * way for sign in (1, -1))
            if all(_cast(depsgraph, things[owner[face]], place_m + reach_m * w, w, 1e4) is None for w in ways):
                raised[one] = hit[1] * _RAISED_M
    for thing, way in raised.items():
        thing.matrix_world = Matrix.Translation(way) @ thing.matrix_world
    rows = {thing: found for thing, found in rows.items() if len(found)}
    _as_rendered_meshes(scene, list(rows))
    for thing, found in rows.items():
        edited = bmesh.new()
        edited.from_mesh(thing.data)
        edited.faces.ensure_lookup_table()
        bmesh.ops.delete(edited, geom=[edited.faces[int(k)] for k in found], context="FACES_ONLY")
        edited.to_mesh(thing.data)
        edited.free()
    black = "for Cycles shows both black"
    notes = {
        f"faces that lie exactly on others ({len(again)}, of {_names(rows)}): left out, {black}": rows,
        f"sheets that lie in the plane of others ({_names(raised)}): moved by {_RAISED_M * 1e3:g} mm, {black}": raised,
    }
    return [sentence for sentence, is_so in notes.items() if is_so]


def _in_one_plane(
    owner: np.ndarray, centres_m: np.ndarray, normals: np.ndarray, area_m2: np.ndarray
) -> Iterator[tuple[int, int]]:
    """Faces, the largest of its object (F,) in its plane, and other objects with larger faces in that plane; not all of very many."""
    sign = np.sign(np.take_along_axis(normals, np.abs(normals).argmax(1)[:, None], 1))
    offset_m = (sign * normals * centres_m).sum(1)
    plane = _mixed(np.column_stack([np.round(sign * normals * 1e4), np.round(offset_m / _SAME_PLACE_M)]))
    order = np.lexsort((-area_m2, owner, plane))
    order = order[(area_m2 > _SMALLEST_M2)[order] & (area_m2 > _LARGE * np.bincount(owner, area_m2)[owner])[order]]
    new = np.any([np.diff(a[order], prepend=a[order][:1] + 1) != 0 for a in (plane, owner)], axis=0)
    largest = order[new]  # of each object in each plane
    groups = np.split(largest, np.flatnonzero(np.diff(plane[largest])) + 1)
    pairs = [(a, owner[b]) for g in groups if 1 < len(g) <= _PROBES for a in g for b in g if area_m2[a] < area_m2[b]]
    yield from pairs[:: 1 + len(pairs) // _PAIRS]


def _cast(
    depsgraph: bpy.types.Depsgraph, thing: bpy.types.Object, start_m: np.ndarray, way: np.ndarray, reach_m: float
) -> tuple[np.ndarray, Vector, int] | None:
    """What a ray in the world meets of one object: place (3,) in metres, unit normal, face; None for nothing."""
    inverse, matrix = thing.matrix_world.inverted_safe(), thing.matrix_world
    step = inverse.to_3x3() @ Vector(reach_m * way)
    if not step.length:
        return None
    start = inverse @ Vector(start_m)
    hit, place, normal, face = thing.ray_cast(start, step.normalized(), distance=step.length, depsgraph=depsgraph)
    return (np.array(matrix @ place), (inverse.to_3x3().transposed() @ normal).normalized(), face) if hit else None


def _mixed(numbers: np.ndarray) -> np.ndarray:
    """(n,) uint64 hashes of rows (n, up to 4) of whole numbers."""
    with np.errstate(over="ignore"):
        factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64)
        mixed = (numbers.astype(np.int64).astype(np.uint64) * factors[: numbers.shape[1]]).sum(1)
        mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        return mixed ^ (mixed >> np.uint64(32))


def _is_opaque(thing: bpy.types.Object) -> bool:
    """And fully visible, and ours to change."""
    trees = [slot.material.node_tree for slot in thing.material_slots if slot.material and slot.material.node_tree]
    outputs = set(compat.volume_outputs())
    nodes = [node for tree in trees for node in compat.nodes_of(tree)]
    shows = thing.library is None and thing.visible_camera and thing.visible_shadow and not thing.hide_render
    return shows and not any(node in outputs or lit_scene.is_glass(node) for node in nodes)


def _faces_in_world(thing: bpy.types.Object) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of an evaluated mesh: keys (F,), equal for faces with the same corners in any order, 0 for faces without area; (F, 3) centres in
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
    """Remove drivers that need Python from objects, their data, shape keys and materials, before they are evaluated; how many."""
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
