"""Textures filtered for the distance at which they are seen, in memory only: Cycles reads one texel
per ray, however many lie within a pixel.

Each texture is replaced by an image that also holds smaller versions of itself (levels of mipmaps,
Williams 1983), each half as wide as the one before. A pixel reads the finest level whose texels are
at least as wide as half of the pixel's width on the surface, its footprint. This width is computed
from the length of the ray and from how densely the texture covers each face. Foreshortening is not
considered: it would blur surfaces seen at a grazing angle along both directions.

The footprint is multiplied by noise that is fixed on the surface, over one octave: at a constant
footprint the level would change on a line that is visible as a jump of contrast, and that stays in
its place in the image while the surface moves.

Image: side by side, from right to left, levels 0, 1, ..., each with margins. Level k is smaller by
s = 2^-k, and begins at s times the width of level 0, so a position in it is s p in units of the
image's width, if p is the position in level 0. No position is outside, so the image is not
repeated: that would take Cycles a division for every coordinate.

Cycles takes time for each node and for each constant of a node. Therefore p and the pixel's width
at a distance of 1 are attributes of the meshes wherever possible, and the repetition of a texture
is left out if each face lies within one repeat.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import bpy
import numpy as np
from bpy.types import Image, Material, Mesh, Node, NodeSocket, NodeTree, Object

from ...geometry.camera import PinholeCamera
from ...sensor.transfer import light_from_srgb, srgb_from_light
from ..compat import nodes_of
from ..shader_nodes import add_node, calculate, vectors
from ..surfaces import array_of

#: Version in recipes: higher if the same texture is filtered to other pixels. From 2 on, levels are
#: mixed by noise; 3 has larger cells of it.
VERSION = 3
#: Levels of a texture, including itself; the coarsest is smaller by 2^(LEVELS - 1).
LEVELS = 6
#: Larger textures are not filtered: their copies would take gigabytes while they are made.
MAX_TEXELS = 4096 * 4096
#: Width of a cell with one value of the noise, in texels of level 0: two to four pixels where level
#: 3 is read. If a pixel holds more than one cell, each frame sees another one of them, and texture
#: cannot be tracked (frames 560 to 1059 of noisy office kt3, ORB-SLAM3: 66 mm with 8, 14 with 32).
_CELL = 32
#: The footprint is multiplied by this and by 1 to 2, depending on the noise: an octave about the
#: footprint itself.
_LEAST_FOOTPRINT = math.sqrt(0.5)
#: Rows of a level that are computed at once, so that they stay in the processor's cache.
_BAND = 16
#: Prefix of the face attributes with the square root of the area in a UV map per square metre; the
#: map's name follows.
_DENSITY = "UV per metre "
#: Prefixes of attributes that depend on a texture, too: positions p, and the footprint of a pixel
#: at a distance of 1 m.
_POSITION, _FOOTPRINT = "mipmap position ", "mipmap footprint "
#: A face lies within one repeat of a texture if it does so up to this share of the repeat. The
#: margins are wider.
_OVER = 1e-4
#: Light of all 8-bit sRGB values, and sRGB values of 16-bit light.
_LINEAR = light_from_srgb(np.linspace(0, 1, 256)).astype(np.float32)
_SRGB = srgb_from_light(np.linspace(0, 1, 65536)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Texture:
    """An Image Texture node, its material, the UV map that it reads (empty: the active one), and
    the scale of the mapping between them.

    mapped: whether there is a mapping.
    """

    node: Node
    material: Material
    uv_map: str
    scale: float
    mapped: bool = False

    @property
    def name(self) -> str:
        """A name of its UV map and size, on which the attributes with positions and footprints
        depend.
        """
        width, height = self.node.image.size
        return f"{width} x {height} {self.node.extension} {self.uv_map}"


def filter_textures(camera: PinholeCamera) -> list[Image]:
    """Filter the textures of the open scene for a camera. Returns the images made, which are in
    memory only.

    Left unfiltered: textures that are not read through a UV map, whose alpha or raw data is used,
    that end at their borders, that displace surfaces, or that have more than MAX_TEXELS; textures
    of libraries; and faces made by Geometry Nodes without the UV map.
    """
    made: dict[tuple[Image, str], Image] = {}
    noise: dict[tuple[int, ...], Image] = {}
    found = [
        t
        for material in bpy.data.materials
        if material.library is None
        for t in textures_of(material)
    ]
    pixel = _LEAST_FOOTPRINT / math.sqrt(camera.fx * camera.fy)
    whole = _place(bpy.data.objects, found, pixel)
    _measure_density(bpy.data.objects, [texture for texture in found if texture.node not in whole])
    for texture in {
        texture.node: texture for texture in found
    }.values():  # a node of a group is found in several materials
        key = texture.node.image, texture.node.extension
        if key not in made:
            made[key] = with_mipmaps(*key)
        size = tuple(made[key].size)
        if size not in noise:
            noise[size] = _noise(*size)
        _read_levels(texture, made[key], noise[size], pixel, whole.get(texture.node))
    for image, _ in made:
        if not image.is_dirty:  # it can be read from its file again
            image.buffers_free()
    return [*made.values(), *noise.values()]


def textures_of(material: Material) -> list[Texture]:
    """The textures of a material that can be filtered."""
    tree = material.node_tree if material.use_nodes else None
    if tree is None or any(
        n.inputs["Displacement"].is_linked for n in tree.nodes if n.type == "OUTPUT_MATERIAL"
    ):
        return []
    nodes = [
        node
        for node in dict.fromkeys(nodes_of(tree))
        if node.type == "TEX_IMAGE" and _can_be_filtered(node)
    ]
    read = ((node, _uv_map(node.inputs["Vector"])) for node in nodes)
    return [Texture(node, material, *source) for node, source in read if source is not None]


def _can_be_filtered(node: Node) -> bool:
    image, mapping = node.image, node.texture_mapping
    if (
        image is None
        or image.source not in ("FILE", "GENERATED")
        or image.colorspace_settings.is_data
    ):
        return False
    if node.id_data.library is not None:
        return False
    plain = (
        node.projection == "FLAT"
        and node.extension in ("REPEAT", "EXTEND")
        and node.interpolation != "Closest"
    )
    unmoved = tuple(mapping.scale) == (1, 1, 1) and not any(
        (*mapping.translation, *mapping.rotation)
    )
    axes = (mapping.mapping_x, mapping.mapping_y, mapping.mapping_z) == ("X", "Y", "Z")
    used = node.outputs["Color"].is_linked and not node.outputs["Alpha"].is_linked
    small = 0 < image.size[0] * image.size[1] <= MAX_TEXELS and image.channels == 4
    return plain and unmoved and axes and used and small


def _uv_map(socket: NodeSocket) -> tuple[str, float, bool] | None:
    """The name of the UV map that an input reads, the scale of the mapping nodes between them, and
    whether there are any; None if it reads
    something else.
    """
    if not socket.is_linked:
        return "", 1.0, False
    link = socket.links[0]
    node = link.from_node
    if node.type == "UVMAP" and not node.from_instancer:
        return node.uv_map, 1.0, False
    if node.type == "TEX_COORD" and link.from_socket.name == "UV" and not node.from_instancer:
        return "", 1.0, False
    if node.type == "REROUTE":
        return _uv_map(node.inputs[0])
    if (
        node.type == "MAPPING"
        and node.vector_type in ("POINT", "TEXTURE")
        and not node.inputs["Scale"].is_linked
    ):
        x, y, _ = node.inputs["Scale"].default_value
        source, scale = _uv_map(node.inputs["Vector"]), math.sqrt(abs(x * y))
        if source is not None and node.inputs["Vector"].is_linked and scale > 0:
            return (
                source[0],
                source[1] * (scale if node.vector_type == "POINT" else 1 / scale),
                True,
            )
    return None


# Attributes of surfaces


def _largest(objects: Iterable[Object]) -> dict[Mesh, Object]:
    """The meshes of the objects, each with its largest object."""
    largest: dict[Mesh, Object] = {}
    for thing in objects:
        if thing.type == "MESH" and thing.data.library is None:
            user = largest.setdefault(thing.data, thing)
            if abs(thing.matrix_world.determinant()) > abs(user.matrix_world.determinant()):
                largest[thing.data] = thing
    return largest


def _measure_density(objects: Iterable[Object], found: list[Texture]) -> None:
    """Add the face attributes to the meshes that use the textures.

    A mesh with several objects gets the density of the largest.
    """
    wanted: dict[Material, set[str]] = {}
    for texture in found:
        wanted.setdefault(texture.material, set()).add(texture.uv_map)
    for mesh, thing in _largest(objects).items():
        shown = {slot.material for slot in thing.material_slots} | set(mesh.materials)
        for name in set().union(*(wanted.get(material, set()) for material in shown)):
            layer = _layer(mesh, name)
            if layer is not None:
                _set_attribute(mesh, _DENSITY + name, "FLOAT", "FACE", density(thing, layer))


def _layer(mesh: Mesh, uv_map: str) -> bpy.types.MeshUVLoopLayer | None:
    return (
        mesh.uv_layers.get(uv_map)
        if uv_map
        else next((x for x in mesh.uv_layers if x.active_render), None)
    )


def _set_attribute(mesh: Mesh, name: str, kind: str, domain: str, values: np.ndarray) -> None:
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, domain)
    attribute.data.foreach_set(
        "vector" if kind == "FLOAT_VECTOR" else "value", values.astype(np.float32).ravel()
    )


def _place(objects: Iterable[Object], found: list[Texture], pixel: float) -> dict[Node, bool]:
    """Add attributes with positions and footprints to the meshes that use the textures, where these
    do not depend on mappings or modifiers.

    Returns whether each face lies within one repeat, for the nodes whose textures are placed on all
    surfaces with the material.
    """
    objects = list(objects)
    if any(modifier.type == "NODES" for thing in objects for modifier in thing.modifiers):
        return {}  # they may assign materials to new surfaces
    largest = _largest(objects)
    users: dict[Material, list[Object]] = {texture.material: [] for texture in found}
    for thing in objects:
        for material in {slot.material for slot in thing.material_slots} & users.keys():
            users[material].append(thing)
    whole: dict[Node, bool] = {}
    left = {
        t.node
        for t in found
        if t.mapped or not all(_is_plain(thing, t.uv_map) for thing in users[t.material])
    }
    for texture in found:
        for thing in users[texture.material] if texture.node not in left else ():
            layer = _layer(thing.data, texture.uv_map)
            texels = math.sqrt(math.prod(texture.node.image.size)) * pixel
            footprints = density(largest[thing.data], layer) * (texels / 2**LEVELS)
            fits = _add_positions(thing, layer, texture)  # from here on the layer has moved
            if texture.node.extension != "REPEAT" and not fits:
                left.add(texture.node)
                break
            _set_attribute(thing.data, _FOOTPRINT + texture.name, "FLOAT", "FACE", footprints)
            whole[texture.node] = whole.get(texture.node, True) and fits
    return {node: fits for node, fits in whole.items() if node not in left}


def _is_plain(thing: Object, uv_map: str) -> bool:
    """Whether the object is a mesh that is rendered as it is, with the UV map."""
    return (
        thing.type == "MESH"
        and thing.data.library is None
        and not thing.modifiers
        and _layer(thing.data, uv_map) is not None
    )


def _add_positions(thing: Object, layer: bpy.types.MeshUVLoopLayer, texture: Texture) -> bool:
    """Add the positions p in level 0 of the texture's image to the corners of a mesh; those of a
    face are shifted by whole repeats to the first
    one. Returns whether each face with the material lies within one repeat."""
    mesh, size = thing.data, np.array(texture.node.image.size)
    if not len(mesh.polygons):
        return True
    uv, starts = (
        array_of(layer.data, "uv", 2).astype(float),
        array_of(mesh.polygons, "loop_start", 1, np.int32),
    )
    low, high = np.minimum.reduceat(uv, starts), np.maximum.reduceat(uv, starts)
    shift = np.floor(low + _OVER) if texture.node.extension == "REPEAT" else np.zeros_like(low)
    before, total = np.array([(margins(n)[0], n + sum(margins(n))) for n in size]).T
    total = total * (2, 1)
    uv -= shift.repeat(array_of(mesh.polygons, "loop_total", 1, np.int32), axis=0)
    positions = np.zeros((len(uv), 3))
    positions[:, :2] = (uv * size + before) / total + (0.5, 0)
    _set_attribute(mesh, _POSITION + texture.name, "FLOAT_VECTOR", "CORNER", positions)
    slots = [k for k, slot in enumerate(thing.material_slots) if slot.material == texture.material]
    index = array_of(mesh.polygons, "material_index", 1, np.int32).clip(
        0, len(thing.material_slots) - 1
    )
    inside = ((low - shift >= -_OVER) & (high - shift <= 1 + _OVER)).all(1)
    return bool(inside[np.isin(index, slots)].all())


def density(thing: Object, layer: bpy.types.MeshUVLoopLayer) -> np.ndarray:
    """(F,) the square root of the area in the UV map per square metre, of each face of a mesh
    object. 0 for faces without area.
    """
    mesh = thing.data
    mesh.calc_loop_triangles()
    linear = np.array(thing.matrix_world)[:3, :3]
    vertices_m = array_of(mesh.vertices, "co", 3).astype(float) @ linear.T
    corners = array_of(mesh.loop_triangles, "loops", 3, np.int32)
    uv = array_of(layer.data, "uv", 2).astype(float)[corners]
    edges_m = np.diff(
        vertices_m[array_of(mesh.loops, "vertex_index", 1, np.int32)[corners]], axis=1
    )
    area_m2 = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
    area_uv = np.abs(np.linalg.det(np.diff(uv, axis=1)))
    face, count = array_of(mesh.loop_triangles, "polygon_index", 1, np.int32), len(mesh.polygons)
    area_m2, area_uv = (np.bincount(face, area, count) for area in (area_m2, area_uv))
    return np.sqrt(np.divide(area_uv, area_m2, out=np.zeros(count), where=area_m2 > 0)).astype(
        np.float32
    )


# Images


def with_mipmaps(image: Image, extension: str) -> Image:
    """An image with all levels of `image` side by side. Levels are averages of light, not of
    encoded values.

    extension: REPEAT or EXTEND, which determines the margins."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    encoded = not image.is_float and image.colorspace_settings.name == "sRGB"
    columns, rows = (sum(margins(size), size) for size in image.size)
    atlas = np.zeros((rows, 2 * columns, 4), np.float32)
    level = atlas[:, columns:]
    _fill(level, pixels.reshape(height, width, 4), extension)
    level[..., 3] = 1.0
    light = level[..., :3]
    for k in range(1, LEVELS):
        light = halved(light, _light if encoded and k == 1 else np.asarray)
        rows, columns = light.shape[:2]
        part = atlas[:rows, columns : 2 * columns]
        part[..., :3] = _SRGB[(light * 65535 + 0.5).astype(np.uint16)] if encoded else light
        part[..., 3] = 1.0
    made = bpy.data.images.new(
        f"{image.name} mipmaps", *atlas.shape[1::-1], float_buffer=image.is_float
    )
    made.colorspace_settings.name = image.colorspace_settings.name
    made.pixels.foreach_set(atlas.ravel())
    made.update()
    return made


def _noise(width: int, height: int) -> Image:
    """An image whose alpha is noise between 0 and 1 in cells, for an image with levels of this
    size.
    """
    made = bpy.data.images.new("footprint noise", width // _CELL, height // _CELL, alpha=True)
    made.colorspace_settings.name, made.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    pixels = np.ones((math.prod(made.size), 4), np.float32)
    pixels[:, 3] = np.random.default_rng(0).random(len(pixels))
    made.pixels.foreach_set(pixels.ravel())
    made.update()
    return made


def margins(size: int) -> tuple[int, int]:
    """Texels of the repeated texture before and after a side, so that every level has whole texels
    and at least one texel of margin.
    """
    unit = 2 ** (LEVELS - 1)
    return unit, unit + -size % unit


def _fill(target: np.ndarray, texture: np.ndarray, extension: str) -> None:
    """Fill the target with the texture, and its margins with the texture repeated, or with its
    borders.
    """
    (top, _), (left, _) = (margins(size) for size in texture.shape[:2])
    target[top : top + texture.shape[0], left : left + texture.shape[1]] = texture
    for rows, size in ((target, texture.shape[0]), (target.swapaxes(0, 1), texture.shape[1])):
        before, after = margins(size)
        outside = np.r_[-before:0, size : size + after]
        rows[outside + before] = rows[
            (outside % size if extension == "REPEAT" else outside.clip(0, size - 1)) + before
        ]


def _light(encoded: np.ndarray) -> np.ndarray:
    return _LINEAR[(encoded * 255 + 0.5).astype(np.uint8)]


def halved(level: np.ndarray, light: Callable[[np.ndarray], np.ndarray] = np.asarray) -> np.ndarray:
    """light(level), (2 n, 2 m, 3) -> (n, m, 3), filtered by the binomial (1, 3, 3, 1) / 8: then all
    levels have a filter of the same width.
    """
    rows, columns = level.shape[0] // 2, level.shape[1] // 2
    half = np.empty((rows, columns, 3), np.float32)
    for top in range(0, rows, _BAND):
        bottom = min(top + _BAND, rows)
        band = light(level[np.arange(2 * top - 1, 2 * bottom + 1).clip(0, len(level) - 1)])
        band = (band[:-3:2] + 3 * (band[1:-2:2] + band[2:-1:2]) + band[3::2]) / 8
        band = np.concatenate([band[:, :1], band, band[:, -1:]], axis=1)
        half[top:bottom] = (
            band[:, :-3:2] + 3 * (band[:, 1:-2:2] + band[:, 2:-1:2]) + band[:, 3::2]
        ) / 8
    return half


# Shaders


def _read_levels(
    texture: Texture, levels: Image, noise: Image, pixel: float, whole: bool | None
) -> None:
    """Let the node read the level for the pixel's width on the surface. pixel: width of a pixel at
    a distance of 1, in the same unit.

    whole: None if positions are to be computed from the UV map; otherwise they are attributes, and
    each face lies within one repeat or not.
    """
    node = texture.node
    tree: NodeTree = node.id_data
    width, height = node.image.size
    columns, rows = levels.size
    (left, _), (top, _) = margins(width), margins(height)
    ray = tree.nodes.new("ShaderNodeLightPath").outputs["Ray Length"]
    if whole is not None:
        footprint = calculate(
            tree, "MULTIPLY", _attribute(tree, _FOOTPRINT + texture.name).outputs["Fac"], ray
        )
        first = _attribute(tree, _POSITION + texture.name).outputs["Vector"]
        if not whole:
            low = left / columns + 0.5, top / rows, 0.0
            first = vectors(
                tree, "WRAP", first, (low[0] + width / columns, low[1] + height / rows, 0.0), low
            )
    else:
        texels = texture.scale * math.sqrt(width * height) * pixel
        per_metre = _attribute(tree, _DENSITY + texture.uv_map).outputs["Fac"]
        footprint = calculate(
            tree, "MULTIPLY", per_metre, calculate(tree, "MULTIPLY", ray, texels / 2**LEVELS)
        )
        source = _uv_source(tree, texture)
        if node.extension == "REPEAT":
            source = vectors(tree, "FRACTION", source)
        else:
            source = vectors(
                tree, "MINIMUM", vectors(tree, "MAXIMUM", source, (0.0, 0.0, 0.0)), (1.0, 1.0, 1.0)
            )
        first = vectors(
            tree,
            "MULTIPLY_ADD",
            source,
            (width / columns, height / rows, 0.0),
            (left / columns + 0.5, top / rows, 0.0),
        )
    spread = add_node(tree, "TexImage", first, image=noise, interpolation="Closest").node.outputs[
        "Alpha"
    ]
    footprint = calculate(tree, "MULTIPLY_ADD", footprint, spread, footprint)
    tree.links.new(vectors(tree, "MULTIPLY", first, _steps(tree, footprint)), node.inputs["Vector"])
    node.image, node.extension = levels, "EXTEND"


def _attribute(tree: NodeTree, name: str) -> Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = name
    return node


def _steps(tree: NodeTree, footprint: NodeSocket) -> NodeSocket:
    """2^-k in all channels, where 2^k is the power of two below the footprint (in texels of level
    0, divided by 2^LEVELS).
    """
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(footprint, ramp.inputs["Fac"])
    steps = ramp.color_ramp
    steps.interpolation = "CONSTANT"
    steps.elements.remove(steps.elements[1])
    for k in range(LEVELS):
        step = steps.elements.new(2.0 ** (k - LEVELS)) if k else steps.elements[0]
        step.color = (2.0**-k,) * 3 + (1.0,)
    return ramp.outputs["Color"]


def _uv_source(tree: NodeTree, texture: Texture) -> NodeSocket:
    vector = texture.node.inputs["Vector"]
    return vector.links[0].from_socket if vector.is_linked else add_node(tree, "UVMap", uv_map="")
