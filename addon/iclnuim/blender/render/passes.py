"""Images in addition to colour and depth: the passes that Cycles writes for them, and how they are
computed from these.

A channel of channels.py has a function in `_READERS`, and one in `_PREPARED` if the scene has to be
changed for it.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import bpy
import numpy as np
from bpy.types import ViewLayer

from ...channels import INSTANCE, NORMAL, Channel
from ...geometry.camera import PinholeCamera
from ...geometry.trajectory import Trajectory
from .frames import channel_ending

_AOV = "ShadingNormal"


@dataclass(frozen=True)
class Shot:
    """What the images of a frame are computed from: all passes of Cycles by name, the planar depth
    (h, w) in metres, the frame's number in the trajectory, and the camera.

    Passes and depth are those of one ray through the centre of each pixel.
    """

    passes: dict[str, np.ndarray]
    depth_z_m: np.ndarray
    number: int
    trajectory: Trajectory
    camera: PinholeCamera


def add(channels: Iterable[Channel]) -> None:
    """Make Cycles write what these channels need into its frames.

    Call it after all changes of light and materials.
    """
    layer = bpy.context.scene.view_layers[0]
    for channel in channels:
        setattr(layer, channel.cycles_pass, True)
        if channel.name in _PREPARED:
            _PREPARED[channel.name](layer)


def read(shot: Shot, channels: Iterable[Channel]) -> dict[str, np.ndarray]:
    """The channels of a frame's EXR by name, (h, w) float32 each."""
    found: dict[str, np.ndarray] = {}
    for channel in channels:
        found |= _READERS[channel.name](shot)
    return {name: array.astype(np.float32) for name, array in found.items()}


def _instance(shot: Shot) -> dict[str, np.ndarray]:
    # the name changed with Blender 5.0
    index = channel_ending(shot.passes, "IndexOB.X", "Object Index.X")
    return {INSTANCE: np.rint(index)}


def _normal(shot: Shot) -> dict[str, np.ndarray]:
    """Unit normals in the cv camera's frame."""
    passes = shot.passes
    normal = np.stack([channel_ending(passes, f"{_AOV}.{c}") for c in "RGB"], -1).astype(float)
    bare = np.linalg.norm(normal, axis=-1) < 0.5  # materials without nodes have no AOV
    normal[bare] = np.stack([channel_ending(passes, f".Normal.{c}") for c in "XYZ"], -1)[bare]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    T_world_camera = shot.trajectory.T_world_camera[shot.number]
    normal_camera = (normal / np.where(length > 0, length, 1.0)) @ T_world_camera.rotation
    return {name: normal_camera[..., k] for k, name in enumerate(NORMAL)}


def _output_shading_normals(layer: ViewLayer) -> None:
    """Let every material output the shading normal, by a shader output variable (AOV): Cycles'
    Normal pass is the mean of the normals of the closures, and gloss bends them at grazing angles.
    """
    variable = layer.aovs.add()
    variable.name = _AOV
    variable.type = "COLOR"
    for material in bpy.data.materials:
        if material.use_nodes and material.node_tree:
            nodes = material.node_tree.nodes
            output = nodes.new("ShaderNodeOutputAOV")
            geometry = nodes.new("ShaderNodeNewGeometry")
            output.aov_name = _AOV
            material.node_tree.links.new(geometry.outputs["Normal"], output.inputs["Color"])


_PREPARED: dict[str, Callable[[ViewLayer], None]] = {"normal": _output_shading_normals}
#: name of the channel -> its function
_READERS: dict[str, Callable[[Shot], dict[str, np.ndarray]]] = {
    "instance": _instance,
    "class": _instance,
    "normal": _normal,
}
