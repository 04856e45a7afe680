"""What in the open scene would spoil depth or colour, named before a frame is rendered."""

import bpy
import numpy as np

from . import compat, surfaces

#: Depth is float32: at this distance from the origin its steps reach about 0.1 mm.
FAR_M = 1000.0
#: Modifiers that move a surface.
_SIMULATED = {
    "CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "DYNAMIC_PAINT", "MESH_SEQUENCE_CACHE", "EXPLODE", "BUILD", "WAVE",
}  # fmt: skip


def findings(baked: bool) -> list[str]:
    """One plain sentence each, in the open scene; `baked` adds what baked light cannot follow. Changes nothing."""
    scene, view = bpy.context.scene, bpy.context.scene.view_settings
    glass, mixed, bumps = [], [], []
    for material in (m for m in bpy.data.materials if m.users and m.node_tree):
        kinds = {node.type for node in material.node_tree.nodes}
        principled = [n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"]
        if baked and kinds & {"NORMAL_MAP", "BUMP"}:
            bumps.append(material.name)
        if not material.use_nodes:
            continue
        if kinds & {"BSDF_GLASS", "BSDF_REFRACTION"} or any(_used(n, "Transmission Weight", 0.0) for n in principled):
            glass.append(material.name)
        elif any(_used(n, "Alpha", 1.0) for n in principled):
            mixed.append(material.name)
    lens = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    as_it_is = view.view_transform in ("Standard", "Raw") and view.look in ("None", "")
    as_it_is &= view.exposure == 0 and view.gamma == 1
    transform = f"view transform {view.view_transform}, exposure {view.exposure:g}, gamma {view.gamma:g}"
    corners = [np.array(o.matrix_world) @ (*c, 1.0) for o in scene.objects if o.type == "MESH" for c in o.bound_box]
    far = max((float(np.abs(c[:3]).max()) for c in corners), default=0.0)
    moves = moving_names(scene)
    own_time = (
        "baked light would be wrong there, path traced light is not"
        if baked
        else "each frame shows them at its own time"
    )
    found = {
        "motion blur is on in the scene: switched off here (it moves Z by millimetres)": scene.render.use_motion_blur,
        "depth of field is on in the scene's camera: the sequence is rendered without (it moves Z by millimetres)": lens
        and lens.dof.use_dof,
        f"{transform}: not applied, frames hold scene-linear RGB": not as_it_is,
        f"glass ({_names(glass)}): Z is the depth of the pane": glass,
        f"partly transparent surfaces ({_names(mixed)}): Z is that of the nearest one, seen or not": mixed,
        f"normal maps or bumps ({_names(bumps)}): seen in gloss alone by baked light": bumps,
        f"surfaces {far:.0f} m from the origin: float32 depth loses precision there": far > FAR_M,
        f"objects or lights that move ({', '.join(moves)[:120]}): {own_time}": moves,
    }
    return [sentence for sentence, is_so in found.items() if is_so]


def _names(names: list[str]) -> str:
    return ", ".join(sorted(names))[:120]


def _used(node: bpy.types.Node, socket: str, neutral: float) -> bool:
    entry = node.inputs.get(socket)
    return entry is not None and (entry.is_linked or entry.default_value != neutral)


def moving_names(scene: bpy.types.Scene) -> list[str]:
    """Of objects and lights that move or change, in order; cameras left out, the world as `the sky`."""
    shown = [o for o in scene.objects if o.type != "CAMERA" and not o.hide_render]
    moving = {o.name for o in shown if (o.type != "EMPTY" or o.instance_collection) and _moves(o, set())}
    materials = [m for m in bpy.data.materials if m.users and m.node_tree]
    films = {
        m
        for m in materials
        for n in m.node_tree.nodes
        if n.type in ("TEX_IMAGE", "TEX_ENVIRONMENT") and n.image and n.image.source in ("MOVIE", "SEQUENCE")
    }
    changing = {m.name for m in materials if _varies(m) or _varies(m.node_tree) or m in films}
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
    bones = [m.object for m in thing.modifiers if m.type == "ARMATURE" and m.object]
    if any(m.type in _SIMULATED for m in thing.modifiers) or any(map(_varies, bones)):
        return True
    others = [thing.parent, *(getattr(c, "target", None) for c in thing.constraints if not c.mute)]
    others += [getattr(m, "object", None) for m in thing.modifiers]
    if thing.instance_collection is not None:
        others += [o for o in thing.instance_collection.all_objects if o.type != "CAMERA"]
    return any(other is not None and _moves(other, seen) for other in others)


def _varies(block: bpy.types.ID | None) -> bool:
    """An action whose curves are not constant, a strip, or a driver."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return False
    actions = [animation.action, *(strip.action for track in animation.nla_tracks for strip in track.strips)]
    return len(animation.drivers) > 0 or any(
        _spread(c) > 1e-6 for action in actions if action for c in compat.curves_of(action)
    )


def _spread(curve: bpy.types.FCurve) -> float:
    if len(curve.modifiers):
        return float("inf")
    values = [point.co[1] for point in curve.keyframe_points]
    return max(values) - min(values) if values else 0.0


def strand_names(scene: bpy.types.Scene) -> list[str]:
    """Objects that render as hair, curves or points, which have no faces for a light map."""
    shown = [o for o in scene.objects if not o.hide_render]
    hairy = {o for o in shown for m in o.modifiers if m.type == "PARTICLE_SYSTEM" and m.show_render}
    strands = [o for o in shown if o.type in ("CURVES", "POINTCLOUD")]
    if any(m.type == "NODES" for o in strands for m in o.modifiers):
        with surfaces.as_rendered(scene) as depsgraph:
            strands = [o for o in strands if not _is_instances(o.evaluated_get(depsgraph))]
    return sorted(o.name for o in {*strands, *hairy})


def _is_instances(evaluated: bpy.types.Object) -> bool:
    """Whether nothing but instances is left of an evaluated object; asked of Blender 4.5 and later."""
    if not hasattr(evaluated, "evaluated_geometry"):
        return False
    geometry = evaluated.evaluated_geometry()
    return not any((geometry.mesh, geometry.curves, geometry.pointcloud, geometry.volume))


def volume_names(scene: bpy.types.Scene) -> list[str]:
    """Objects with a volume, or with a material or world that has one."""
    filled = {m for m in bpy.data.materials if m.users and m.node_tree and _has_volume(m.node_tree)}
    things = {*scene.objects, *(o for c in bpy.data.collections for o in c.all_objects)}  # instanced ones too
    names = [o.name for o in things if o.type == "VOLUME" or filled & {s.material for s in o.material_slots}]
    sky = scene.world and scene.world.node_tree and _has_volume(scene.world.node_tree)
    return [*sorted(names), *(["the sky"] if sky else [])]


def _has_volume(tree: bpy.types.NodeTree) -> bool:
    outputs = [n for n in tree.nodes if n.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD")]
    return any(n.inputs["Volume"].is_linked for n in outputs)


def light_linking_names(scene: bpy.types.Scene) -> list[str]:
    """Lamps and glowing things that light, or are shadowed by, some objects only."""
    linked = [(o.name, getattr(o, "light_linking", None)) for o in scene.objects]
    return sorted(name for name, link in linked if link and (link.receiver_collection or link.blocker_collection))
