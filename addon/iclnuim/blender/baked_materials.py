"""Materials that show baked light: every diffuse part becomes emission of its colour times the light map; the rest stays traced."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

FRONT_UV, BACK_UV = "light map", "light map back"
_DIFFUSE = {"BSDF_DIFFUSE", "SUBSURFACE_SCATTERING"}
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)


@dataclass(frozen=True)
class Kind:
    """Whether a material shows light from the side it is seen from, and light from its other side."""

    diffuse: bool
    translucent: bool


def kind(material: bpy.types.Material | None) -> Kind:
    """What of a material can be baked. No material, or one without nodes, is plain diffuse."""
    if _tree(material) is None:
        return Kind(True, False)
    types = _node_types(material.node_tree)
    principled = any(has_diffuse(node) for node in _nodes(material.node_tree) if node.type == "BSDF_PRINCIPLED")
    return Kind(bool(types & _DIFFUSE) or principled, "BSDF_TRANSLUCENT" in types)


def has_diffuse(principled: bpy.types.Node) -> bool:
    """False only where it is metal or glass throughout."""
    return not any(_constant(principled.inputs[name]) == 1.0 for name in ("Metallic", "Transmission Weight"))


def baked_copy(material: bpy.types.Material | None, image: bpy.types.Image, two_sided: bool) -> bpy.types.Material:
    """A copy that shows `image` through the UV maps FRONT_UV and, where two_sided, BACK_UV. The original stays as it is."""
    copy = material.copy() if material is not None else bpy.data.materials.new("no material")
    copy.name = f"{material.name if material else 'no material'} (baked)"
    if _tree(copy) is None:
        _plain(copy, material)
    copy.cycles.emission_sampling = "NONE"  # taken for a lamp, each surface would cost a second a frame
    _bake_tree(copy.node_tree, image, two_sided)
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


def _bake_tree(tree: bpy.types.NodeTree, image: bpy.types.Image, two_sided: bool) -> None:
    light = None
    for node in list(tree.nodes):
        if (
            node.type == "GROUP"
            and node.node_tree
            and _node_types(node.node_tree) & {*_DIFFUSE, "BSDF_TRANSLUCENT", "BSDF_PRINCIPLED"}
        ):
            node.node_tree = node.node_tree.copy()
            _bake_tree(node.node_tree, image, two_sided)
        elif (
            node.type in _DIFFUSE
            or node.type == "BSDF_TRANSLUCENT"
            or (node.type == "BSDF_PRINCIPLED" and has_diffuse(node))
        ):
            light = light or _light_sockets(tree, image, two_sided)
            if node.type == "BSDF_PRINCIPLED":
                _bake_principled(tree, node, light[0])
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


def _shine(tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket, *factors: bpy.types.NodeSocket) -> bpy.types.Node:
    """An emission node of colour x factors."""
    product = tree.nodes.new("ShaderNodeVectorMath")
    product.operation = "MULTIPLY"
    _same_source(tree, colour, product.inputs[0])
    tree.links.new(factors[0], product.inputs[1])
    for factor in factors[1:]:
        product = _times(tree, product.outputs[0], factor)
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(product.outputs[0], emission.inputs["Color"])
    return emission


def _times(tree: bpy.types.NodeTree, a: bpy.types.NodeSocket, b: bpy.types.NodeSocket) -> bpy.types.Node:
    product = tree.nodes.new("ShaderNodeVectorMath")
    product.operation = "MULTIPLY"
    tree.links.new(a, product.inputs[0])
    tree.links.new(b, product.inputs[1])
    return product


def _same_source(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Feed `target` with what feeds `source`: its link, or its value."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    elif isinstance(source.default_value, float):
        target.default_value = (
            source.default_value if isinstance(target.default_value, float) else (source.default_value,) * 3
        )
    else:
        target.default_value = tuple(source.default_value)[: len(target.default_value)]


def _replace(tree: bpy.types.NodeTree, old: bpy.types.Node, new: bpy.types.Node) -> None:
    for link in list(old.outputs[0].links):
        tree.links.new(new.outputs[0], link.to_socket)
    tree.nodes.remove(old)


def _constant(socket: bpy.types.NodeSocket) -> float | None:
    return None if socket.is_linked else float(socket.default_value)


def _bake_principled(tree: bpy.types.NodeTree, node: bpy.types.Node, light: bpy.types.NodeSocket) -> None:
    """Principled = its gloss, metal and glass as they are, plus the light map on its diffuse share."""
    shine = _shine(tree, node.inputs["Base Color"], light, _diffuse_share(tree, node))
    both = tree.nodes.new("ShaderNodeAddShader")
    targets = [link.to_socket for link in node.outputs[0].links]
    traced = _without_diffuse(tree, node)
    tree.links.new(shine.outputs[0], both.inputs[0])
    tree.links.new(traced, both.inputs[1])
    for target in targets:
        tree.links.new(both.outputs[0], target)


def _without_diffuse(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.NodeSocket:
    """The node's closures but the diffuse one: a black base, mixed with the same node as pure metal and as pure glass."""
    result = node.outputs[0]
    for name in ("Transmission Weight", "Metallic"):
        if _constant(node.inputs[name]) == 0.0:
            continue
        pure = _twin(tree, node)
        _set(tree, pure.inputs[name], 1.0)
        if name == "Transmission Weight":
            _set(tree, pure.inputs["Metallic"], 0.0)
        mix = tree.nodes.new("ShaderNodeMixShader")
        _same_source(tree, node.inputs[name], mix.inputs[0])
        tree.links.new(result, mix.inputs[1])
        tree.links.new(pure.outputs[0], mix.inputs[2])
        result = mix.outputs[0]
    for name in ("Transmission Weight", "Metallic", "Subsurface Weight"):
        _set(tree, node.inputs[name], 0.0)
    _set(tree, node.inputs["Base Color"], (0.0, 0.0, 0.0, 1.0))
    return result


def _twin(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.Node:
    twin = tree.nodes.new(node.bl_idname)
    if hasattr(node, "distribution"):
        twin.distribution = node.distribution
    for source, target in zip(node.inputs, twin.inputs, strict=True):
        if source.is_linked or hasattr(source, "default_value"):
            _same_source_any(tree, source, target)
    return twin


def _same_source_any(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    else:
        target.default_value = source.default_value


def _set(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: float | tuple) -> None:
    for link in list(socket.links):
        tree.links.remove(link)
    socket.default_value = value


def _diffuse_share(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.NodeSocket:
    """(1 - metal)(1 - glass) alpha (1 - Fresnel): what light the diffuse base gets and gives, seen from here.

    Cycles takes the rough gloss's albedo instead of the Fresnel reflection of a polished surface; they differ at grazing angles.
    """
    fresnel = tree.nodes.new("ShaderNodeFresnel")
    for name in ("IOR", "Normal"):
        _same_source_any(tree, node.inputs[name], fresnel.inputs[name]) if node.inputs[
            name
        ].is_linked or name == "IOR" else None
    share = _minus(tree, None, fresnel.outputs[0])
    for name in ("Metallic", "Transmission Weight"):
        if _constant(node.inputs[name]) != 0.0:
            share = _multiply(tree, share, _minus(tree, node.inputs[name], None))
    if _constant(node.inputs["Alpha"]) != 1.0:
        share = _multiply(tree, share, node.inputs["Alpha"])
    return share


def _minus(
    tree: bpy.types.NodeTree, source: bpy.types.NodeSocket | None, output: bpy.types.NodeSocket | None
) -> bpy.types.NodeSocket:
    """1 - x, for an input socket's source or an output."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = "SUBTRACT"
    node.inputs[0].default_value = 1.0
    if output is not None:
        tree.links.new(output, node.inputs[1])
    else:
        _same_source_any(tree, source, node.inputs[1])
    return node.outputs[0]


def _multiply(
    tree: bpy.types.NodeTree, output: bpy.types.NodeSocket, other: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = "MULTIPLY"
    tree.links.new(output, node.inputs[0])
    if other.is_output:
        tree.links.new(other, node.inputs[1])
    else:
        _same_source_any(tree, other, node.inputs[1])
    return node.outputs[0]
