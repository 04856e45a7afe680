"""Finds what moves in the open scene: baked light cannot follow it."""

from __future__ import annotations

import bpy

from . import compat

_SIMULATED = {
    "CLOTH",
    "SOFT_BODY",
    "FLUID",
    "OCEAN",
    "DYNAMIC_PAINT",
    "MESH_SEQUENCE_CACHE",
    "EXPLODE",
    "BUILD",
    "WAVE",
}


def names(scene: bpy.types.Scene) -> list[str]:
    """Of objects and lights that move or change, in order; cameras left out, the world as `the sky`."""
    shown = [o for o in scene.objects if o.type != "CAMERA" and not o.hide_render]
    moving = {o.name for o in shown if (o.type != "EMPTY" or o.instance_collection) and _moves(o, set())}
    materials = [m for m in bpy.data.materials if m.users and m.node_tree]
    changing = {m.name for m in materials if _varies(m) or _varies(m.node_tree) or _films(m.node_tree)}
    sky = scene.world is not None and (_varies(scene.world) or _varies(scene.world.node_tree))
    return [*sorted(moving | changing), *(["the sky"] if sky else [])]


def _moves(thing: bpy.types.Object, seen: set[bpy.types.Object]) -> bool:
    """By itself, its data, its shape keys, its simulation, or what it hangs on."""
    if thing in seen:
        return False
    seen.add(thing)
    data = [thing, thing.data, getattr(thing.data, "shape_keys", None), getattr(thing.data, "node_tree", None)]
    if any(_varies(block) for block in data) or thing.rigid_body is not None:
        return thing.rigid_body is None or thing.rigid_body.type == "ACTIVE" or any(_varies(b) for b in data)
    if any(m.type in _SIMULATED for m in thing.modifiers) or any(b for b in _bones(thing) if _varies(b)):
        return True
    others = [thing.parent, *(getattr(c, "target", None) for c in thing.constraints if not c.mute)]
    others += [getattr(m, "object", None) for m in thing.modifiers]
    return any(other is not None and _moves(other, seen) for other in others) or _instances_move(thing, seen)


def _instances_move(thing: bpy.types.Object, seen: set[bpy.types.Object]) -> bool:
    collection = thing.instance_collection
    return collection is not None and any(_moves(o, seen) for o in collection.all_objects if o.type != "CAMERA")


def _bones(thing: bpy.types.Object) -> list[bpy.types.Object]:
    return [m.object for m in thing.modifiers if m.type == "ARMATURE" and m.object]


def _varies(block: bpy.types.ID | None) -> bool:
    """An action whose curves are not constant, a strip, or a driver."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return False
    actions = [animation.action, *(strip.action for track in animation.nla_tracks for strip in track.strips)]
    return len(animation.drivers) > 0 or any(_changes(action) for action in actions if action)


def _changes(action: bpy.types.Action) -> bool:
    return any(_spread(curve) > 1e-6 for curve in compat.curves_of(action))


def _spread(curve: bpy.types.FCurve) -> float:
    if len(curve.modifiers):
        return float("inf")
    values = [point.co[1] for point in curve.keyframe_points]
    return max(values) - min(values) if values else 0.0


def _films(tree: bpy.types.NodeTree) -> bool:
    """Textures that are films or change with the frame."""
    pictures = [n.image for n in tree.nodes if n.type in ("TEX_IMAGE", "TEX_ENVIRONMENT") and n.image]
    return any(picture.source in ("MOVIE", "SEQUENCE") for picture in pictures)
