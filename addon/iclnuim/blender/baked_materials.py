"""Materials that show baked light: every diffuse part becomes emission of its colour times the light map; the rest stays traced."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from . import baked_principled
from .node_wiring import same_source

FRONT_UV, BACK_UV = "light map", "light map back"
_DIFFUSE = {"BSDF_DIFFUSE", "SUBSURFACE_SCATTERING"}
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)


@dataclass(frozen=True)
class Kind:
    """Whether a material shows light from the side it is seen from, and light from its other side; whether it sends light to others."""

    diffuse: bool
    translucent: bool
    sends: bool


def kind(material: bpy.types.Material | None) -> Kind:
    """What of a material can be baked. No material, or one without nodes, is plain diffuse."""
    if _tree(material) is None:
        return Kind(True, False, True)
    types = _node_types(material.node_tree)
    principled = [node for node in _nodes(material.node_tree) if node.type == "BSDF_PRINCIPLED"]
    diffuse, translucent = bool(types & _DIFFUSE), "BSDF_TRANSLUCENT" in types
    sends = diffuse or translucent or any(map(baked_principled.reflects, principled))
    return Kind(diffuse or any(map(baked_principled.has_diffuse, principled)), translucent, sends)


def baked_copy(
    material: bpy.types.Material | None, image: bpy.types.Image, two_sided: bool, gathering: bool = False
) -> bpy.types.Material:
    """A copy that shows `image` through the UV maps FRONT_UV and, where two_sided, BACK_UV. The original stays as it is.

    gathering: as light from it falls on others, not as a camera sees it.
    """
    copy = material.copy() if material is not None else bpy.data.materials.new("no material")
    copy.name = f"{material.name if material else 'no material'} (baked)"
    if _tree(copy) is None:
        _plain(copy, material)
    copy.cycles.emission_sampling = "NONE"  # taken for a lamp, each surface would cost a second a frame
    _bake_tree(copy.node_tree, image, two_sided, gathering)
    return copy


def _tree(material: bpy.types.Material | None) -> bpy.types.NodeTree | None:
    return material.node_tree if material is not None and material.use_nodes else None


def _plain(material: bpy.types.Material, original: bpy.types.Material | None) -> None:
    """The diffuse surface that Cycles shows for a material without nodes."""
    colour = original.diffuse_color if original is not None else _PLAIN_GREY
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output, diffuse = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = colour
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])


def _nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """All nodes, those of groups too."""
    own = list(tree.nodes)
    return own + [n for g in own if g.type == "GROUP" and g.node_tree for n in _nodes(g.node_tree)]


def _node_types(tree: bpy.types.NodeTree) -> set[str]:
    return {node.type for node in _nodes(tree)}


def _bake_tree(tree: bpy.types.NodeTree, image: bpy.types.Image, two_sided: bool, gathering: bool) -> None:
    bake_principled = baked_principled.bake_for_gathering if gathering else baked_principled.bake
    lights_principled = baked_principled.reflects if gathering else baked_principled.has_diffuse
    light = None
    for node in list(tree.nodes):
        if (
            node.type == "GROUP"
            and node.node_tree
            and _node_types(node.node_tree) & {*_DIFFUSE, "BSDF_TRANSLUCENT", "BSDF_PRINCIPLED"}
        ):
            node.node_tree = node.node_tree.copy()
            _bake_tree(node.node_tree, image, two_sided, gathering)
        elif (
            node.type in _DIFFUSE
            or node.type == "BSDF_TRANSLUCENT"
            or (node.type == "BSDF_PRINCIPLED" and lights_principled(node))
        ):
            light = light or _light_sockets(tree, image, two_sided)
            if node.type == "BSDF_PRINCIPLED":
                bake_principled(tree, node, light[0])
            else:
                _replace(tree, node, _shine(tree, node.inputs["Color"], light[node.type == "BSDF_TRANSLUCENT"]))


def _light_sockets(tree: bpy.types.NodeTree, image: bpy.types.Image, two_sided: bool) -> tuple:
    """Sockets of the light on the side that is seen, and on the other one."""
    front = _map_socket(tree, image, FRONT_UV)
    if not two_sided:
        return front, front
    back = _map_socket(tree, image, BACK_UV)
    facing = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    return _blend(tree, facing, front, back), _blend(tree, facing, back, front)


def _map_socket(tree: bpy.types.NodeTree, image: bpy.types.Image, uv_name: str) -> bpy.types.NodeSocket:
    uv, texture = tree.nodes.new("ShaderNodeUVMap"), tree.nodes.new("ShaderNodeTexImage")
    uv.uv_map, texture.image, texture.interpolation, texture.extension = uv_name, image, "Linear", "EXTEND"
    tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
    return texture.outputs["Color"]


def _blend(
    tree: bpy.types.NodeTree, share: bpy.types.NodeSocket, a: bpy.types.NodeSocket, b: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.factor_mode = "VECTOR", "UNIFORM"
    inputs = [s for s in mix.inputs if s.enabled]
    for socket, source in zip(inputs, (share, a, b), strict=True):
        tree.links.new(source, socket)
    return next(s for s in mix.outputs if s.enabled)


def _shine(tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket, light: bpy.types.NodeSocket) -> bpy.types.Node:
    """An emission node of colour x light."""
    product, emission = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeEmission")
    product.operation = "MULTIPLY"
    same_source(tree, colour, product.inputs[0])
    tree.links.new(light, product.inputs[1])
    tree.links.new(product.outputs[0], emission.inputs["Color"])
    return emission


def _replace(tree: bpy.types.NodeTree, old: bpy.types.Node, new: bpy.types.Node) -> None:
    for link in list(old.outputs[0].links):
        tree.links.new(new.outputs[0], link.to_socket)
    tree.nodes.remove(old)
