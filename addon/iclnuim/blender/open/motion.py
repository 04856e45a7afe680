"""What moves in the open scene, by its animations, and whatever is the cause (modifiers, constraints,
nodes, properties of the scene) by what differs between frames once Blender has evaluated them: a
light map and a depth of another time would be wrong there.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, TypeAlias

import bpy
import mathutils
import numpy as np
from bpy.types import ID, Depsgraph, FCurve, Mesh, NodeTree, Object, Scene

from .. import compat, surfaces
from .simulated import is_unbaked

#: Modifiers that move a surface.
_SIMULATED = {
    "CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "DYNAMIC_PAINT", "MESH_SEQUENCE_CACHE", "EXPLODE",
    "BUILD", "WAVE",
}  # fmt: skip
#: Values of an animation curve that differ by less are constant.
_CONSTANT = 1e-6
#: Frames that are compared: the first, the last, and others spread between them.
_FRAMES = 32
#: Attributes of meshes by type: the property of a value, its width, and its type.
_ATTRIBUTES = {
    "FLOAT": ("value", 1, np.float32), "INT": ("value", 1, np.int32),
    "BOOLEAN": ("value", 1, np.bool_), "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT2": ("vector", 2, np.float32), "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
}  # fmt: skip
#: Types of objects that are rendered.
_RENDERED = {*surfaces.SURFACE_TYPES, "LIGHT", "CURVES", "POINTCLOUD", "VOLUME"}
#: Larger differences of a matrix are motion: constant animations give others in the last digits.
_STILL = 1e-5
SKY = "the sky"
#: Hashes of meshes by the names of an object and its instancer, and the address of the mesh.
_Hashes: TypeAlias = dict[tuple[str, str, int], bytes]


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


def changed_names(scene: Scene, first_only: bool = False) -> set[str]:
    """Names of objects, lights and materials that are not the same at the first, the last and 30
    spread frames of the timeline, or only those of the first difference that is found; the world is
    `the sky`. The current frame is restored.

    Simulations without a cache would lose their state.
    """
    spread = np.linspace(scene.frame_start, scene.frame_end, _FRAMES).round().astype(int)
    others = sorted({*spread[1:-1].tolist()} - {scene.frame_start, scene.frame_end})
    before = scene.frame_current_final
    updated: dict[bpy.types.ID, bool] = {}  # and whether its geometry is
    hashes: _Hashes = {}

    def note(_: Scene, depsgraph: Depsgraph) -> None:
        updated.update({u.id.original: u.is_updated_geometry for u in depsgraph.updates})

    changed: set[str] = set()
    with surfaces.as_rendered(scene) as depsgraph:
        go_to = surfaces.frame_changer(scene)
        bpy.app.handlers.frame_change_post.append(note)
        try:
            go_to(scene.frame_start)
            first = _State(scene, depsgraph, hashes)
            for frame in (scene.frame_end, *others):
                updated.clear()
                go_to(frame)
                if updated.keys() - {scene}:
                    new = {block.name for block, is_new in updated.items() if is_new}
                    for key in [key for key in hashes if new & {*key[:2]}]:
                        del hashes[key]
                    changed |= first.differences(_State(scene, depsgraph, hashes))
                if changed and first_only:
                    break
        finally:
            bpy.app.handlers.frame_change_post.remove(note)
            go_to(before)
    return changed


class _State:
    """What is rendered in the current frame, by name: places (n, 4, 4) of the object or of all that
    it instances, and hashes of all else.
    """

    def __init__(self, scene: Scene, depsgraph: Depsgraph, hashes: _Hashes) -> None:
        self.places: defaultdict[str, list[mathutils.Matrix]] = defaultdict(list)
        self.looks: defaultdict[str, list[bytes]] = defaultdict(list)
        for instance in depsgraph.object_instances:
            thing = instance.object
            if instance.show_self and thing.type in _RENDERED:
                owner = instance.parent or thing
                self.places[owner.name].append(instance.matrix_world.copy())
                self.looks[owner.name].append(_shape(thing, owner, hashes))
        for name, tree in _trees(scene):
            self.looks[name].append(_values(tree, scene))

    def differences(self, other: "_State") -> set[str]:
        """Names of what is not the same in both."""
        names = self.looks.keys() | other.looks.keys()
        return {name for name in names if not self._is_same(other, name)}

    def _is_same(self, other: "_State", name: str) -> bool:
        if self.looks.get(name) != other.looks.get(name):
            return False
        here, there = self.places[name], other.places[name]
        if here == there:  # the most, without arrays
            return True
        return len(here) == len(there) and np.allclose(here, there, rtol=0, atol=_STILL)


def _shape(evaluated: Object, owner: Object, hashes: _Hashes) -> bytes:
    """The hash of the mesh of an evaluated object, kept in `hashes` for its other instances and for
    frames in which its geometry is not updated.
    """
    if evaluated.type not in surfaces.SURFACE_TYPES:
        return b""
    key = (evaluated.name, owner.name, evaluated.data.as_pointer())
    if key not in hashes:
        if evaluated.type == "MESH":
            hashes[key] = _mesh_hash(evaluated.data)
        else:
            hashes[key] = _mesh_hash(evaluated.to_mesh())
            evaluated.to_mesh_clear()
    return hashes[key]


def _mesh_hash(mesh: Mesh | None) -> bytes:
    if mesh is None:
        return b""
    digest = hashlib.sha1()  # the corners of faces are among the attributes
    for attribute in mesh.attributes:
        if attribute.data_type in _ATTRIBUTES:
            values = surfaces.array_of(attribute.data, *_ATTRIBUTES[attribute.data_type])
            digest.update(attribute.name.encode() + values.tobytes())
    return digest.digest()


def _trees(scene: Scene) -> Iterator[tuple[str, NodeTree]]:
    for material in bpy.data.materials:
        if material.users and material.node_tree:
            yield material.name, material.node_tree
    if scene.world is not None and scene.world.node_tree:
        yield SKY, scene.world.node_tree


def _values(tree: NodeTree, scene: Scene) -> bytes:
    """The values of all sockets, and what the nodes read of the scene and of objects."""
    found: list[object] = []
    for node in compat.nodes_of(tree):
        for socket in (*node.inputs, *node.outputs):
            value: Any = getattr(socket, "default_value", None)
            found.append(value[:] if hasattr(value, "__len__") else value)
        if getattr(node, "object", None) is not None:
            found.append(tuple(map(tuple, node.object.matrix_world)))
        if getattr(node, "attribute_type", "") == "VIEW_LAYER":
            found.append(_of_scene(scene, node.attribute_name))
    return repr(found).encode()


def _of_scene(scene: Scene, name: str) -> object:
    """The value that a node reads from the view layer or the scene: of a custom property, or at a
    path.
    """
    for block in (scene.view_layers[0], scene):
        if block.get(name) is not None:
            return repr(block[name])
        try:
            return repr(block.path_resolve(name))
        except ValueError:
            continue
    return None
