"""Ground truth beside colour and depth: whose surface a pixel's centre shows, and how that surface lies there.

Both come from each pixel's first ray, as Z does. Cycles' own Normal pass is the mean of the normals that the closures use, and
gloss bends them at grazing angles; so every material also puts out the shading normal itself, by a shader output variable (AOV).
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ..dataset.ground_truth import INSTANCE, NORMAL
from ..errors import InputError
from ..formats import exr
from ..geometry.se3 import SE3

_AOV = "ShadingNormal"
_MOST_OBJECTS = 32767  # of Blender's pass index
_SURFACES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


def number_objects() -> None:
    """Give every object that has a surface a pass index of its own, before light is baked (copies take it over).

    An `instance_id` of the scene's own stays where it is a whole number that no other object has; the others get the numbers
    that are left, in alphabetical order. Instances of one object share its number. Raises InputError for more than 32767 objects.
    """
    things = sorted((o for o in bpy.context.scene.objects if o.type in _SURFACES), key=lambda o: o.name)
    instanced = {i.object.original for i in bpy.context.evaluated_depsgraph_get().object_instances if i.is_instance}
    things += sorted((o for o in instanced if o.type in _SURFACES and o not in things), key=lambda o: o.name)
    if len(things) > _MOST_OBJECTS:
        raise InputError(
            f"at most {_MOST_OBJECTS} objects for instance numbers", found=len(things), hint="joining some"
        )
    taken: set[int] = set()
    for thing in things:
        own = thing.get("instance_id")
        thing.pass_index = own if type(own) is int and 0 < own <= _MOST_OBJECTS and own not in taken else 0
        taken.add(thing.pass_index)
    free = (n for n in range(1, _MOST_OBJECTS + 1) if n not in taken)
    for thing in things:
        thing.pass_index = thing.pass_index or next(free)


def put_out() -> None:
    """Have Cycles write instance and normals into its frames; call it once light and materials are as they stay."""
    layer = bpy.context.scene.view_layers[0]
    layer.use_pass_object_index = layer.use_pass_normal = True
    variable = layer.aovs.add()
    variable.name, variable.type = _AOV, "COLOR"
    for material in bpy.data.materials:
        if material.use_nodes and material.node_tree:
            _put_out_normal(material.node_tree)


def _put_out_normal(tree: bpy.types.NodeTree) -> None:
    output, geometry = tree.nodes.new("ShaderNodeOutputAOV"), tree.nodes.new("ShaderNodeNewGeometry")
    output.aov_name = _AOV
    tree.links.new(geometry.outputs["Normal"], output.inputs["Color"])


def read(raw_file: Path, T_world_camera: SE3) -> dict[str, np.ndarray]:
    """The channels of a one-sample frame by Blender: instance, and unit normals in the cv camera's frame. (h, w) float32 each."""
    channels = exr.read_exr(raw_file)
    index = _ending(channels, "IndexOB.X", "Object Index.X")  # the name changed with Blender 5.0
    normal = np.stack([_ending(channels, f"{_AOV}.{c}") for c in "RGB"], -1).astype(float)
    bare = np.linalg.norm(normal, axis=-1) < 0.5  # materials without nodes have no AOV
    normal[bare] = np.stack([_ending(channels, f".Normal.{c}") for c in "XYZ"], -1)[bare]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal_camera = (normal / np.where(length > 0, length, 1.0)) @ T_world_camera.rotation
    by_name = {name: normal_camera[..., k] for k, name in enumerate(NORMAL)}
    return {name: array.astype(np.float32) for name, array in {INSTANCE: np.rint(index), **by_name}.items()}


def _ending(channels: dict[str, np.ndarray], *names: str) -> np.ndarray:
    return next(array for key, array in channels.items() if key.endswith(names))
