"""Displacement by materials put into the meshes, vertex by vertex, as Cycles itself displaces them.

So frames, light map and every independent judge see the same surface. Cycles is asked for the displaced positions by baking them
into vertices; the file is changed in memory only.
"""

from __future__ import annotations

import io
from contextlib import ExitStack, redirect_stdout

import bpy
import numpy as np

from ..errors import WorkError
from . import compat
from .light_points import kept

_ATTRIBUTE = "displaced position"


def put_into_meshes(scene: bpy.types.Scene) -> list[str]:
    """Every object of the scene whose materials displace gets a mesh of its own, evaluated and displaced."""
    materials = {m for m in bpy.data.materials if _displaces(m)}
    adaptive = _without_adaptive_subdivision(scene)
    moved = [
        o
        for o in scene.objects
        if o.type == "MESH" and not o.hide_render and {s.material for s in o.material_slots} & materials
    ]
    if moved:
        _as_rendered_meshes(moved)
        _displace(scene, moved)
    for material in materials:
        _flatten(material, {o for o in moved})
    found = (
        [f"displaced surfaces ({', '.join(sorted(o.name for o in moved))[:120]}): moved vertex by vertex"]
        if moved
        else []
    )
    return [*found, *adaptive]


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
    return (
        [f"adaptive subdivision ({', '.join(sorted(found))[:120]}): the levels for rendering are used"] if found else []
    )


def _as_rendered_meshes(objects: list[bpy.types.Object]) -> None:
    """Modifiers applied at the levels for rendering; each object owns its mesh then."""
    with ExitStack() as stack:
        for modifier in (m for o in objects for m in o.modifiers):
            stack.enter_context(kept(modifier, show_viewport=modifier.show_render))
            if hasattr(modifier, "render_levels"):
                stack.enter_context(kept(modifier, levels=modifier.render_levels))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        made = [
            bpy.data.meshes.new_from_object(
                o.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
            )
            for o in objects
        ]
    for thing, mesh in zip(objects, made, strict=True):
        slots = [slot.material for slot in thing.material_slots]
        thing.modifiers.clear()
        thing.data = mesh
        for slot, material in zip(thing.material_slots, slots, strict=False):
            slot.material = material


def _displace(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    for thing in objects:
        thing.hide_viewport = False
        thing.hide_set(False)
        mesh = thing.data
        layer = mesh.color_attributes.new(_ATTRIBUTE, "FLOAT_COLOR", "POINT")
        mesh.color_attributes.active_color = layer
        places = _baked(scene, thing, layer)
        to_object = np.linalg.inv(np.array(thing.matrix_world))
        places = places @ to_object[:3, :3].T + to_object[:3, 3]
        mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
        mesh.color_attributes.remove(mesh.color_attributes[_ATTRIBUTE])
        mesh.update()


def _baked(scene: bpy.types.Scene, thing: bpy.types.Object, layer: bpy.types.Attribute) -> np.ndarray:
    """(n, 3) the displaced vertices in the world, as Cycles' position pass has them; loose ones stay."""
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing
    with (
        kept(scene.cycles, samples=1, use_denoising=False),
        kept(scene.render, engine="CYCLES"),
        kept(scene.render.bake, target="VERTEX_COLORS", use_clear=False, use_selected_to_active=False),
    ):
        try:
            with redirect_stdout(io.StringIO()):
                bpy.ops.object.bake(type="POSITION", target="VERTEX_COLORS", use_clear=False)
        except RuntimeError as error:
            raise WorkError(
                f"{thing.name}: its displacement cannot be evaluated: {' '.join(str(error).split())}"
            ) from None
    values = np.empty(len(thing.data.vertices) * 4, np.float32)
    thing.data.color_attributes[_ATTRIBUTE].data.foreach_get("color", values)
    return values.reshape(-1, 4)[:, :3].astype(float)


def _flatten(material: bpy.types.Material, moved: set[bpy.types.Object]) -> None:
    """What the meshes hold now, the material no longer does; where it displaces things that have no own mesh it becomes a bump."""
    material.displacement_method = "BUMP"
    users = [o for o in bpy.data.objects if material.name in o.material_slots]
    if all(o in moved for o in users):
        socket = material.node_tree.get_output_node("CYCLES").inputs["Displacement"]
        for link in list(socket.links):
            material.node_tree.links.remove(link)
