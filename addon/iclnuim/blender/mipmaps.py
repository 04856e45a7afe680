"""Textures filtered for the distance at which they are seen, in memory only: Cycles reads one texel per ray, however many lie within a pixel.

Each texture is replaced by an image that also holds smaller versions of itself (levels of mipmaps, Williams 1983), each half as wide as the one before.
A pixel reads the finest level whose texels are at least as wide as half of the pixel's width on the surface. This width is computed
from the length of the ray and from how densely the texture covers each face. Foreshortening is not considered: it would blur surfaces seen
at a grazing angle along both directions.

Image: side by side, from left to right, levels 0, 1, ..., each with margins. Level k is smaller by s = 2^-k, and begins at 2 (1 - s) times
the width of level 0, so a position in it is linear in s: 1 + s (p - 1) in units of the image's width, if p is the position in level 0.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import bpy
import numpy as np
from bpy.types import Image, Material, Mesh, Node, NodeSocket, NodeTree, Object

from ..geometry.camera import PinholeCamera
from ..sensor.transfer import light_from_srgb, srgb_from_light
from .compat import nodes_of
from .shader_nodes import add_node, calculate, vectors
from .surfaces import array_of

#: Levels of a texture, including itself; the coarsest is smaller by 2^(LEVELS - 1).
LEVELS = 6
#: Larger textures are not filtered: their copies would take gigabytes while they are made.
MAX_TEXELS = 4096 * 4096
#: Rows of a level that are computed at once, so that they stay in the processor's cache.
_BAND = 16
#: Prefix of the face attributes with the square root of the area in a UV map per square metre; the map's name follows.
_DENSITY = "UV per metre "
#: Light of all 8-bit sRGB values, and sRGB values of 16-bit light.
_LINEAR = light_from_srgb(np.linspace(0, 1, 256)).astype(np.float32)
_SRGB = srgb_from_light(np.linspace(0, 1, 65536)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Texture:
    """An Image Texture node, its material, the UV map that it reads (empty: the active one), and the scale of the mapping between them."""

    node: Node
    material: Material
    uv_map: str
    scale: float


def filter_textures(camera: PinholeCamera) -> list[Image]:
    """Filter the textures of the open scene for a camera. Returns the images made, which are in memory only.

    Left unfiltered: textures that are not read through a UV map, whose alpha or raw data is used, that end at their borders, that displace
    surfaces, or that have more than MAX_TEXELS; textures of libraries; and faces made by Geometry Nodes without the UV map.
    """
    made: dict[tuple[Image, str], Image] = {}
    found = [t for material in bpy.data.materials if material.library is None for t in textures_of(material)]
    _measure_density(bpy.data.objects, found)
    pixel = 1 / math.sqrt(camera.fx * camera.fy)
    for texture in {
        texture.node: texture for texture in found
    }.values():  # a node of a group is found in several materials
        key = texture.node.image, texture.node.extension
        if key not in made:
            made[key] = with_mipmaps(*key)
        _read_levels(texture, made[key], pixel)
    for image, _ in made:
        if not image.is_dirty:  # it can be read from its file again
            image.buffers_free()
    return list(made.values())


def textures_of(material: Material) -> list[Texture]:
    """The textures of a material that can be filtered."""
    tree = material.node_tree if material.use_nodes else None
    if tree is None or any(n.inputs["Displacement"].is_linked for n in tree.nodes if n.type == "OUTPUT_MATERIAL"):
        return []
    nodes = [node for node in dict.fromkeys(nodes_of(tree)) if node.type == "TEX_IMAGE" and _can_be_filtered(node)]
    read = ((node, _uv_map(node.inputs["Vector"])) for node in nodes)
    return [Texture(node, material, *source) for node, source in read if source is not None]


def _can_be_filtered(node: Node) -> bool:
    image, mapping = node.image, node.texture_mapping
    if image is None or image.source not in ("FILE", "GENERATED") or image.colorspace_settings.is_data:
        return False
    if node.id_data.library is not None:
        return False
    plain = node.projection == "FLAT" and node.extension in ("REPEAT", "EXTEND") and node.interpolation != "Closest"
    unmoved = tuple(mapping.scale) == (1, 1, 1) and not any((*mapping.translation, *mapping.rotation))
    axes = (mapping.mapping_x, mapping.mapping_y, mapping.mapping_z) == ("X", "Y", "Z")
    used = node.outputs["Color"].is_linked and not node.outputs["Alpha"].is_linked
    small = 0 < image.size[0] * image.size[1] <= MAX_TEXELS and image.channels == 4
    return plain and unmoved and axes and used and small


def _uv_map(socket: NodeSocket) -> tuple[str, float] | None:
    """The name of the UV map that an input reads, and the scale of the mapping nodes between them; None if it reads something else."""
    if not socket.is_linked:
        return "", 1.0
    link = socket.links[0]
    node = link.from_node
    if node.type == "UVMAP" and not node.from_instancer:
        return node.uv_map, 1.0
    if node.type == "TEX_COORD" and link.from_socket.name == "UV" and not node.from_instancer:
        return "", 1.0
    if node.type == "REROUTE":
        return _uv_map(node.inputs[0])
    if node.type == "MAPPING" and node.vector_type in ("POINT", "TEXTURE") and not node.inputs["Scale"].is_linked:
        x, y, _ = node.inputs["Scale"].default_value
        source, scale = _uv_map(node.inputs["Vector"]), math.sqrt(abs(x * y))
        if source is not None and node.inputs["Vector"].is_linked and scale > 0:
            return source[0], source[1] * (scale if node.vector_type == "POINT" else 1 / scale)
    return None


# Density of textures on surfaces


def _measure_density(objects: Iterable[Object], found: list[Texture]) -> None:
    """Add the face attributes to the meshes that use the textures. A mesh with several objects gets the density of the largest."""
    wanted: dict[Material, set[str]] = {}
    for texture in found:
        wanted.setdefault(texture.material, set()).add(texture.uv_map)
    largest: dict[Mesh, Object] = {}
    for thing in objects:
        if thing.type == "MESH" and thing.data.library is None:
            user = largest.setdefault(thing.data, thing)
            if abs(thing.matrix_world.determinant()) > abs(user.matrix_world.determinant()):
                largest[thing.data] = thing
    for mesh, thing in largest.items():
        shown = {slot.material for slot in thing.material_slots} | set(mesh.materials)
        for name in set().union(*(wanted.get(material, set()) for material in shown)):
            _add_density(thing, name)


def _add_density(thing: Object, uv_map: str) -> None:
    mesh = thing.data
    layer = mesh.uv_layers.get(uv_map) if uv_map else next((x for x in mesh.uv_layers if x.active_render), None)
    if layer is None:
        return
    values = density(thing, layer)
    name = _DENSITY + uv_map
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, "FLOAT", "FACE")
    attribute.data.foreach_set("value", values)


def density(thing: Object, layer: bpy.types.MeshUVLoopLayer) -> np.ndarray:
    """(F,) the square root of the area in the UV map per square metre, of each face of a mesh object. 0 for faces without area."""
    mesh = thing.data
    mesh.calc_loop_triangles()
    linear = np.array(thing.matrix_world)[:3, :3]
    vertices_m = array_of(mesh.vertices, "co", 3).astype(float) @ linear.T
    corners = array_of(mesh.loop_triangles, "loops", 3, np.int32)
    uv = array_of(layer.data, "uv", 2).astype(float)[corners]
    edges_m = np.diff(vertices_m[array_of(mesh.loops, "vertex_index", 1, np.int32)[corners]], axis=1)
    area_m2 = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
    area_uv = np.abs(np.linalg.det(np.diff(uv, axis=1)))
    face, count = array_of(mesh.loop_triangles, "polygon_index", 1, np.int32), len(mesh.polygons)
    area_m2, area_uv = (np.bincount(face, area, count) for area in (area_m2, area_uv))
    return np.sqrt(np.divide(area_uv, area_m2, out=np.zeros(count), where=area_m2 > 0)).astype(np.float32)


# Images


def with_mipmaps(image: Image, extension: str) -> Image:
    """An image with all levels of `image` side by side. Levels are averages of light, not of encoded values.

    extension: REPEAT or EXTEND, which determines the margins."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    encoded = not image.is_float and image.colorspace_settings.name == "sRGB"
    columns, rows = (sum(margins(size), size) for size in image.size)
    atlas = np.zeros((rows, 2 * columns, 4), np.float32)
    level = atlas[:, :columns]
    _fill(level, pixels.reshape(height, width, 4), extension)
    level[..., 3] = 1.0
    start, light = columns, level[..., :3]
    for k in range(1, LEVELS):
        light = halved(light, _light if encoded and k == 1 else np.asarray)
        rows, columns = light.shape[:2]
        part = atlas[:rows, start : start + columns]
        part[..., :3] = _SRGB[(light * 65535 + 0.5).astype(np.uint16)] if encoded else light
        part[..., 3] = 1.0
        start += columns
    made = bpy.data.images.new(f"{image.name} mipmaps", *atlas.shape[1::-1], float_buffer=image.is_float)
    made.colorspace_settings.name = image.colorspace_settings.name
    made.pixels.foreach_set(atlas.ravel())
    made.update()
    return made


def margins(size: int) -> tuple[int, int]:
    """Texels of the repeated texture before and after a side, so that every level has whole texels and at least one texel of margin."""
    unit = 2 ** (LEVELS - 1)
    return unit, unit + -size % unit


def _fill(target: np.ndarray, texture: np.ndarray, extension: str) -> None:
    """Fill the target with the texture, and its margins with the texture repeated, or with its borders."""
    (top, _), (left, _) = (margins(size) for size in texture.shape[:2])
    target[top : top + texture.shape[0], left : left + texture.shape[1]] = texture
    for rows, size in ((target, texture.shape[0]), (target.swapaxes(0, 1), texture.shape[1])):
        before, after = margins(size)
        outside = np.r_[-before:0, size : size + after]
        rows[outside + before] = rows[(outside % size if extension == "REPEAT" else outside.clip(0, size - 1)) + before]


def _light(encoded: np.ndarray) -> np.ndarray:
    return _LINEAR[(encoded * 255 + 0.5).astype(np.uint8)]


def halved(level: np.ndarray, light: Callable[[np.ndarray], np.ndarray] = np.asarray) -> np.ndarray:
    """light(level), (2 n, 2 m, 3) -> (n, m, 3), filtered by the binomial (1, 3, 3, 1) / 8: then all levels have a filter of the same width."""
    rows, columns = level.shape[0] // 2, level.shape[1] // 2
    half = np.empty((rows, columns, 3), np.float32)
    for top in range(0, rows, _BAND):
        bottom = min(top + _BAND, rows)
        band = light(level[np.arange(2 * top - 1, 2 * bottom + 1).clip(0, len(level) - 1)])
        band = (band[:-3:2] + 3 * (band[1:-2:2] + band[2:-1:2]) + band[3::2]) / 8
        band = np.concatenate([band[:, :1], band, band[:, -1:]], axis=1)
        half[top:bottom] = (band[:, :-3:2] + 3 * (band[:, 1:-2:2] + band[:, 2:-1:2]) + band[:, 3::2]) / 8
    return half


# Shaders


def _read_levels(texture: Texture, levels: Image, pixel: float) -> None:
    """Let the node read the level for the pixel's width on the surface. pixel: width of a pixel at a distance of 1, in the same unit."""
    node = texture.node
    tree: NodeTree = node.id_data
    width, height = node.image.size
    texels = texture.scale * math.sqrt(width * height) * pixel
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = _DENSITY + texture.uv_map
    ray = tree.nodes.new("ShaderNodeLightPath").outputs["Ray Length"]
    footprint = calculate(
        tree, "MULTIPLY", attribute.outputs["Fac"], calculate(tree, "MULTIPLY", ray, texels / 2**LEVELS)
    )
    smaller = _steps(tree, footprint)
    source = _uv_source(tree, texture)
    if node.extension == "REPEAT":
        source = vectors(tree, "FRACTION", source)
    else:
        source = vectors(tree, "MINIMUM", vectors(tree, "MAXIMUM", source, (0.0, 0.0, 0.0)), (1.0, 1.0, 1.0))
    columns, rows = levels.size
    (left, _), (top, _) = margins(width), margins(height)
    first = vectors(
        tree, "MULTIPLY_ADD", source, (width / columns, height / rows, 0.0), (left / columns - 1, top / rows, 0.0)
    )
    tree.links.new(vectors(tree, "MULTIPLY_ADD", first, smaller, (1.0, 0.0, 0.0)), node.inputs["Vector"])
    node.image, node.extension = levels, "EXTEND"


def _steps(tree: NodeTree, footprint: NodeSocket) -> NodeSocket:
    """2^-k in all channels, where 2^k is the power of two below the footprint (in texels of level 0, divided by 2^LEVELS)."""
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
