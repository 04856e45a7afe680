"""Checks of the open scene before rendering: properties that affect depth or colour."""

import math

import bpy
import numpy as np

from .. import compat, surfaces

#: Depth is float32: at this distance from the origin its resolution is about 0.1 mm.
FAR_M = 1000.0
#: Modifiers that move a surface.
_SIMULATED = {
    "CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "DYNAMIC_PAINT", "MESH_SEQUENCE_CACHE", "EXPLODE", "BUILD", "WAVE",
}  # fmt: skip
#: Diffuse shaders that baked light cannot replace; maximum number of UV maps, so that two more for
#: the light map are possible.
_NO_LIGHT_MAP, _MAX_UV_MAPS = {"BSDF_TOON", "BSDF_SHEEN"}, 6


def findings(baked: bool) -> list[str]:
    """The findings in the open scene, one sentence each.

    `baked` includes limitations of baked light. Nothing is changed.
    """
    scene, view = bpy.context.scene, bpy.context.scene.view_settings
    glass, mixed, bumps = [], [], []
    for material in (m for m in bpy.data.materials if m.users and m.node_tree):
        kinds = {node.type for node in material.node_tree.nodes}
        principled = [n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"]
        if baked and kinds & {"NORMAL_MAP", "BUMP"}:
            bumps.append(material.name)
        if not material.use_nodes:
            continue
        if kinds & {"BSDF_GLASS", "BSDF_REFRACTION"} or any(
            _used(n, "Transmission Weight", 0.0) for n in principled
        ):
            glass.append(material.name)
        elif any(_used(n, "Alpha", 1.0) for n in principled):
            mixed.append(material.name)
    lens = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    as_it_is = view.view_transform in ("Standard", "Raw") and view.look in ("None", "")
    as_it_is &= view.exposure == 0 and view.gamma == 1
    transform = (
        f"view transform {view.view_transform}, exposure {view.exposure:g}, gamma {view.gamma:g}"
    )
    corners = [
        np.array(o.matrix_world) @ (*c, 1.0)
        for o in scene.objects
        if o.type == "MESH"
        for c in o.bound_box
    ]
    far = max((float(np.abs(c[:3]).max()) for c in corners), default=0.0)
    moves = moving_names(scene)
    own_time = (
        "baked light would be wrong there; path tracing is correct"
        if baked
        else "each frame shows them at its own time"
    )
    found = {
        "motion blur is on in the scene: it is disabled here (it changes Z by millimetres)": scene.render.use_motion_blur,
        "depth of field is on in the scene's camera: it is disabled here (it changes Z by millimetres)": lens
        and lens.dof.use_dof,
        f"{transform}: not applied, frames contain scene-linear RGB": not as_it_is,
        f"glass ({_names(glass)}): Z is the depth of the pane": glass,
        f"partly transparent surfaces ({_names(mixed)}): Z is that of the nearest surface, visible or not": mixed,
        f"normal maps or bumps ({_names(bumps)}): with baked light visible only in gloss": bumps,
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
    """Names of objects and lights that move or change, in order, without cameras; the world is `the
    sky`.
    """
    shown = [o for o in scene.objects if o.type != "CAMERA" and (not o.hide_render or _varies(o))]
    moving = {
        o.name for o in shown if (o.type != "EMPTY" or o.instance_collection) and _moves(o, set())
    }
    materials = [m for m in bpy.data.materials if m.users and m.node_tree]
    films = {
        m
        for m in materials
        for n in compat.nodes_of(m.node_tree)
        if n.type in ("TEX_IMAGE", "TEX_ENVIRONMENT")
        and n.image
        and n.image.source in ("MOVIE", "SEQUENCE")
    }
    changing = {
        m.name for m in materials if _varies(m) or _varies_inside(m.node_tree) or m in films
    }
    sky = scene.world is not None and (
        _varies(scene.world) or _varies_inside(scene.world.node_tree)
    )
    return [*sorted(moving | changing | _timed_names(scene)), *(["the sky"] if sky else [])]


def _timed_names(scene: bpy.types.Scene) -> set[str]:
    """Objects whose geometry depends on the frame although they are not animated, for example by
    Scene Time in Geometry Nodes.

    Scenes with simulations are not evaluated: they would lose their state.
    """
    if scene.rigidbody_world or any(
        m.type in _SIMULATED for o in bpy.data.objects for m in o.modifiers
    ):
        return set()
    found: set[bpy.types.Object] = set()

    def note(_: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        found.update(u.id.original for u in depsgraph.updates if u.is_updated_geometry)

    before = scene.frame_current_final
    with surfaces.as_rendered(scene):
        bpy.app.handlers.frame_change_post.append(note)
        try:
            scene.frame_set(scene.frame_current + 1)
        finally:
            bpy.app.handlers.frame_change_post.remove(note)
            scene.frame_set(math.floor(before), subframe=before % 1)
    return {
        o.name
        for o in found
        if isinstance(o, bpy.types.Object) and not any(map(_is_animated, _blocks(o)))
    }


def _blocks(thing: bpy.types.Object) -> list[bpy.types.ID | None]:
    """The datablocks that may change an object's shape."""
    bones = [m.object for m in thing.modifiers if m.type == "ARMATURE"]
    return [thing, thing.data, getattr(thing.data, "shape_keys", None), *bones]


def _is_animated(block: bpy.types.ID | None) -> bool:
    return getattr(block, "animation_data", None) is not None


def _varies_inside(tree: bpy.types.NodeTree | None) -> bool:
    """Whether a node tree or one of its groups is animated."""
    groups = (
        {n.node_tree for n in compat.nodes_of(tree) if n.type == "GROUP" and n.node_tree}
        if tree
        else set()
    )
    return any(map(_varies, (tree, *groups)))


def _moves(thing: bpy.types.Object, seen: set[bpy.types.Object]) -> bool:
    """Whether an object moves: by its animation, its data, its shape keys, a simulation, or another
    object that it depends on.
    """
    if thing in seen:
        return False
    seen.add(thing)
    blocks = _blocks(thing)
    if any(map(_varies, blocks)) or _varies_inside(getattr(thing.data, "node_tree", None)):
        return True
    if any(m.type in _SIMULATED for m in thing.modifiers) or (
        thing.rigid_body and thing.rigid_body.type == "ACTIVE"
    ):
        return True
    others = [thing.parent, *(getattr(c, "target", None) for c in thing.constraints if not c.mute)]
    others += [getattr(m, "object", None) for m in thing.modifiers]
    if thing.instance_collection is not None:
        others += [o for o in thing.instance_collection.all_objects if o.type != "CAMERA"]
    return any(other is not None and _moves(other, seen) for other in others)


def _varies(block: bpy.types.ID | None) -> bool:
    """Whether a datablock has an action or strip whose curves are not constant, or a driver."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return False
    actions = [
        animation.action,
        *(strip.action for track in animation.nla_tracks for strip in track.strips),
    ]
    return len(animation.drivers) > 0 or any(
        _spread(c) > 1e-6 for action in actions if action for c in compat.curves_of(action)
    )


def _spread(curve: bpy.types.FCurve) -> float:
    if len(curve.modifiers):
        return float("inf")
    values = [point.co[1] for point in curve.keyframe_points]
    return max(values) - min(values) if values else 0.0


def strand_names(scene: bpy.types.Scene) -> list[str]:
    """Objects that render as hair, curves or points, which have no faces for a light map, including
    instances and results of Geometry Nodes.
    """
    with surfaces.as_rendered(scene) as depsgraph:
        return sorted({i.object.name for i in depsgraph.object_instances if _shows_strands(i)})


def _shows_strands(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    thing, made = instance.object, instance.is_instance
    if thing.original.hide_render and not made:
        return False
    strands = (
        instance.show_self
        and thing.type in ("CURVES", "POINTCLOUD")
        and (made or not _is_instances(thing))
    )
    return strands or (instance.show_particles and _has_particles(thing))


def made_volume_names(scene: bpy.types.Scene) -> list[str]:
    """Objects whose Geometry Nodes make a volume."""
    with surfaces.as_rendered(scene) as depsgraph:
        made = (i.object for i in depsgraph.object_instances if i.is_instance and i.show_self)
        return sorted({thing.name for thing in made if thing.type == "VOLUME"})


def _has_particles(thing: bpy.types.Object) -> bool:
    return any(m.type == "PARTICLE_SYSTEM" and m.show_render for m in thing.modifiers)


def _is_instances(evaluated: bpy.types.Object) -> bool:
    """Whether an evaluated object consists only of instances; only known in Blender 4.5 and later."""
    if not hasattr(evaluated, "evaluated_geometry"):
        return False
    geometry = evaluated.evaluated_geometry()
    return not any((geometry.mesh, geometry.curves, geometry.pointcloud, geometry.volume))


def volume_names(scene: bpy.types.Scene) -> list[str]:
    """Objects with a volume, or with a material or world that has one."""
    filled = {m for m in bpy.data.materials if m.users and m.node_tree and _has_volume(m.node_tree)}
    things = {
        *scene.objects,
        *(o for c in bpy.data.collections for o in c.all_objects),
    }  # instanced ones too
    names = [
        o.name
        for o in things
        if o.type == "VOLUME" or filled & {s.material for s in o.material_slots}
    ]
    sky = scene.world and scene.world.node_tree and _has_volume(scene.world.node_tree)
    return [*sorted(names), *(["the sky"] if sky else [])]


def _has_volume(tree: bpy.types.NodeTree) -> bool:
    outputs = [n for n in tree.nodes if n.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD")]
    return any(n.inputs["Volume"].is_linked for n in outputs)


def light_linking_names(scene: bpy.types.Scene) -> list[str]:
    """Lamps and emitting objects that light, or are shadowed by, only some objects."""
    things = {
        *scene.objects,
        *(o for c in bpy.data.collections for o in c.all_objects),
    }  # instanced ones too
    linked = [(o.name, getattr(o, "light_linking", None)) for o in things]
    return sorted(
        name
        for name, link in linked
        if link and (link.receiver_collection or link.blocker_collection)
    )


def unmappable_names(scene: bpy.types.Scene) -> list[str]:
    """Objects that cannot have a light map: because of unsupported shaders, too many UV maps, or
    materials that differ between instances.
    """
    found: dict[tuple[str, str, bool], bool] = {}
    with surfaces.as_rendered(scene) as depsgraph:
        for instance in depsgraph.object_instances:
            thing = instance.object
            if instance.show_self and thing.type in surfaces.SURFACE_TYPES:
                key = (thing.name, thing.data.name, instance.is_instance)
                if key not in found:
                    found[key] = _is_unmappable(thing, instance.is_instance)
    return sorted({name for (name, _, _), is_so in found.items() if is_so})


def _is_unmappable(evaluated: bpy.types.Object, is_instance: bool) -> bool:
    slots = [slot.material for slot in evaluated.material_slots]
    shown = {
        m
        for m in (*slots, *getattr(evaluated.data, "materials", ()))
        if m and m.use_nodes and m.node_tree
    }
    nodes = [node for material in shown for node in compat.nodes_of(material.node_tree)]
    unlike = any(
        node.type in _NO_LIGHT_MAP or (is_instance and _tells_instances(node)) for node in nodes
    )
    return unlike or len(getattr(evaluated.data, "uv_layers", ())) > _MAX_UV_MAPS


def _tells_instances(node: bpy.types.Node) -> bool:
    """Whether a node has different values for instances of one object."""
    if node.type == "OBJECT_INFO":
        return bool(node.outputs["Random"].is_linked)
    return (
        getattr(node, "from_instancer", False) or getattr(node, "attribute_type", "") == "INSTANCER"
    )
