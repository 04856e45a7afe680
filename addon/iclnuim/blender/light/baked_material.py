"""Materials that show baked light.

Every diffuse part is replaced by emission of its colour times the light map; the rest is still ray
traced. For a Principled surface, the diffuse part becomes emission; gloss, metal and glass are
still ray traced. Cycles reduces the diffuse base by the albedo of the gloss above it, as seen from
the camera. For a rough surface at grazing angles, this albedo is far from Fresnel reflection. Here
it is a formula of roughness and angle, fitted to renders by Cycles 4.5 in a white furnace (20
materials, 19 angles each): its error is 0.008 RMS and at most 0.036, beyond 80 degrees.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from bpy.types import Image, Material, Node, NodeSocket, NodeTree

from .. import materials
from ..compat import matt_material, nodes_of, redirect
from ..shader_nodes import (
    Source,
    add_node,
    calculate,
    constant,
    constant_or_input,
    feed,
    one_minus,
    polynomial,
    product,
    scaled,
    set_constant,
    vectors,
)

#: The UV maps of the light on the front and on the back.
FRONT_UV = "light map"
BACK_UV = "light map back"
#: What Cycles shows where there is no material.
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)
#: Albedo of gloss = F0 * h(r) + (1 - F0) * exp(a(r) - b(r) cos), polynomials of the roughness r.
_H = (1.019, 0.207, -0.801)
_A = (0.108, -0.681, -8.445, 6.591)
_B = (6.599, -8.765, 6.947)
_A_MINUS_B = tuple(np.polynomial.polynomial.polysub(_A, _B).tolist())


@dataclass(frozen=True, eq=False)
class BakedLight:
    """How baked light is shown: by `image` through the UV map FRONT_UV and, if two_sided, BACK_UV.

    gathering: the light that falls on other surfaces, instead of the view of a camera. glow:
    surfaces that emit are sampled as lamps are. limit: maximum of the light that is seen in
    reflections and through glass, like Cycles' clamp of indirect light; otherwise bright spots next
    to lamps would cause fireflies in gloss.
    """

    image: Image
    two_sided: bool
    gathering: bool = False
    glow: bool = False
    limit: float | None = None


def baked_copy(material: Material | None, baked: BakedLight) -> Material:
    """A copy of the material that shows baked light. The original is not changed."""
    name = f"{material.name if material else 'no material'} (baked)"
    if material is not None and materials.tree_of(material) is not None:
        copy = material.copy()
        copy.name = name
    else:  # the appearance in Cycles
        colour = _PLAIN_GREY if material is None else material.diffuse_color
        copy, _ = matt_material(name, colour)
    # sampled as a lamp, each surface would take a second per frame
    copy.cycles.emission_sampling = "NONE"
    if baked.glow and materials.emits(copy):
        copy.cycles.emission_sampling = "FRONT_BACK"
    _bake_tree(copy.node_tree, baked)
    return copy


def _bake_tree(tree: NodeTree, baked: BakedLight) -> None:
    bake: Callable[[NodeTree, Node, NodeSocket, float | None], None] = _bake_principled
    is_lit = materials.has_diffuse
    if baked.gathering:
        bake = _bake_for_gathering
        is_lit = materials.reflects
    light: tuple[NodeSocket, NodeSocket] | None = None
    for node in list(tree.nodes):
        if node.type == "GROUP":
            if node.node_tree and _has_surface(node.node_tree):
                node.node_tree = node.node_tree.copy()
                _bake_tree(node.node_tree, baked)
            continue
        is_principled = node.type == "BSDF_PRINCIPLED"
        if is_principled and not is_lit(node):
            continue
        if not is_principled and node.type not in materials.DIFFUSE | {"BSDF_TRANSLUCENT"}:
            continue
        light = light or _light_sockets(tree, baked)
        if is_principled:
            bake(tree, node, light[0], baked.limit)
        else:
            seen = light[node.type == "BSDF_TRANSLUCENT"]
            colour = vectors(tree, "MULTIPLY", node.inputs["Color"], seen)
            redirect(node.outputs[0], _shine(tree, colour, 1.0, baked.limit))
            tree.nodes.remove(node)


def _has_surface(group: NodeTree) -> bool:
    wanted = {*materials.DIFFUSE, "BSDF_TRANSLUCENT", "BSDF_PRINCIPLED"}
    return any(node.type in wanted for node in nodes_of(group))


def _shine(tree: NodeTree, colour: NodeSocket, share: Source, limit: float | None) -> NodeSocket:
    """Emission of the colour times the share.

    For all rays except camera rays it is at most `limit` in each channel.
    """
    if limit is not None:
        colour = scaled(tree, colour, share)
        share = 1.0
        seen = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        colour = _blend(tree, seen, vectors(tree, "MINIMUM", colour, (limit,) * 3), colour)
    return add_node(tree, "Emission", colour, share)


def _light_sockets(tree: NodeTree, baked: BakedLight) -> tuple[NodeSocket, NodeSocket]:
    """Sockets of the light on the side that is seen, and on the other side.

    Each reads the map once: the position is chosen, not the colour.
    """
    how = {"image": baked.image, "interpolation": "Linear", "extension": "EXTEND"}
    front = add_node(tree, "UVMap", uv_map=FRONT_UV)
    if not baked.two_sided:
        light = add_node(tree, "TexImage", front, **how)
        return light, light
    facing = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    back = add_node(tree, "UVMap", uv_map=BACK_UV)
    seen = _blend(tree, facing, front, back)
    other = _blend(tree, facing, back, front)
    light = add_node(tree, "TexImage", seen, **how)
    return light, add_node(tree, "TexImage", other, **how)


def _blend(tree: NodeTree, share: NodeSocket, a: NodeSocket, b: NodeSocket) -> NodeSocket:
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "VECTOR"
    mix.factor_mode = "UNIFORM"
    for source, target in zip((share, a, b), [s for s in mix.inputs if s.enabled], strict=True):
        tree.links.new(source, target)
    return next(s for s in mix.outputs if s.enabled)


# Principled surfaces


def _bake_principled(tree: NodeTree, node: Node, light: NodeSocket, limit: float | None) -> None:
    """Principled = its unchanged gloss, metal and glass, plus the light map times its diffuse
    share.
    """
    colour = vectors(tree, "MULTIPLY", node.inputs["Base Color"], light)
    share = _diffuse_share(tree, node)
    targets = [link.to_socket for link in node.outputs[0].links]
    shine = _shine(tree, colour, share, limit)
    both = add_node(tree, "AddShader", shine, _without_diffuse(tree, node))
    for target in targets:
        tree.links.new(both, target)


def _bake_for_gathering(tree: NodeTree, node: Node, light: NodeSocket, limit: float | None) -> None:
    """The material for gathering: gloss and metal reflect light to other surfaces as if they were
    diffuse.

    (metal colour + (1 - metal) (colour (1 - albedo) + albedo)) (1 - glass) alpha x light, plus its
    emission.
    """
    gloss = product(tree, _gloss(tree, node), one_minus(tree, constant_or_input(node, "Metallic")))
    base = scaled(tree, vectors(tree, "ADD", node.inputs["Base Color"]), one_minus(tree, gloss))
    sent = vectors(tree, "ADD", base, scaled(tree, (1.0, 1.0, 1.0), gloss))
    not_glass = one_minus(tree, constant_or_input(node, "Transmission Weight"))
    share = product(tree, not_glass, constant_or_input(node, "Alpha"))
    shine = _shine(tree, vectors(tree, "MULTIPLY", sent, light), share, limit)
    for name in ("Metallic", "Subsurface Weight"):
        set_constant(node.inputs[name], 0.0)
    set_constant(node.inputs["Base Color"], _BLACK)
    both = add_node(tree, "AddShader", shine)
    redirect(node.outputs[0], both)
    tree.links.new(node.outputs[0], both.node.inputs[1])


def _diffuse_share(tree: NodeTree, node: Node) -> Source:
    """(1 - metal)(1 - glass) alpha (1 - gloss)(1 - coat): the share of the diffuse base, seen from
    the camera.
    """
    coat = constant_or_input(node, "Coat Weight")
    if coat != 0.0:
        f0 = materials.f0(node.inputs["Coat IOR"])
        roughness = constant_or_input(node, "Coat Roughness")
        coat = product(tree, coat, _albedo(tree, f0, roughness, node.inputs["Coat Normal"]))
    metal = constant_or_input(node, "Metallic")
    glass = constant_or_input(node, "Transmission Weight")
    covers = [metal, glass, _gloss(tree, node), coat]
    uncovered = [one_minus(tree, cover) for cover in covers]
    return product(tree, *uncovered, constant_or_input(node, "Alpha"))


def _gloss(tree: NodeTree, node: Node) -> Source:
    level = constant(node.inputs["Specular IOR Level"])
    f0 = min(materials.f0(node.inputs["IOR"]) * 2 * (0.5 if level is None else level), 1.0)
    return _albedo(tree, f0, constant_or_input(node, "Roughness"), node.inputs["Normal"])


def _albedo(tree: NodeTree, f0: float, roughness: Source, normal: NodeSocket) -> Source:
    """The albedo of a rough dielectric surface, seen from the camera."""
    if f0 <= 0.0:
        return 0.0
    layer = tree.nodes.new("ShaderNodeLayerWeight")
    layer.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
    if normal.is_linked:
        feed(tree, normal, layer.inputs["Normal"])
    # a - b cos = (a - b) + b facing
    slope = polynomial(tree, _B, roughness)
    start = polynomial(tree, _A_MINUS_B, roughness)
    exponent = calculate(tree, "MULTIPLY_ADD", layer.outputs["Facing"], slope, start)
    rim = calculate(tree, "EXPONENT", exponent)
    head_on = product(tree, f0, polynomial(tree, _H, roughness))
    return calculate(tree, "MULTIPLY_ADD", rim, 1.0 - f0, head_on)


def _without_diffuse(tree: NodeTree, node: Node) -> NodeSocket:
    """The node's closures except the diffuse one: with a black base, mixed with the same node as
    pure metal and as pure glass.
    """
    result = node.outputs[0]
    for name in ("Transmission Weight", "Metallic"):
        if constant(node.inputs[name]) == 0.0:
            continue
        pure = tree.nodes.new(node.bl_idname)
        pure.distribution = node.distribution
        for source, target in zip(node.inputs, pure.inputs, strict=True):
            if source.is_linked or hasattr(source, "default_value"):
                feed(tree, source, target)
        set_constant(pure.inputs[name], 1.0)
        if name == "Transmission Weight":
            set_constant(pure.inputs["Metallic"], 0.0)
        result = add_node(tree, "MixShader", node.inputs[name], result, pure.outputs[0])
    for name in ("Transmission Weight", "Metallic", "Subsurface Weight"):
        set_constant(node.inputs[name], 0.0)
    set_constant(node.inputs["Base Color"], _BLACK)
    return result
