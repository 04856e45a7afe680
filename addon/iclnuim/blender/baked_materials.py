"""Materials that show baked light: every diffuse part becomes emission of its colour times the light map; the rest stays traced.

Of a Principled surface the diffuse share becomes emission, its gloss, metal and glass stay ray traced. Cycles dims the diffuse base by
the albedo of the gloss above it, seen from the camera: that of a rough surface, which at grazing angles is far from Fresnel's reflection.
Here it is a formula of roughness and angle, fitted to what Cycles 4.5 itself shows in a white furnace (20 materials, 19 angles each):
off by 0.008 RMS and at most 0.036, beyond 80 degrees.
"""

from dataclasses import dataclass
from typing import TypeAlias

import bpy

FRONT_UV, BACK_UV = "light map", "light map back"
_DIFFUSE = {"BSDF_DIFFUSE", "SUBSURFACE_SCATTERING"}
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)
#: Albedo of gloss = F0 * h(r) + (1 - F0) * exp(a(r) - b(r) cos), polynomials of the roughness r.
_H = (1.019, 0.207, -0.801)
_A = (0.108, -0.681, -8.445, 6.591)
_B = (6.599, -8.765, 6.947)
#: What can be fed into a node: a constant, an output, or an input whose source is shared.
Source: TypeAlias = float | bpy.types.NodeSocket


@dataclass(frozen=True)
class Kind:
    """Whether a material shows light from the side it is seen from, and light from its other side; whether it sends light to others."""

    diffuse: bool
    translucent: bool
    sends: bool


def kind(material: bpy.types.Material | None) -> Kind:
    """What of a material can be baked. No material, or one without nodes, is plain diffuse."""
    tree = _tree(material)
    if tree is None:
        return Kind(True, False, True)
    nodes = _nodes(tree)
    types, principled = {n.type for n in nodes}, [n for n in nodes if n.type == "BSDF_PRINCIPLED"]
    diffuse, translucent = bool(types & _DIFFUSE), "BSDF_TRANSLUCENT" in types
    sends = diffuse or translucent or any(map(_reflects, principled))
    return Kind(diffuse or any(map(_has_diffuse, principled)), translucent, sends)


def baked_copy(
    material: bpy.types.Material | None, image: bpy.types.Image, two_sided: bool, gathering: bool = False
) -> bpy.types.Material:
    """A copy that shows `image` through the UV maps FRONT_UV and, where two_sided, BACK_UV. The original stays as it is.

    gathering: as light from it falls on others, not as a camera sees it.
    """
    copy = material.copy() if material is not None else bpy.data.materials.new("no material")
    copy.name = f"{material.name if material else 'no material'} (baked)"
    if _tree(copy) is None:
        _make_diffuse(copy, material.diffuse_color if material is not None else _PLAIN_GREY)
    copy.cycles.emission_sampling = "NONE"  # taken for a lamp, each surface would cost a second a frame
    _bake_tree(copy.node_tree, image, two_sided, gathering)
    return copy


def _tree(material: bpy.types.Material | None) -> bpy.types.NodeTree | None:
    return material.node_tree if material is not None and material.use_nodes else None


def _make_diffuse(material: bpy.types.Material, colour: tuple[float, ...]) -> None:
    """The surface that Cycles shows for a material without nodes."""
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


def _bake_tree(tree: bpy.types.NodeTree, image: bpy.types.Image, two_sided: bool, gathering: bool) -> None:
    bake, lit = (_bake_for_gathering, _reflects) if gathering else (_bake_principled, _has_diffuse)
    light = None
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree:
            if {n.type for n in _nodes(node.node_tree)} & {*_DIFFUSE, "BSDF_TRANSLUCENT", "BSDF_PRINCIPLED"}:
                node.node_tree = node.node_tree.copy()
                _bake_tree(node.node_tree, image, two_sided, gathering)
        elif node.type == "BSDF_PRINCIPLED" and lit(node):
            light = light or _light_sockets(tree, image, two_sided)
            bake(tree, node, light[0])
        elif node.type in {*_DIFFUSE, "BSDF_TRANSLUCENT"}:
            light = light or _light_sockets(tree, image, two_sided)
            side = light[node.type == "BSDF_TRANSLUCENT"]
            _replace(tree, node, _emission(tree, _vectors(tree, "MULTIPLY", node.inputs["Color"], side)))


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


def _replace(tree: bpy.types.NodeTree, old: bpy.types.Node, output: bpy.types.NodeSocket) -> None:
    for link in list(old.outputs[0].links):
        tree.links.new(output, link.to_socket)
    tree.nodes.remove(old)


# Principled surfaces


def _has_diffuse(principled: bpy.types.Node) -> bool:
    """False only where it is metal or glass throughout."""
    return not any(_constant(principled.inputs[name]) == 1.0 for name in ("Metallic", "Transmission Weight"))


def _reflects(principled: bpy.types.Node) -> bool:
    """False only where it is glass throughout: what is metal sends light to others, too."""
    return _constant(principled.inputs["Transmission Weight"]) != 1.0


def _bake_principled(tree: bpy.types.NodeTree, node: bpy.types.Node, light: bpy.types.NodeSocket) -> None:
    """Principled = its gloss, metal and glass as they are, plus the light map on its diffuse share."""
    colour = _scaled(tree, _vectors(tree, "MULTIPLY", node.inputs["Base Color"], light), _diffuse_share(tree, node))
    targets = [link.to_socket for link in node.outputs[0].links]
    _add_shaders(tree, _emission(tree, colour), _without_diffuse(tree, node), targets)


def _bake_for_gathering(tree: bpy.types.NodeTree, node: bpy.types.Node, light: bpy.types.NodeSocket) -> None:
    """As others see it when light is gathered: gloss and metal send on what falls on them, too, as if they were dull.

    (metal colour + (1 - metal) (colour (1 - albedo) + albedo)) (1 - glass) alpha x light, plus its own glow.
    """
    gloss = _product(tree, _gloss(tree, node), _one_minus(tree, _input(node, "Metallic")))
    base = _scaled(tree, _vectors(tree, "ADD", node.inputs["Base Color"]), _one_minus(tree, gloss))
    sent = _vectors(tree, "ADD", base, _grey(tree, gloss))
    share = _product(tree, _one_minus(tree, _input(node, "Transmission Weight")), _input(node, "Alpha"))
    shine = _emission(tree, _scaled(tree, _vectors(tree, "MULTIPLY", sent, light), share))
    targets = [link.to_socket for link in node.outputs[0].links]
    for name in ("Metallic", "Subsurface Weight"):
        _put(tree, node.inputs[name], 0.0)
    _put(tree, node.inputs["Base Color"], _BLACK)
    _add_shaders(tree, shine, node.outputs[0], targets)


def _diffuse_share(tree: bpy.types.NodeTree, node: bpy.types.Node) -> Source:
    """(1 - metal)(1 - glass) alpha (1 - gloss)(1 - coat): what light the diffuse base gets and gives, seen from here."""
    covers = [_input(node, "Metallic"), _input(node, "Transmission Weight"), _gloss(tree, node), _coat(tree, node)]
    return _product(tree, *(_one_minus(tree, c) for c in covers), _input(node, "Alpha"))


def _gloss(tree: bpy.types.NodeTree, node: bpy.types.Node) -> Source:
    level = _constant(node.inputs["Specular IOR Level"])
    f0 = min(_f0(node.inputs["IOR"]) * 2 * (0.5 if level is None else level), 1.0)
    return _albedo(tree, f0, _input(node, "Roughness"), node.inputs["Normal"])


def _coat(tree: bpy.types.NodeTree, node: bpy.types.Node) -> Source:
    weight = _input(node, "Coat Weight")
    if weight == 0.0:
        return 0.0
    covered = _albedo(tree, _f0(node.inputs["Coat IOR"]), _input(node, "Coat Roughness"), node.inputs["Coat Normal"])
    return _product(tree, weight, covered)


def _albedo(tree: bpy.types.NodeTree, f0: float, roughness: Source, normal: bpy.types.NodeSocket) -> Source:
    """Of a rough dielectric surface, seen from the camera."""
    if f0 <= 0.0:
        return 0.0
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
    if normal.is_linked:
        _same_source(tree, normal, facing.inputs["Normal"])
    cosine = _calculate(tree, "SUBTRACT", 1.0, facing.outputs["Facing"])
    exponent = _calculate(tree, "MULTIPLY", _polynomial(tree, tuple(-b for b in _B), roughness), cosine)
    exponent = _calculate(tree, "ADD", exponent, _polynomial(tree, _A, roughness))
    rim = _product(tree, 1.0 - f0, _calculate(tree, "EXPONENT", exponent))
    return _calculate(tree, "ADD", _product(tree, f0, _polynomial(tree, _H, roughness)), rim)


def _f0(ior: bpy.types.NodeSocket) -> float:
    """Reflection straight on; a linked IOR counts with the value below the link."""
    return float(((ior.default_value - 1) / (ior.default_value + 1)) ** 2)


def _without_diffuse(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.NodeSocket:
    """The node's closures but the diffuse one: a black base, mixed with the same node as pure metal and as pure glass."""
    result = node.outputs[0]
    for name in ("Transmission Weight", "Metallic"):
        if _constant(node.inputs[name]) == 0.0:
            continue
        pure = _twin(tree, node)
        _put(tree, pure.inputs[name], 1.0)
        if name == "Transmission Weight":
            _put(tree, pure.inputs["Metallic"], 0.0)
        mix = tree.nodes.new("ShaderNodeMixShader")
        _same_source(tree, node.inputs[name], mix.inputs[0])
        tree.links.new(result, mix.inputs[1])
        tree.links.new(pure.outputs[0], mix.inputs[2])
        result = mix.outputs[0]
    for name in ("Transmission Weight", "Metallic", "Subsurface Weight"):
        _put(tree, node.inputs[name], 0.0)
    _put(tree, node.inputs["Base Color"], _BLACK)
    return result


def _twin(tree: bpy.types.NodeTree, node: bpy.types.Node) -> bpy.types.Node:
    twin = tree.nodes.new(node.bl_idname)
    twin.distribution = node.distribution
    for source, target in zip(node.inputs, twin.inputs, strict=True):
        if source.is_linked:
            tree.links.new(source.links[0].from_socket, target)
        elif hasattr(source, "default_value"):
            target.default_value = source.default_value
    return twin


# Arithmetic in node trees: every function adds nodes and returns the socket of the result.


def _feed(tree: bpy.types.NodeTree, source: Source, target: bpy.types.NodeSocket) -> None:
    """Give `target` a constant, an output, or whatever feeds another input."""
    if isinstance(source, int | float):
        target.default_value = source
    elif source.is_output:
        tree.links.new(source, target)
    else:
        _same_source(tree, source, target)


def _same_source(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Feed `target` with what feeds the input `source`: its link, or its value, grey where only one of them is a colour."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
        return
    value, wanted = source.default_value, target.default_value
    if isinstance(wanted, float):
        target.default_value = value if isinstance(value, float) else sum(tuple(value)[:3]) / 3
    elif isinstance(value, float):
        target.default_value = (value,) * 3 + (1.0,) * (len(wanted) - 3)
    else:
        target.default_value = (*tuple(value)[: len(wanted)], *(1.0,) * (len(wanted) - len(value)))


def _put(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: float | tuple) -> None:
    """A constant in place of whatever fed an input."""
    for link in list(socket.links):
        tree.links.remove(link)
    socket.default_value = value


def _constant(socket: bpy.types.NodeSocket) -> float | None:
    """The value of an input, None where it is linked."""
    return None if socket.is_linked else float(socket.default_value)


def _input(node: bpy.types.Node, name: str) -> Source:
    value = _constant(node.inputs[name])
    return node.inputs[name] if value is None else value


def _calculate(
    tree: bpy.types.NodeTree, operation: str, *sources: Source, kind: str = "ShaderNodeMath"
) -> bpy.types.NodeSocket:
    """A Math node: `ADD`, `MULTIPLY_ADD`, `EXPONENT`, ..."""
    node = tree.nodes.new(kind)
    node.operation = operation
    for source, target in zip(sources, node.inputs, strict=False):
        _feed(tree, source, target)
    return node.outputs[0]


def _vectors(tree: bpy.types.NodeTree, operation: str, *sources: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """A Vector Math node on colours: `ADD`, `MULTIPLY`."""
    return _calculate(tree, operation, *sources, kind="ShaderNodeVectorMath")


def _scaled(tree: bpy.types.NodeTree, vector: bpy.types.NodeSocket, factor: Source) -> bpy.types.NodeSocket:
    """A colour times a number."""
    if isinstance(factor, int | float) and factor == 1.0:
        return vector
    result = _vectors(tree, "SCALE", vector)
    _feed(tree, factor, result.node.inputs["Scale"])
    return result


def _grey(tree: bpy.types.NodeTree, value: Source) -> bpy.types.NodeSocket:
    result = _vectors(tree, "SCALE")
    result.node.inputs[0].default_value = (1.0, 1.0, 1.0)
    _feed(tree, value, result.node.inputs["Scale"])
    return result


def _product(tree: bpy.types.NodeTree, *sources: Source) -> Source:
    """Of numbers; constants are multiplied here, and 1 costs no node."""
    known = 1.0
    rest: list[Source] = []
    for source in sources:
        if isinstance(source, int | float):
            known *= source
        else:
            rest.append(source)
    result: Source = known if known != 1.0 or not rest else rest.pop(0)
    for source in rest:
        result = _calculate(tree, "MULTIPLY", result, source)
    return result


def _one_minus(tree: bpy.types.NodeTree, source: Source) -> Source:
    return 1.0 - source if isinstance(source, int | float) else _calculate(tree, "SUBTRACT", 1.0, source)


def _polynomial(tree: bpy.types.NodeTree, coefficients: tuple[float, ...], x: Source) -> Source:
    """c0 + c1 x + c2 x^2 ..., by Horner's rule; a number where x is one."""
    if isinstance(x, int | float):
        return float(sum(c * x**k for k, c in enumerate(coefficients)))
    result: Source = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = _calculate(tree, "MULTIPLY_ADD", result, x, c)
    return result


def _emission(tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(colour, emission.inputs["Color"])
    return emission.outputs[0]


def _add_shaders(
    tree: bpy.types.NodeTree, a: bpy.types.NodeSocket, b: bpy.types.NodeSocket, targets: list[bpy.types.NodeSocket]
) -> None:
    both = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(a, both.inputs[0])
    tree.links.new(b, both.inputs[1])
    for target in targets:
        tree.links.new(both.outputs[0], target)
