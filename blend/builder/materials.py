"""Blender materials of the few kinds that light baking supports: diffuse under a Fresnel or
constant gloss, pane, thin cloth, emission.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TypeAlias

import bpy
import numpy as np

Colour: TypeAlias = tuple[float, float, float] | bpy.types.Image


def image(name: str, rgb: np.ndarray, photo: bool = True) -> bpy.types.Image:
    """A packed image from sRGB bytes (rows, columns, 3), row 0 at the bottom; JPEG for photo-like
    ones, PNG otherwise.
    """
    h, w = rgb.shape[:2]
    pixels = np.ones((h, w, 4), np.float32)
    pixels[..., :3] = rgb.astype(np.float32) / 255
    made = bpy.data.images.new(name + ".draft", w, h)
    made.pixels.foreach_set(pixels.reshape(-1))
    made.file_format = "JPEG" if photo else "PNG"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / (name + (".jpg" if photo else ".png"))
        made.filepath_raw = str(path)
        made.save(quality=88) if photo else made.save()
        encoded = path.read_bytes()
    bpy.data.images.remove(made)
    packed = bpy.data.images.new(name, 1, 1)
    # packed from memory, so that the saved file contains no path of a temporary folder
    packed.pack(data=encoded, data_len=len(encoded))
    packed.source = "FILE"
    packed.filepath_raw = "//" + path.name
    return packed


def _new(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # from 5.0 on a new material has a node tree
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree


def _colour(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, colour: Colour) -> None:
    if isinstance(colour, bpy.types.Image):
        uv = tree.nodes.new("ShaderNodeUVMap")
        uv.uv_map = "UVMap"
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = colour
        tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], socket)
    else:
        socket.default_value = (*colour, 1.0)


def _shader(
    tree: bpy.types.NodeTree, kind: str, colour: Colour, roughness: float | None = None
) -> bpy.types.NodeSocket:
    node = tree.nodes.new(kind)
    _colour(tree, node.inputs["Color"], colour)
    if roughness is not None:
        node.inputs["Roughness"].default_value = roughness
    return node.outputs[0]


def _mirror(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """All gloss of the rooms is a perfect mirror: it has no noise at one ray per pixel, unlike a
    rough surface (thin poles: see `polished`).
    """
    return _shader(tree, "ShaderNodeBsdfGlossy", (1.0, 1.0, 1.0), 0.0)


def _mix(
    tree: bpy.types.NodeTree,
    below: bpy.types.NodeSocket,
    above: bpy.types.NodeSocket,
    share: float | None = None,
    ior: float | None = None,
) -> bpy.types.NodeSocket:
    """A mix of `below` and `above` by a constant share, or by Fresnel reflection."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    if ior is not None:
        fresnel = tree.nodes.new("ShaderNodeFresnel")
        fresnel.inputs["IOR"].default_value = ior
        tree.links.new(fresnel.outputs[0], mix.inputs[0])
    else:
        mix.inputs[0].default_value = share
    tree.links.new(below, mix.inputs[1])
    tree.links.new(above, mix.inputs[2])
    return mix.outputs[0]


def _finish(material: bpy.types.Material, surface: bpy.types.NodeSocket) -> bpy.types.Material:
    out = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(surface, out.inputs["Surface"])
    return material


def matte(name: str, colour: Colour) -> bpy.types.Material:
    """Only diffuse; constant colours are linear, images sRGB."""
    material, tree = _new(name)
    return _finish(material, _shader(tree, "ShaderNodeBsdfDiffuse", colour, 0.0))


def glossy(name: str, colour: Colour, ior: float = 1.45) -> bpy.types.Material:
    """Diffuse under a clear coat."""
    material, tree = _new(name)
    below = _shader(tree, "ShaderNodeBsdfDiffuse", colour, 0.0)
    return _finish(material, _mix(tree, below, _mirror(tree), ior=ior))


def polished(name: str, colour: Colour, share: float) -> bpy.types.Material:
    """Diffuse with a mirror reflection of the same share at every angle: metals.

    A thin pole that only mirrors shows another part of the room in each pixel, which is noise at
    one ray per pixel.
    """
    material, tree = _new(name)
    below = _shader(tree, "ShaderNodeBsdfDiffuse", colour, 0.0)
    return _finish(material, _mix(tree, below, _mirror(tree), share=share))


def pane(name: str) -> bpy.types.Material:
    """Window glass as a single sheet, slightly green.

    By day its reflection is negligible compared with the transmitted light.
    """
    material, tree = _new(name)
    return _finish(material, _shader(tree, "ShaderNodeBsdfTransparent", (0.92, 0.94, 0.93)))


def thin_cloth(name: str, colour: Colour, translucency: float) -> bpy.types.Material:
    """Shades and curtains, which transmit part of the light."""
    material, tree = _new(name)
    below = _shader(tree, "ShaderNodeBsdfDiffuse", colour, 0.0)
    return _finish(
        material,
        _mix(tree, below, _shader(tree, "ShaderNodeBsdfTranslucent", colour), share=translucency),
    )


def glow(name: str, colour: Colour, strength: float) -> bpy.types.Material:
    """A visible bulb or a painted view; never sampled as a light."""
    material, tree = _new(name)
    node = tree.nodes.new("ShaderNodeEmission")
    _colour(tree, node.inputs["Color"], colour)
    node.inputs["Strength"].default_value = strength
    material.cycles.emission_sampling = "NONE"
    return _finish(material, node.outputs[0])
