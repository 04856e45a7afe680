"""Repairs a user-provided scene so that it can be rendered: invalid numbers, vertex colours
without a material, drivers written in Python.

Everything is done in memory.
"""

from collections.abc import Iterable, Iterator

import bmesh
import bpy
import numpy as np
from bpy.types import ID, FCurve, Material, Mesh, MeshUVLoopLayer, Scene

from .. import compat
from ..notes import names_of
from ..surfaces import array_of

#: Larger coordinates are treated as invalid: float32 cannot represent millimetres there.
_MAX_COORDINATE = 1e7


def sanitize(scene: Scene) -> list[str]:
    """Repair all meshes and materials of the open session. Returns what was done."""
    notes = [*_hide_lost_objects(scene), *_repair_meshes()]
    if _show_vertex_colours(scene):
        notes.append("surfaces without a material show the colours of their vertices or faces")
    scripts = [text for text in bpy.data.texts if text.use_module]
    if scripts:
        notes.append(f"scripts in the file ({names_of(scripts)}): not run")
    if driven := {block for block, _ in _python_drivers(bpy.data.user_map())}:
        notes.append(f"drivers that need Python ({names_of(driven)}): not run")
    return notes


def _hide_lost_objects(scene: Scene) -> list[str]:
    lost = [o for o in scene.objects if not np.isfinite(np.array(o.matrix_world)).all()]
    if not lost:
        return []
    for thing in lost:
        thing.hide_render = True
        thing.hide_viewport = True
    return [f"objects without a valid position ({names_of(lost)}): left out"]


def _repair_meshes() -> list[str]:
    vertices = meshes = texture = 0
    for mesh in bpy.data.meshes:
        vertices += _remove_lost_vertices(mesh)
        meshes += bool(mesh.validate(clean_customdata=False))
        texture += sum(map(_reset_texture_coordinates, mesh.uv_layers))
    notes = []
    if vertices:
        problem = f"{vertices} vertices have NaN or coordinates beyond {_MAX_COORDINATE:.0e}"
        notes.append(f"{problem}: left out with their faces")
    if meshes:
        problem = f"{meshes} meshes had faces with missing vertices, or duplicate faces"
        notes.append(f"{problem}: these faces are left out")
    if texture:
        notes.append(f"{texture} texture coordinates are NaN or infinite: set to 0")
    return notes


def _reset_texture_coordinates(layer: MeshUVLoopLayer) -> int:
    """Set invalid coordinates to 0. Returns their number."""
    uv = array_of(layer.data, "uv", 2).ravel()
    wrong = ~np.isfinite(uv)
    if wrong.any():
        layer.data.foreach_set("uv", np.where(wrong, 0.0, uv).astype(np.float32))
    return int(wrong.sum())


def _remove_lost_vertices(mesh: Mesh) -> int:
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


def _show_vertex_colours(scene: Scene) -> bool:
    """Show the vertex colours of meshes without any material, such as a scan as PLY.

    Returns whether there are any.
    """
    found = False
    for thing in scene.objects:
        if thing.type != "MESH" or any(slot.material for slot in thing.material_slots):
            continue
        if thing.data.color_attributes:
            found = True
            thing.data.materials.clear()
            thing.data.materials.append(_colour_material(thing.data.color_attributes[0].name))
    return found


def _colour_material(attribute: str) -> Material:
    """A material that shows a colour attribute; one for each name of an attribute."""
    name = f"colours of {attribute}"
    material = bpy.data.materials.get(name)
    if material is None:
        material, matt = compat.matt_material(name)
        source = material.node_tree.nodes.new("ShaderNodeAttribute")
        source.attribute_name = attribute
        material.node_tree.links.new(source.outputs["Color"], matt.inputs["Color"])
    return material


def remove_python_drivers(blocks: Iterable[ID]) -> None:
    """Remove drivers that need Python from datablocks, before they are evaluated."""
    for block, curve in list(_python_drivers(blocks)):
        block.animation_data.drivers.remove(curve)


def _python_drivers(blocks: Iterable[ID]) -> Iterator[tuple[ID, FCurve]]:
    """The drivers that need Python, with the datablocks or node trees that have them."""
    for block in blocks:
        for owner in (block, getattr(block, "node_tree", None)):
            animation = getattr(owner, "animation_data", None)
            for curve in animation.drivers if animation else ():
                if curve.driver.type == "SCRIPTED" and not curve.driver.is_simple_expression:
                    yield owner, curve
