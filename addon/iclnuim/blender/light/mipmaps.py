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

Cycles takes time for each node and for each constant of a node. Therefore p and the pixel's width
at a distance of 1 are attributes of the meshes wherever possible, and the repetition of a texture
is left out if each face lies within one repeat.
"""

import math

import bpy
from bpy.types import Image, Material, Node, NodeSocket, NodeTree, TexMapping

from ...geometry.camera import PinholeCamera
from ..compat import nodes_of
from ..shader_nodes import add_node, calculate, vectors
from .mipmap_attributes import DENSITY, FOOTPRINT, POSITION, Texture, measure_density, place
from .mipmap_images import LEVELS, margins, noise_cells, with_mipmaps

#: Version in recipes: higher if the same texture is filtered to other pixels. From 2 on, levels are
#: mixed by noise; 3 has larger cells of it.
VERSION = 3
#: Larger textures are not filtered: their copies would take gigabytes while they are made.
MAX_TEXELS = 4096 * 4096
#: The footprint is multiplied by this and by 1 to 2, depending on the noise: an octave about the
#: footprint itself.
_LEAST_FOOTPRINT = math.sqrt(0.5)


def filter_textures(camera: PinholeCamera) -> list[Image]:
    """Filter the textures of the open scene for a camera. Returns the images made, which are in
    memory only.

    Left unfiltered: textures that are not read through a UV map, whose alpha or raw data is used,
    that end at their borders, that displace surfaces, or that have more than MAX_TEXELS; textures
    of libraries; and faces made by Geometry Nodes without the UV map.
    """
    found = []
    for material in bpy.data.materials:
        if material.library is None:
            found += textures_of(material)
    pixel = _LEAST_FOOTPRINT / math.sqrt(camera.fx * camera.fy)
    whole = place(bpy.data.objects, found, pixel)
    measure_density(bpy.data.objects, [texture for texture in found if texture.node not in whole])
    made: dict[tuple[Image, str], Image] = {}
    noise: dict[tuple[int, ...], Image] = {}
    # a node of a group is found in several materials
    for texture in {texture.node: texture for texture in found}.values():
        key = (texture.node.image, texture.node.extension)
        if key not in made:
            made[key] = with_mipmaps(*key)
        size = tuple(made[key].size)
        if size not in noise:
            noise[size] = noise_cells(*size)
        _read_levels(texture, made[key], noise[size], pixel, whole.get(texture.node))
    for image, _ in made:
        if not image.is_dirty:  # it can be read from its file again
            image.buffers_free()
    return [*made.values(), *noise.values()]


def textures_of(material: Material) -> list[Texture]:
    """The textures of a material that can be filtered."""
    tree = material.node_tree if material.use_nodes else None
    if tree is None:
        return []
    outputs = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL"]
    if any(node.inputs["Displacement"].is_linked for node in outputs):
        return []
    found = []
    for node in dict.fromkeys(nodes_of(tree)):
        if node.type == "TEX_IMAGE" and _can_be_filtered(node):
            source = _uv_map(node.inputs["Vector"])
            if source is not None:
                found.append(Texture(node, material, *source))
    return found


def _can_be_filtered(node: Node) -> bool:
    image = node.image
    if image is None or image.source not in ("FILE", "GENERATED"):
        return False
    if image.colorspace_settings.is_data or image.channels != 4:
        return False
    if not 0 < image.size[0] * image.size[1] <= MAX_TEXELS or node.id_data.library is not None:
        return False
    if node.projection != "FLAT" or node.extension not in ("REPEAT", "EXTEND"):
        return False
    if node.interpolation == "Closest" or _is_moved(node.texture_mapping):
        return False
    return node.outputs["Color"].is_linked and not node.outputs["Alpha"].is_linked


def _is_moved(mapping: TexMapping) -> bool:
    if tuple(mapping.scale) != (1, 1, 1) or any((*mapping.translation, *mapping.rotation)):
        return True
    return (mapping.mapping_x, mapping.mapping_y, mapping.mapping_z) != ("X", "Y", "Z")


def _uv_map(socket: NodeSocket) -> tuple[str, float, bool] | None:
    """The name of the UV map that an input reads, the scale of the mapping nodes between them, and
    whether there are any; None if it reads something else.
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
    if node.type != "MAPPING" or node.vector_type not in ("POINT", "TEXTURE"):
        return None
    if node.inputs["Scale"].is_linked or not node.inputs["Vector"].is_linked:
        return None
    x, y, _ = node.inputs["Scale"].default_value
    scale = math.sqrt(abs(x * y))
    source = _uv_map(node.inputs["Vector"])
    if source is None or scale <= 0:
        return None
    name, inner, _ = source
    return name, inner * (scale if node.vector_type == "POINT" else 1 / scale), True


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
    left, _ = margins(width)
    top, _ = margins(height)
    size = (width / columns, height / rows, 0.0)
    start = (left / columns + 0.5, top / rows, 0.0)
    ray = tree.nodes.new("ShaderNodeLightPath").outputs["Ray Length"]
    if whole is None:
        texels = texture.scale * math.sqrt(width * height) * pixel
        per_metre = _attribute(tree, DENSITY + texture.uv_map).outputs["Fac"]
        scaled_ray = calculate(tree, "MULTIPLY", ray, texels / 2**LEVELS)
        footprint = calculate(tree, "MULTIPLY", per_metre, scaled_ray)
        repeated = _repeated(tree, _uv_source(tree, texture), node.extension)
        first = vectors(tree, "MULTIPLY_ADD", repeated, size, start)
    else:
        at_1_m = _attribute(tree, FOOTPRINT + texture.name).outputs["Fac"]
        footprint = calculate(tree, "MULTIPLY", at_1_m, ray)
        first = _attribute(tree, POSITION + texture.name).outputs["Vector"]
        if not whole:
            end = (start[0] + size[0], start[1] + size[1], 0.0)
            first = vectors(tree, "WRAP", first, end, start)
    cells = add_node(tree, "TexImage", first, image=noise, interpolation="Closest").node
    footprint = calculate(tree, "MULTIPLY_ADD", footprint, cells.outputs["Alpha"], footprint)
    tree.links.new(vectors(tree, "MULTIPLY", first, _steps(tree, footprint)), node.inputs["Vector"])
    node.image = levels
    node.extension = "EXTEND"


def _repeated(tree: NodeTree, source: NodeSocket, extension: str) -> NodeSocket:
    """The position in the first repeat of a texture, or at its nearest border."""
    if extension == "REPEAT":
        return vectors(tree, "FRACTION", source)
    not_below = vectors(tree, "MAXIMUM", source, (0.0, 0.0, 0.0))
    return vectors(tree, "MINIMUM", not_below, (1.0, 1.0, 1.0))


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
