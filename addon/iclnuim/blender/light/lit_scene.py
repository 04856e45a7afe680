"""Shows the open scene with a light map, in memory only: every surface is replaced by a copy with
the map's UVs and materials that show baked
light.

In such a material every diffuse part is replaced by emission of its colour times the light map; the
rest is still ray traced. For a Principled surface, the diffuse part becomes emission; gloss, metal
and glass are still ray traced. Cycles reduces the diffuse base by the albedo of the gloss above it,
as seen from the camera. For a rough surface at grazing angles, this albedo is far from Fresnel
reflection. Here it is a formula of roughness and angle, fitted to renders by Cycles 4.5 in a white
furnace (20 materials, 19 angles each): its error is 0.008 RMS and at most 0.036, beyond 80 degrees.
"""

from dataclasses import dataclass, field

import bpy
import numpy as np
from bpy.types import Image, Material, Node, NodeSocket, NodeTree

from ...errors import WorkError
from ...lightmap.surfaces import BACK, FRONT
from .. import materials, surfaces
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
from ..surfaces import Part, array_of, material_of_face

_OBJECT_SETTINGS = (
    "pass_index", "color", "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission",
    "visible_volume_scatter", "visible_shadow", "is_holdout", "is_shadow_catcher",
)  # fmt: skip
FRONT_UV, BACK_UV = "light map", "light map back"
_PLAIN_GREY = (0.8, 0.8, 0.8, 1.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)
#: Albedo of gloss = F0 * h(r) + (1 - F0) * exp(a(r) - b(r) cos), polynomials of the roughness r.
_H = (1.019, 0.207, -0.801)
_A = (0.108, -0.681, -8.445, 6.591)
_B = (6.599, -8.765, 6.947)
_A_MINUS_B = tuple(np.polynomial.polynomial.polysub(_A, _B).tolist())


@dataclass(frozen=True, eq=False)
class MapLayout:
    """The positions of the corners (C,) of all parts in the map: uv (2, C, 2) for front and back,
    0..1; has (2, C): whether the side has texels.

    part_corners: the number of corners of each part.
    """

    uv: np.ndarray
    has: np.ndarray
    part_corners: tuple[int, ...]


@dataclass(eq=False)
class LitScene:
    """The datablocks that were added and the objects that were hidden, so that `revert` can undo
    this.
    """

    made: list[bpy.types.ID] = field(default_factory=list)
    hidden: list[tuple[bpy.types.Object, str, bool]] = field(default_factory=list)

    def revert(self) -> None:
        """Restore the scene."""
        bpy.data.batch_remove(self.made)
        for thing, name, hide in self.hidden:
            thing.name, thing.hide_render = name, hide
        self.made, self.hidden = [], []


def show(
    found: list[Part],
    layout: MapLayout,
    image: bpy.types.Image,
    gathering: bool = False,
    limit: float | None = None,
) -> LitScene:
    """Show the parts lit by `image`, to a camera or for gathering light from them; limit: as in
    baked_copy. The parts' meshes are used, not copied.

    Raises WorkError if the layout is for another scene."""
    corners = tuple(len(part.mesh.loops) for part in found)
    if corners != layout.part_corners:
        expected = f"the baked scene of {len(layout.part_corners)} parts"
        raise WorkError(
            f"light map: expected {expected}, found {len(found)} parts with other meshes"
        )
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
        slots = np.repeat(
            material_of_face(part), array_of(part.mesh.polygons, "loop_total", 1, np.int32)
        )
        for slot in set(
            np.unique(slots[layout.has[:, corners_of_part].any(0)])
        ):  # slots of faces that have a side in the map
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
    """Write new light (rows, columns, 3), row 0 at the bottom, into an image of the same size.
    Baking uses it; a render with persistent data would
    not.
    """
    pixels = np.ones((*light.shape[:2], 4), np.float32)
    pixels[..., :3] = light
    image.pixels.foreach_set(pixels.ravel())
    image.update()


def _add_uvs(mesh: bpy.types.Mesh, layout: MapLayout, corners: slice) -> bool:
    """Add the UV maps.

    Returns whether the back has texels. A side without a chart is never visible and gets the
    position of the other side.
    """
    two_sided = bool(layout.has[BACK, corners].any())
    for side, name in ((FRONT, FRONT_UV), (BACK, BACK_UV))[: 1 + two_sided]:
        has = layout.has[side, corners]
        uv = np.where(has[:, None], layout.uv[side, corners], layout.uv[1 - side, corners])
        layer = mesh.uv_layers.new(name=name, do_init=False)
        if layer is None:
            raise WorkError(
                f"light map: the mesh {mesh.name} has no room for one more UV map; remove one"
            )
        layer.data.foreach_set("uv", uv.astype(np.float32).ravel())
    return two_sided


def _copy_settings(source: bpy.types.Object, target: bpy.types.Object) -> None:
    for name in _OBJECT_SETTINGS:
        if hasattr(source, name):
            setattr(target, name, getattr(source, name))
    for name in ("shadow_terminator_offset", "shadow_terminator_geometry_offset"):
        for old, new in (
            (source, target),
            (getattr(source, "cycles", None), getattr(target, "cycles", None)),
        ):
            if hasattr(old, name) and hasattr(new, name):
                setattr(new, name, getattr(old, name))


# Materials


def baked_copy(
    material: Material | None,
    image: Image,
    two_sided: bool,
    gathering: bool = False,
    limit: float | None = None,
) -> Material:
    """A copy of the material that shows `image` through the UV map FRONT_UV and, if two_sided,
    BACK_UV. The original is not changed.

    gathering: the light that falls on other surfaces, instead of the view of a camera. limit:
    maximum of the light that is seen in reflections and through glass, like Cycles' clamp of
    indirect light; otherwise bright spots next to lamps would cause fireflies in gloss.
    """
    name = f"{material.name if material else 'no material'} (baked)"
    if material is None or materials.tree_of(material) is None:  # the appearance in Cycles
        copy = matt_material(name, material.diffuse_color if material is not None else _PLAIN_GREY)[
            0
        ]
    else:
        copy = material.copy()
        copy.name = name
    copy.cycles.emission_sampling = (
        "NONE"  # sampled as a lamp, each surface would take a second per frame
    )
    _bake_tree(copy.node_tree, image, two_sided, gathering, limit)
    return copy


def _bake_tree(
    tree: NodeTree, image: Image, two_sided: bool, gathering: bool, limit: float | None
) -> None:
    bake, lit = (
        (_bake_for_gathering, materials.reflects)
        if gathering
        else (_bake_principled, materials.has_diffuse)
    )
    light = None
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree:
            if {n.type for n in nodes_of(node.node_tree)} & {
                *materials.DIFFUSE,
                "BSDF_TRANSLUCENT",
                "BSDF_PRINCIPLED",
            }:
                node.node_tree = node.node_tree.copy()
                _bake_tree(node.node_tree, image, two_sided, gathering, limit)
        elif node.type == "BSDF_PRINCIPLED" and lit(node):
            light = light or _light_sockets(tree, image, two_sided)
            bake(tree, node, light[0], limit)
        elif node.type in {*materials.DIFFUSE, "BSDF_TRANSLUCENT"}:
            light = light or _light_sockets(tree, image, two_sided)
            side = light[node.type == "BSDF_TRANSLUCENT"]
            shine = _shine(tree, vectors(tree, "MULTIPLY", node.inputs["Color"], side), 1.0, limit)
            redirect(node.outputs[0], shine)
            tree.nodes.remove(node)


def _shine(tree: NodeTree, colour: NodeSocket, share: Source, limit: float | None) -> NodeSocket:
    """Emission of the colour times the share.

    For all rays except camera rays it is at most `limit` in each channel.
    """
    if limit is not None:
        colour, share = scaled(tree, colour, share), 1.0
        seen = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        colour = _blend(tree, seen, vectors(tree, "MINIMUM", colour, (limit,) * 3), colour)
    return add_node(tree, "Emission", colour, share)


def _light_sockets(tree: NodeTree, image: Image, two_sided: bool) -> tuple[NodeSocket, NodeSocket]:
    """Sockets of the light on the side that is seen, and on the other side.

    Each reads the map once: the position is chosen, not the colour.
    """
    seen = other = add_node(tree, "UVMap", uv_map=FRONT_UV)
    if two_sided:
        facing = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
        sides = seen, add_node(tree, "UVMap", uv_map=BACK_UV)
        seen, other = _blend(tree, facing, *sides), _blend(tree, facing, *sides[::-1])
    how = {"image": image, "interpolation": "Linear", "extension": "EXTEND"}
    light = add_node(tree, "TexImage", seen, **how)
    return light, (add_node(tree, "TexImage", other, **how) if two_sided else light)


def _blend(tree: NodeTree, share: NodeSocket, a: NodeSocket, b: NodeSocket) -> NodeSocket:
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.factor_mode = "VECTOR", "UNIFORM"
    for source, target in zip((share, a, b), [s for s in mix.inputs if s.enabled], strict=True):
        tree.links.new(source, target)
    return next(s for s in mix.outputs if s.enabled)


# Principled surfaces


def _bake_principled(tree: NodeTree, node: Node, light: NodeSocket, limit: float | None) -> None:
    """Principled = its unchanged gloss, metal and glass, plus the light map times its diffuse
    share.
    """
    colour, share = (
        vectors(tree, "MULTIPLY", node.inputs["Base Color"], light),
        _diffuse_share(tree, node),
    )
    targets = [link.to_socket for link in node.outputs[0].links]
    both = add_node(
        tree, "AddShader", _shine(tree, colour, share, limit), _without_diffuse(tree, node)
    )
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
    share = product(
        tree,
        one_minus(tree, constant_or_input(node, "Transmission Weight")),
        constant_or_input(node, "Alpha"),
    )
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
        f0, normal = materials.f0(node.inputs["Coat IOR"]), node.inputs["Coat Normal"]
        coat = product(
            tree, coat, _albedo(tree, f0, constant_or_input(node, "Coat Roughness"), normal)
        )
    covers = [
        constant_or_input(node, "Metallic"),
        constant_or_input(node, "Transmission Weight"),
        _gloss(tree, node),
        coat,
    ]
    return product(tree, *(one_minus(tree, c) for c in covers), constant_or_input(node, "Alpha"))


def _gloss(tree: NodeTree, node: Node) -> Source:
    level = constant(node.inputs["Specular IOR Level"])
    f0 = min(materials.f0(node.inputs["IOR"]) * 2 * (0.5 if level is None else level), 1.0)
    return _albedo(tree, f0, constant_or_input(node, "Roughness"), node.inputs["Normal"])


def _albedo(tree: NodeTree, f0: float, roughness: Source, normal: NodeSocket) -> Source:
    """The albedo of a rough dielectric surface, seen from the camera."""
    if f0 <= 0.0:
        return 0.0
    facing = tree.nodes.new("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
    if normal.is_linked:
        feed(tree, normal, facing.inputs["Normal"])
    # a - b cos = (a - b) + b facing
    slope, start = polynomial(tree, _B, roughness), polynomial(tree, _A_MINUS_B, roughness)
    rim = calculate(
        tree, "EXPONENT", calculate(tree, "MULTIPLY_ADD", facing.outputs["Facing"], slope, start)
    )
    return calculate(
        tree, "MULTIPLY_ADD", rim, 1.0 - f0, product(tree, f0, polynomial(tree, _H, roughness))
    )


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
