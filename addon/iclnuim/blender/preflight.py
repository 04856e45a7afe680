"""What in the open scene would spoil depth or colour, named before a frame is rendered."""

import bpy
import numpy as np

from . import compat

#: Depth is float32: at this distance from the origin its steps reach about 0.1 mm.
FAR_M = 1000.0
#: Modifiers that move a surface.
_SIMULATED = set(
    ["CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "DYNAMIC_PAINT", "MESH_SEQUENCE_CACHE", "EXPLODE", "BUILD", "WAVE"]
)


def findings(baked: bool) -> list[str]:
    """One plain sentence each, in the open scene; `baked` adds what baked light cannot follow. Changes nothing."""
    scene = bpy.context.scene
    bumps = _bumps() if baked else []
    return [*_camera(scene), *_look(scene), *_surfaces(), *bumps, *_place(scene), *_motion(scene, baked)]


def _camera(scene: bpy.types.Scene) -> list[str]:
    found = []
    if scene.render.use_motion_blur:
        found.append("motion blur is on in the scene: switched off here (it moves Z by millimetres)")
    if scene.camera and scene.camera.type == "CAMERA" and scene.camera.data.dof.use_dof:
        found.append(
            "depth of field is on in the scene's camera: the sequence is rendered without (it moves Z by millimetres)"
        )
    return found


def _look(scene: bpy.types.Scene) -> list[str]:
    view = scene.view_settings
    if (
        view.view_transform not in ("Standard", "Raw")
        or view.look not in ("None", "")
        or view.exposure != 0
        or view.gamma != 1
    ):
        return [
            f"view transform {view.view_transform}, exposure {view.exposure:g}, gamma {view.gamma:g}: not applied, frames hold scene-linear RGB"
        ]
    return []


def _surfaces() -> list[str]:
    glass, mixed = [], []
    for material in bpy.data.materials:
        if not (material.users and material.use_nodes and material.node_tree):
            continue
        kinds = {node.type for node in material.node_tree.nodes}
        principled = [n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"]
        if kinds & {"BSDF_GLASS", "BSDF_REFRACTION"} or any(_used(n, "Transmission Weight", 0.0) for n in principled):
            glass.append(material.name)
        elif any(_used(n, "Alpha", 1.0) for n in principled):
            mixed.append(material.name)
    found = []
    if glass:
        found.append(f"glass ({', '.join(sorted(glass))[:120]}): Z is the depth of the pane")
    if mixed:
        found.append(
            f"partly transparent surfaces ({', '.join(sorted(mixed))[:120]}): Z is that of the nearest one, seen or not"
        )
    return found


def _bumps() -> list[str]:
    """Materials whose shading baked light cannot follow: one value a texel, for the smooth surface."""
    trees = [(m.name, m.node_tree) for m in bpy.data.materials if m.users and m.node_tree]
    found = sorted(name for name, tree in trees if {n.type for n in tree.nodes} & {"NORMAL_MAP", "BUMP"})
    return [f"normal maps or bumps ({', '.join(found)[:120]}): seen in gloss alone by baked light"] if found else []


def _used(node: bpy.types.Node, socket: str, neutral: float) -> bool:
    entry = node.inputs.get(socket)
    return entry is not None and (entry.is_linked or entry.default_value != neutral)


def _place(scene: bpy.types.Scene) -> list[str]:
    corners = [np.array(o.matrix_world) @ (*c, 1.0) for o in scene.objects if o.type == "MESH" for c in o.bound_box]
    far = max((float(np.abs(c[:3]).max()) for c in corners), default=0.0)
    return [f"surfaces {far:.0f} m from the origin: float32 depth loses precision there"] if far > FAR_M else []


def _motion(scene: bpy.types.Scene, baked: bool) -> list[str]:
    moves = moving_names(scene)
    if not moves:
        return []
    consequence = (
        "baked light would be wrong there, path traced light is not"
        if baked
        else "each frame shows them at its own time"
    )
    return [f"objects or lights that move ({', '.join(moves)[:120]}): {consequence}"]


def moving_names(scene: bpy.types.Scene) -> list[str]:
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


def strand_names(scene: bpy.types.Scene) -> list[str]:
    """Objects that render as hair, curves or points, which have no faces for a light map."""
    kinds = {"CURVES", "POINTCLOUD"}
    return sorted(o.name for o in scene.objects if not o.hide_render and (o.type in kinds or _has_particles(o)))


def _has_particles(thing: bpy.types.Object) -> bool:
    return any(m.type == "PARTICLE_SYSTEM" and m.show_render for m in thing.modifiers)


def volume_names(scene: bpy.types.Scene) -> list[str]:
    """Objects with a volume, or with a material or world that has one."""
    filled = {m for m in bpy.data.materials if m.users and m.node_tree and _has_volume(m.node_tree)}
    names = [o.name for o in scene.objects if o.type == "VOLUME" or filled & {s.material for s in o.material_slots}]
    return sorted(names) + (
        ["the sky"] if scene.world and scene.world.node_tree and _has_volume(scene.world.node_tree) else []
    )


def _has_volume(tree: bpy.types.NodeTree) -> bool:
    outputs = [n for n in tree.nodes if n.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD")]
    return any(n.inputs["Volume"].is_linked for n in outputs)


def light_linking_names(scene: bpy.types.Scene) -> list[str]:
    """Lamps and glowing things that light, or are shadowed by, some objects only."""
    linked = [(o.name, getattr(o, "light_linking", None)) for o in scene.objects]
    return sorted(name for name, link in linked if link and (link.receiver_collection or link.blocker_collection))
