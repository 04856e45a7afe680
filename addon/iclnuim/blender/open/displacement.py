"""Displacement by materials, as meshes: the vertices are moved, so that depth is exact."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from bpy.types import Material, Object, Scene

from .. import compat
from ..compat import temporarily
from ..notes import names_of
from ..surfaces import array_of, as_rendered

_ATTRIBUTE = "displaced position"


def displace_meshes(scene: Scene) -> list[str]:
    """Give every object with displacement in its materials a separate mesh, evaluated and
    displaced, also if the object is only instanced. Returns notes.
    """
    adaptive = _without_adaptive_subdivision()
    materials = {m for m in bpy.data.materials if _displaces(m)}
    things = [o for o in bpy.data.objects if o.type == "MESH" and o.users]
    moved = [o for o in things if {s.material for s in o.material_slots} & materials]
    if moved:
        with _in_view(scene, moved):
            as_rendered_meshes(scene, moved)
            with _without_others(moved):
                for thing in moved:
                    _displace(scene, thing)
    for material in materials:
        # the meshes are displaced now, so the material no longer displaces; on objects without a
        # separate mesh it becomes a bump map
        material.displacement_method = "BUMP"
        if all(o in moved for o in bpy.data.objects if material.name in o.material_slots):
            compat.unlink(material.node_tree.get_output_node("CYCLES").inputs["Displacement"])
    if not moved:
        return adaptive
    return [f"displaced surfaces ({names_of(moved)}): moved vertex by vertex", *adaptive]


@contextmanager
def _in_view(scene: Scene, things: list[Object]) -> Iterator[None]:
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
def _without_others(things: list[Object]) -> Iterator[None]:
    """Hide all other objects and instances temporarily: baking identifies an object by its name,
    which its instances share.
    """
    here = set(things)
    with ExitStack() as stack:
        for thing in bpy.data.objects:
            hidden = thing.hide_render or thing not in here
            stack.enter_context(temporarily(thing, hide_render=hidden, instance_type="NONE"))
        yield


def _displaces(material: Material) -> bool:
    if material.node_tree is None or material.displacement_method == "BUMP":
        return False
    output = material.node_tree.get_output_node("CYCLES")
    return output is not None and output.inputs["Displacement"].is_linked


def _without_adaptive_subdivision() -> list[str]:
    """Disable adaptive subdivision: it depends on the camera and would give every frame a different
    surface. Returns a note if an object had it.
    """
    found = []
    for thing in bpy.data.objects:
        for owner in (*thing.modifiers, getattr(thing, "cycles", None)):
            if getattr(owner, "use_adaptive_subdivision", False):
                owner.use_adaptive_subdivision = False
                found.append(thing.name)
    compat.leave_out_experiments(bpy.context.scene)
    if not found:
        return []
    return [f"adaptive subdivision ({names_of(found)}): the levels for rendering are used"]


def as_rendered_meshes(scene: Scene, objects: list[Object]) -> None:
    """Apply the modifiers at the levels for rendering; each object then has its own mesh."""
    made = []
    with as_rendered(scene) as depsgraph:
        for thing in objects:
            evaluated = thing.evaluated_get(depsgraph)
            mesh = bpy.data.meshes.new_from_object(
                evaluated, preserve_all_data_layers=True, depsgraph=depsgraph
            )
            made.append(mesh)
    for thing, mesh in zip(objects, made, strict=True):
        slots = [slot.material for slot in thing.material_slots]
        location = tuple(thing.data.texspace_location)
        size = tuple(thing.data.texspace_size)
        thing.modifiers.clear()
        thing.data = mesh
        # generated coordinates refer to the bounding box before the modifiers
        mesh.use_auto_texspace = False
        mesh.texspace_location = location
        mesh.texspace_size = size
        for slot, material in zip(thing.material_slots, slots, strict=False):
            slot.material = material


def _displace(scene: Scene, thing: Object) -> None:
    """Move vertices to the positions in Cycles' position pass; loose vertices are not moved."""
    thing.hide_set(False)
    mesh = thing.data
    attribute = mesh.color_attributes.new(_ATTRIBUTE, "FLOAT_COLOR", "POINT")
    mesh.color_attributes.active_color = attribute
    bake = {"target": "VERTEX_COLORS", "use_clear": False}
    with (
        temporarily(scene.cycles, samples=1, use_denoising=False),
        temporarily(scene.render, engine="CYCLES"),
        temporarily(scene.render.bake, use_selected_to_active=False, **bake),
    ):
        compat.bake(thing, type="POSITION", **bake)
    places = array_of(mesh.color_attributes[_ATTRIBUTE].data, "color", 4)[:, :3].astype(float)
    to_object = np.linalg.inv(np.array(thing.matrix_world))
    places = places @ to_object[:3, :3].T + to_object[:3, 3]
    mesh.vertices.foreach_set("co", places.astype(np.float32).ravel())
    mesh.color_attributes.remove(mesh.color_attributes[_ATTRIBUTE])
    mesh.update()
