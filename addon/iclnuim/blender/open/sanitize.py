"""Repairs a user-provided scene so that it can be rendered: invalid numbers, missing images, vertex
colours without a material, drivers written in Python.

Everything is done in memory.
"""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import bmesh
import bpy
import numpy as np

from .. import compat
from ..notes import names_of
from ..surfaces import array_of

#: Larger coordinates are treated as invalid: float32 cannot represent millimetres there.
_MAX_COORDINATE = 1e7
#: A face with less area than this (file units squared) is degenerate: a line or a point.
_MIN_AREA = 1e-14


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
        f"objects without a valid position ({names_of(lost)}): left out": lost,
        f"{gone} vertices have NaN or coordinates beyond {_MAX_COORDINATE:.0e}: left out with their faces": gone,
        f"{repaired} meshes had faces with missing vertices, or duplicate faces: these faces are left out": repaired,
        f"{flat} faces have no area: no ray hits them": flat,
        f"{texture} texture coordinates are NaN or infinite: set to 0": texture,
        f"textures that are missing or broken ({images}): replaced by plain colour": images,
        "surfaces without a material show the colours of their vertices": coloured,
        f"scripts in the file ({names_of(scripts)}): not run": scripts,
    }
    return [sentence for sentence, is_so in found.items() if is_so]


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
    names = names_of(missing)
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
