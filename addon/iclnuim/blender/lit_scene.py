"""The open scene shown with a light map, in memory only: every surface a copy with the map's UVs and materials that show baked light.

In such a material every diffuse part becomes emission of its colour times the light map; the rest stays traced. Of a Principled surface
the diffuse share becomes emission, its gloss, metal and glass stay ray traced. Cycles dims the diffuse base by the albedo of the gloss
above it, seen from the camera: that of a rough surface, which at grazing angles is far from Fresnel's reflection. Here it is a formula
of roughness and angle, fitted to what Cycles 4.5 itself shows in a white furnace (20 materials, 19 angles each): off by 0.008 RMS and
at most 0.036, beyond 80 degrees.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

import bpy
import numpy as np
from bpy.types import Image, Material, Node, NodeSocket, NodeTree

from ..errors import WorkError
from ..lightmap.surfaces import BACK, FRONT
from . import surfaces
from .compat import matt_material, nodes_of, redirect, unlink
from .surfaces import Part, array_of, material_of_face

_OBJECT_SETTINGS = (
    "pass_index", "color", "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission",
    "visible_volume_scatter", "visible_shadow", "is_holdout", "is_shadow_catcher",
)  # fmt: skip
FRONT_UV, BACK_UV = "light map", "light map back"
_DIFFUSE = {"BSDF_DIFFUSE", "SUBSURFACE_SCATTERING"}
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)
#: Albedo of gloss = F0 * h(r) + (1 - F0) * exp(a(r) - b(r) cos), polynomials of the roughness r.
_H = (1.019, 0.207, -0.801)
_A = (0.108, -0.681, -8.445, 6.591)
_B = (6.599, -8.765, 6.947)
#: What can be fed into a node: a constant, an output, or an input whose source is shared.
Source: TypeAlias = float | tuple[float, ...] | NodeSocket


@dataclass(frozen=True, eq=False)
class MapLayout:
    """Where the corners (C,) of all parts lie in the map: uv (2, C, 2) for front and back, 0..1; has (2, C) which sides do.

    part_corners: how many corners each part has.
    """

    uv: np.ndarray
    has: np.ndarray
    part_corners: tuple[int, ...]


@dataclass(eq=False)
class LitScene:
    """What was added and hidden, so that `revert` can undo it."""

    made: list[bpy.types.ID] = field(default_factory=list)
    hidden: list[tuple[bpy.types.Object, str, bool]] = field(default_factory=list)

    def revert(self) -> None:
        """The scene as it was before."""
        bpy.data.batch_remove(self.made)
        for thing, name, hide in self.hidden:
            thing.name, thing.hide_render = name, hide
        self.made, self.hidden = [], []


def show(
    found: list[Part], layout: MapLayout, image: bpy.types.Image, gathering: bool = False, limit: float | None = None
) -> LitScene:
    """Show the parts lit by `image`, to a camera or as others gather light from them; limit: as of baked_copy. Takes over the parts' meshes.

    Raises WorkError where the layout is for another scene."""
    corners = tuple(len(part.mesh.loops) for part in found)
    if corners != layout.part_corners:
        expected = f"a scene of {len(layout.part_corners)} parts as it was baked"
        raise WorkError(f"light map: expected {expected}, found {len(found)} of another shape")
    lit = LitScene()
    materials: dict[tuple, bpy.types.Material] = {}
    starts = np.cumsum((0, *corners))
    for part, start in zip(found, starts[:-1], strict=True):
        if not any(part.origin == thing for thing, _, _ in lit.hidden):
            lit.hidden.append((part.origin, part.origin.name, part.origin.hide_render))
            part.origin.hide_render = True
            part.origin.name = part.name + ".unlit" if part.single else part.origin.name
        corners_of_part = slice(start, start + len(part.mesh.loops))
        two_sided = _add_uvs(part.mesh, layout, corners_of_part)
        slots = np.repeat(material_of_face(part), array_of(part.mesh.polygons, "loop_total", 1, np.int32))
        for slot in set(np.unique(slots[layout.has[:, corners_of_part].any(0)])):  # those of which a side is in the map
            original = part.mesh.materials[slot] if slot >= 0 else None
            key = (original, two_sided)
            if key not in materials:
                materials[key] = baked_copy(original, image, two_sided, gathering, limit)
            if slot >= 0:
                part.mesh.materials[slot] = materials[key]
            else:
                part.mesh.materials.append(materials[key])
        thing = bpy.data.objects.new(part.name, part.mesh)
        _copy_settings(part.source, thing)
        lit.made.extend([thing, part.mesh, *surfaces.put(thing, part.matrix)])
        bpy.context.scene.collection.objects.link(thing)
    lit.made.extend(materials.values())
    return lit


def set_pixels(image: bpy.types.Image, light: np.ndarray) -> None:
    """New light (rows, columns, 3), row 0 at the bottom, in an image of the same size. A render with persistent data would not see it; baking does."""
    pixels = np.ones((*light.shape[:2], 4), np.float32)
    pixels[..., :3] = light
    image.pixels.foreach_set(pixels.ravel())
    image.update()


def _add_uvs(mesh: bpy.types.Mesh, layout: MapLayout, corners: slice) -> bool:
    """Whether it has two sides. A side without a chart is never seen: it takes the other side's place."""
    two_sided = bool(layout.has[BACK, corners].any())
    for side, name in ((FRONT, FRONT_UV), (BACK, BACK_UV))[: 1 + two_sided]:
        has = layout.has[side, corners]
        uv = np.where(has[:, None], layout.uv[side, corners], layout.uv[1 - side, corners])
        layer = mesh.uv_layers.new(name=name, do_init=False)
        if layer is None:
            raise WorkError(f"light map: the mesh {mesh.name} has no room for one more UV map; remove one")
        layer.data.foreach_set("uv", uv.astype(np.float32).ravel())
    return two_sided


def _copy_settings(source: bpy.types.Object, target: bpy.types.Object) -> None:
    for name in _OBJECT_SETTINGS:
        if hasattr(source, name):
            setattr(target, name, getattr(source, name))
    for name in ("shadow_terminator_offset", "shadow_terminator_geometry_offset"):
        for old, new in ((source, target), (getattr(source, "cycles", None), getattr(target, "cycles", None))):
            if hasattr(old, name) and hasattr(new, name):
                setattr(new, name, getattr(old, name))


# Materials


def kind(material: Material | None) -> tuple[bool, bool, bool]:
    """Whether it shows light from the side it is seen from, and from its other side; whether it sends light to others.

    No material, or one without nodes, is plain diffuse.
    """
    tree = _tree(material)
    if tree is None:
        return True, False, True
    nodes = nodes_of(tree)
    types, principled = {n.type for n in nodes}, [n for n in nodes if n.type == "BSDF_PRINCIPLED"]
    diffuse, translucent = bool(types & _DIFFUSE), "BSDF_TRANSLUCENT" in types
    sends = diffuse or translucent or any(map(_reflects, principled))
    return diffuse or any(map(_has_diffuse, principled)), translucent, sends


def baked_copy(
    material: Material | None, image: Image, two_sided: bool, gathering: bool = False, limit: float | None = None
) -> Material:
    """A copy that shows `image` through the UV maps FRONT_UV and, where two_sided, BACK_UV. The original stays as it is.

    gathering: as light from it falls on others, not as a camera sees it. limit: of what reflections and glass show of it, as Cycles clamps
    light that bounced; the spot beside a bare lamp would be specks in gloss.
    """
    name = f"{material.name if material else 'no material'} (baked)"
    if material is None or _tree(material) is None:  # what Cycles shows for it
        copy = matt_material(name, material.diffuse_color if material is not None else _PLAIN_GREY)[0]
    else:
        copy = material.copy()
        copy.name = name
    copy.cycles.emission_sampling = "NONE"  # taken for a lamp, each surface would cost a second a frame
    _bake_tree(copy.node_tree, image, two_sided, gathering, limit)
    return copy


def let_light_through(materials: Iterable[Material]) -> list[str]:
    """Glass that lamps and sky shine through unbent, dimmed by its colour and its reflection: no caustics are sampled, so light would
    not pass at all. Cameras and gloss see it as before. Names of the materials changed.
    """
    changed, done = [], set()
    for material in materials:
        glass = [node for node in nodes_of(material.node_tree) if is_glass(node)]
        for node in (node for node in glass if node not in done):
            _let_through(node.id_data, node)
        done.update(glass)
        if glass:
            material.use_transparent_shadow = True
            changed.append(material.name)
    return changed


def is_glass(node: Node) -> bool:
    """A shader that light passes through, at least in part."""
    if node.type == "BSDF_PRINCIPLED":
        return _constant(node.inputs["Transmission Weight"]) != 0.0 and _constant(node.inputs["Metallic"]) != 1.0
    return node.type in {"BSDF_GLASS", "BSDF_REFRACTION"}


def _let_through(tree: NodeTree, node: Node) -> None:
    """Shadow rays and those that diffuse surfaces send find a Transparent BSDF in place of the glass."""
    targets, rays = [link.to_socket for link in node.outputs[0].links], tree.nodes.new("ShaderNodeLightPath")
    share: Source = _calculate(tree, "MAXIMUM", rays.outputs["Is Shadow Ray"], rays.outputs["Is Diffuse Ray"])
    colour: Source = node.inputs["Base Color" if node.type == "BSDF_PRINCIPLED" else "Color"]
    if node.type == "BSDF_PRINCIPLED":  # its colour is that of two surfaces
        share = _product(tree, share, _input(node, "Transmission Weight"), _one_minus(tree, _input(node, "Metallic")))
        colour = _node(tree, "Gamma", colour, 0.5)
    if node.type != "BSDF_REFRACTION":  # Schlick's formula: the same from both sides, for panes are often single faces
        facing = tree.nodes.new("ShaderNodeLayerWeight")
        facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
        passing = _one_minus(tree, _calculate(tree, "POWER", facing.outputs["Facing"], 5.0))
        colour = _scaled(tree, colour, _product(tree, 1.0 - _f0(node.inputs["IOR"]), passing))
    mixed = _node(tree, "MixShader", share, node.outputs[0], _node(tree, "BsdfTransparent", colour))
    for target in targets:
        tree.links.new(mixed, target)


def _tree(material: Material | None) -> NodeTree | None:
    return material.node_tree if material is not None and material.use_nodes else None


def _bake_tree(tree: NodeTree, image: Image, two_sided: bool, gathering: bool, limit: float | None) -> None:
    bake, lit = (_bake_for_gathering, _reflects) if gathering else (_bake_principled, _has_diffuse)
    light = None
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree:
            if {n.type for n in nodes_of(node.node_tree)} & {*_DIFFUSE, "BSDF_TRANSLUCENT", "BSDF_PRINCIPLED"}:
                node.node_tree = node.node_tree.copy()
                _bake_tree(node.node_tree, image, two_sided, gathering, limit)
        elif node.type == "BSDF_PRINCIPLED" and lit(node):
            light = light or _light_sockets(tree, image, two_sided)
            bake(tree, node, light[0], limit)
        elif node.type in {*_DIFFUSE, "BSDF_TRANSLUCENT"}:
            light = light or _light_sockets(tree, image, two_sided)
            side = light[node.type == "BSDF_TRANSLUCENT"]
            shine = _shine(tree, _vectors(tree, "MULTIPLY", node.inputs["Color"], side), limit)
            redirect(node.outputs[0], shine)
            tree.nodes.remove(node)


def _shine(tree: NodeTree, colour: NodeSocket, limit: float | None) -> NodeSocket:
    """Emission of the colour; seen otherwise than by the camera itself, of at most `limit` in each channel."""
    if limit is not None:
        seen = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        colour = _blend(tree, seen, _vectors(tree, "MINIMUM", colour, (limit,) * 3), colour)
    return _node(tree, "Emission", colour)


def _light_sockets(tree: NodeTree, image: Image, two_sided: bool) -> tuple:
    """Sockets of the light on the side that is seen, and on the other one."""
    maps = []
    for name in (FRONT_UV, BACK_UV)[: 1 + two_sided]:
        uv = _node(tree, "UVMap", uv_map=name)
        maps.append(_node(tree, "TexImage", uv, image=image, interpolation="Linear", extension="EXTEND"))
    if not two_sided:
        return maps[0], maps[0]
    facing = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    return _blend(tree, facing, *maps), _blend(tree, facing, *maps[::-1])


def _blend(tree: NodeTree, share: NodeSocket, a: NodeSocket, b: NodeSocket) -> NodeSocket:
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.factor_mode = "VECTOR", "UNIFORM"
    for source, target in zip((share, a, b), [s for s in mix.inputs if s.enabled], strict=True):
        tree.links.new(source, target)
    return next(s for s in mix.outputs if s.enabled)


# Principled surfaces


def _has_diffuse(principled: Node) -> bool:
    """False only where it is metal or glass throughout."""
    return not any(_constant(principled.inputs[name]) == 1.0 for name in ("Metallic", "Transmission Weight"))


def _reflects(principled: Node) -> bool:
    """False only where it is glass throughout: what is metal sends light to others, too."""
    return _constant(principled.inputs["Transmission Weight"]) != 1.0


def _bake_principled(tree: NodeTree, node: Node, light: NodeSocket, limit: float | None) -> None:
    """Principled = its gloss, metal and glass as they are, plus the light map on its diffuse share."""
    colour = _scaled(tree, _vectors(tree, "MULTIPLY", node.inputs["Base Color"], light), _diffuse_share(tree, node))
    targets = [link.to_socket for link in node.outputs[0].links]
    both = _node(tree, "AddShader", _shine(tree, colour, limit), _without_diffuse(tree, node))
    for target in targets:
        tree.links.new(both, target)


def _bake_for_gathering(tree: NodeTree, node: Node, light: NodeSocket, limit: float | None) -> None:
    """As others see it when light is gathered: gloss and metal send on what falls on them, too, as if they were dull.

    (metal colour + (1 - metal) (colour (1 - albedo) + albedo)) (1 - glass) alpha x light, plus its own glow.
    """
    gloss = _product(tree, _gloss(tree, node), _one_minus(tree, _input(node, "Metallic")))
    base = _scaled(tree, _vectors(tree, "ADD", node.inputs["Base Color"]), _one_minus(tree, gloss))
    sent = _vectors(tree, "ADD", base, _scaled(tree, (1.0, 1.0, 1.0), gloss))
    share = _product(tree, _one_minus(tree, _input(node, "Transmission Weight")), _input(node, "Alpha"))
    shine = _shine(tree, _scaled(tree, _vectors(tree, "MULTIPLY", sent, light), share), limit)
    for name in ("Metallic", "Subsurface Weight"):
        _put(node.inputs[name], 0.0)
    _put(node.inputs["Base Color"], _BLACK)
    both = _node(tree, "AddShader", shine)
    redirect(node.outputs[0], both)
    tree.links.new(node.outputs[0], both.node.inputs[1])


def _diffuse_share(tree: NodeTree, node: Node) -> Source:
    """(1 - metal)(1 - glass) alpha (1 - gloss)(1 - coat): what light the diffuse base gets and gives, seen from here."""
    coat = _input(node, "Coat Weight")
    if coat != 0.0:
        f0, normal = _f0(node.inputs["Coat IOR"]), node.inputs["Coat Normal"]
        coat = _product(tree, coat, _albedo(tree, f0, _input(node, "Coat Roughness"), normal))
    covers = [_input(node, "Metallic"), _input(node, "Transmission Weight"), _gloss(tree, node), coat]
    return _product(tree, *(_one_minus(tree, c) for c in covers), _input(node, "Alpha"))


def _gloss(tree: NodeTree, node: Node) -> Source:
    level = _constant(node.inputs["Specular IOR Level"])
    f0 = min(_f0(node.inputs["IOR"]) * 2 * (0.5 if level is None else level), 1.0)
    return _albedo(tree, f0, _input(node, "Roughness"), node.inputs["Normal"])


def _albedo(tree: NodeTree, f0: float, roughness: Source, normal: NodeSocket) -> Source:
    """Of a rough dielectric surface, seen from the camera."""
    if f0 <= 0.0:
        return 0.0
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
    if normal.is_linked:
        _feed(tree, normal, facing.inputs["Normal"])
    cosine = _calculate(tree, "SUBTRACT", 1.0, facing.outputs["Facing"])
    exponent = _calculate(tree, "MULTIPLY", _polynomial(tree, tuple(-b for b in _B), roughness), cosine)
    exponent = _calculate(tree, "ADD", exponent, _polynomial(tree, _A, roughness))
    rim = _product(tree, 1.0 - f0, _calculate(tree, "EXPONENT", exponent))
    return _calculate(tree, "ADD", _product(tree, f0, _polynomial(tree, _H, roughness)), rim)


def _f0(ior: NodeSocket) -> float:
    """Reflection straight on; a linked IOR counts with the value below the link."""
    return float(((ior.default_value - 1) / (ior.default_value + 1)) ** 2)


def _without_diffuse(tree: NodeTree, node: Node) -> NodeSocket:
    """The node's closures but the diffuse one: a black base, mixed with the same node as pure metal and as pure glass."""
    result = node.outputs[0]
    for name in ("Transmission Weight", "Metallic"):
        if _constant(node.inputs[name]) == 0.0:
            continue
        pure = tree.nodes.new(node.bl_idname)
        pure.distribution = node.distribution
        for source, target in zip(node.inputs, pure.inputs, strict=True):
            if source.is_linked or hasattr(source, "default_value"):
                _feed(tree, source, target)
        _put(pure.inputs[name], 1.0)
        if name == "Transmission Weight":
            _put(pure.inputs["Metallic"], 0.0)
        result = _node(tree, "MixShader", node.inputs[name], result, pure.outputs[0])
    for name in ("Transmission Weight", "Metallic", "Subsurface Weight"):
        _put(node.inputs[name], 0.0)
    _put(node.inputs["Base Color"], _BLACK)
    return result


# Arithmetic in node trees: every function adds nodes and returns the socket of the result.


def _feed(tree: NodeTree, source: Source, target: NodeSocket) -> None:
    """Give `target` a constant, an output, or what feeds another input: its link, or its value, grey where only one is a colour."""
    if isinstance(source, NodeSocket) and (source.is_output or source.is_linked):
        tree.links.new(source if source.is_output else source.links[0].from_socket, target)
        return
    value, wanted = source.default_value if isinstance(source, NodeSocket) else source, target.default_value
    if isinstance(wanted, int | float):  # bpy 5.2 has switches among them
        target.default_value = value if isinstance(value, int | float) else sum(tuple(value)[:3]) / 3
    elif isinstance(value, int | float):
        target.default_value = (value,) * 3 + (1.0,) * (len(wanted) - 3)
    else:
        target.default_value = (*tuple(value)[: len(wanted)], *(1.0,) * (len(wanted) - len(value)))


def _put(socket: NodeSocket, value: float | tuple) -> None:
    """A constant in place of whatever fed an input."""
    unlink(socket)
    socket.default_value = value


def _constant(socket: NodeSocket) -> float | None:
    """The value of an input, None where it is linked."""
    return None if socket.is_linked else float(socket.default_value)


def _input(node: Node, name: str) -> Source:
    value = _constant(node.inputs[name])
    return node.inputs[name] if value is None else value


def _node(tree: NodeTree, kind: str, *sources: Source, **settings: object) -> NodeSocket:
    """A node's first output; its first inputs are fed with the sources."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in settings.items():
        setattr(node, name, value)
    for source, target in zip(sources, node.inputs, strict=False):
        _feed(tree, source, target)
    return node.outputs[0]


def _calculate(tree: NodeTree, operation: str, *sources: Source) -> NodeSocket:
    """A Math node: `ADD`, `MULTIPLY_ADD`, `EXPONENT`, ..."""
    return _node(tree, "Math", *sources, operation=operation)


def _vectors(tree: NodeTree, operation: str, *sources: Source) -> NodeSocket:
    """A Vector Math node on colours: `ADD`, `MULTIPLY`."""
    return _node(tree, "VectorMath", *sources, operation=operation)


def _scaled(tree: NodeTree, vector: Source, factor: Source) -> Source:
    """A colour times a number."""
    if isinstance(factor, int | float) and factor == 1.0:
        return vector
    result = _vectors(tree, "SCALE", vector)
    _feed(tree, factor, result.node.inputs["Scale"])
    return result


def _product(tree: NodeTree, *sources: Source) -> Source:
    """Of numbers; constants are multiplied here, and 1 costs no node."""
    known = math.prod(s for s in sources if isinstance(s, int | float))
    rest = [s for s in sources if not isinstance(s, int | float)]
    result: Source = known if known != 1.0 or not rest else rest.pop(0)
    for source in rest:
        result = _calculate(tree, "MULTIPLY", result, source)
    return result


def _one_minus(tree: NodeTree, source: Source) -> Source:
    return 1.0 - source if isinstance(source, int | float) else _calculate(tree, "SUBTRACT", 1.0, source)


def _polynomial(tree: NodeTree, coefficients: tuple[float, ...], x: Source) -> Source:
    """c0 + c1 x + c2 x^2 ..., by Horner's rule; a number where x is one."""
    if isinstance(x, int | float):
        return float(sum(c * x**k for k, c in enumerate(coefficients)))
    result: Source = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = _calculate(tree, "MULTIPLY_ADD", result, x, c)
    return result
