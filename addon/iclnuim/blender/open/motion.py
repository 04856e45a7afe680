"""What moves in the open scene: a light map and a depth of another time would be wrong there."""

from collections.abc import Iterator

import bpy
from bpy.types import ID, FCurve, NodeTree, Object, Scene

from .. import compat
from .changes import SKY, changed_names
from .simulated import is_unbaked

#: Modifiers that move a surface.
_SIMULATED = {
    "CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "DYNAMIC_PAINT", "MESH_SEQUENCE_CACHE", "EXPLODE",
    "BUILD", "WAVE",
}  # fmt: skip
#: Values of an animation curve that differ by less are constant.
_CONSTANT = 1e-6


def moving_names(scene: Scene) -> list[str]:
    """Names of objects and lights that move or change, in order, without cameras; the world is `the
    sky`. Those of the animations, or, if there are none, of the first difference between frames of
    the timeline: each evaluation takes time.
    """
    return _ordered(_animated_names(scene) or _changed_names(scene, first_only=True))


def all_moving_names(scene: Scene) -> list[str]:
    """As moving_names, of all animations and of all differences."""
    return _ordered(_animated_names(scene) | _changed_names(scene, first_only=False))


def _ordered(names: set[str]) -> list[str]:
    return sorted(names, key=lambda name: (name == SKY, name))


def _changed_names(scene: Scene, first_only: bool) -> set[str]:
    """Simulations that are not baked are not evaluated: they would lose their state."""
    return set() if is_unbaked(scene) else changed_names(scene, first_only)


def _animated_names(scene: Scene) -> set[str]:
    moving: set[str] = set()
    for thing in scene.objects:
        if thing.type == "CAMERA" or (thing.hide_render and not varies(thing)):
            continue
        if (thing.type != "EMPTY" or thing.instance_collection) and _moves(thing, set()):
            moving.add(thing.name)
    for material in bpy.data.materials:
        if material.users and material.node_tree:
            tree = material.node_tree
            if varies(material) or _varies_inside(tree) or _shows_film(tree):
                moving.add(material.name)
    sky = scene.world
    if sky is not None:
        tree = sky.node_tree
        if varies(sky) or _varies_inside(tree) or _shows_film(tree):
            moving.add(SKY)
    return moving


def _shows_film(tree: NodeTree | None) -> bool:
    if tree is None:
        return False
    textures = [n for n in compat.nodes_of(tree) if n.type in ("TEX_IMAGE", "TEX_ENVIRONMENT")]
    return any(n.image and n.image.source in ("MOVIE", "SEQUENCE") for n in textures)


def _is_simulated(thing: Object) -> bool:
    return any(modifier.type in _SIMULATED for modifier in thing.modifiers)


def _blocks(thing: Object) -> list[ID | None]:
    """The datablocks that may change an object's shape."""
    bones = [m.object for m in thing.modifiers if m.type == "ARMATURE"]
    return [thing, thing.data, getattr(thing.data, "shape_keys", None), *bones]


def _varies_inside(tree: NodeTree | None) -> bool:
    """Whether a node tree or one of its groups is animated."""
    if tree is None:
        return False
    nodes = compat.nodes_of(tree)
    return varies(tree) or any(varies(n.node_tree) for n in nodes if n.type == "GROUP")


def _moves(thing: Object, seen: set[Object]) -> bool:
    """Whether an object moves: by its animation, its data, its shape keys, a simulation, or another
    object that it depends on.
    """
    if thing in seen:
        return False
    seen.add(thing)
    if any(map(varies, _blocks(thing))) or _varies_inside(getattr(thing.data, "node_tree", None)):
        return True
    if _is_simulated(thing) or (thing.rigid_body and thing.rigid_body.type == "ACTIVE"):
        return True
    return any(other is not None and _moves(other, seen) for other in _depends_on(thing))


def _depends_on(thing: Object) -> Iterator[Object | None]:
    yield thing.parent
    for constraint in thing.constraints:
        if not constraint.mute:
            yield getattr(constraint, "target", None)
    for modifier in thing.modifiers:
        yield getattr(modifier, "object", None)
    if thing.instance_collection is not None:
        yield from (o for o in thing.instance_collection.all_objects if o.type != "CAMERA")


def varies(block: ID | None) -> bool:
    """Whether a datablock has an action or strip whose curves are not constant, or a driver."""
    if len(getattr(getattr(block, "animation_data", None), "drivers", ())):
        return True
    return any(map(_is_varying, compat.animated_curves(block)))


def _is_varying(curve: FCurve) -> bool:
    values = [point.co[1] for point in curve.keyframe_points]
    return len(curve.modifiers) > 0 or (bool(values) and max(values) - min(values) > _CONSTANT)
