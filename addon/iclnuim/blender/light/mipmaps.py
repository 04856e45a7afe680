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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.types import Image, Material, Node, NodeSocket, NodeTree, TexMapping

from ...geometry.camera import PinholeCamera
from ..compat import nodes_of
from ..notes import names_of
from ..shader_nodes import add_node, calculate, vectors
from .mipmap_attributes import DENSITY, FOOTPRINT, POSITION, Texture, measure_density, place
from .mipmap_files import MipmapFiles
from .mipmap_images import LEVELS, levels_shape, margins, noise_cells
from .mipmap_memory import MAX_BYTES, halvings
from .mipmap_pictures import Pictures, decoded_size

#: Version in recipes: higher if the same texture is filtered to other pixels. From 2 on, levels are
#: mixed by noise; 3 has larger cells of it.
VERSION = 3
#: Larger textures are not filtered: their copies would take gigabytes while they are made.
MAX_TEXELS = 4096 * 4096
#: The footprint is multiplied by this and by 1 to 2, depending on the noise: an octave about the
#: footprint itself.
_LEAST_FOOTPRINT = math.sqrt(0.5)


@dataclass(frozen=True, eq=False)
class FilteredTextures:
    """The images made for the open scene. files: those that Cycles reads when the first frame is
    rendered. notes: sentences about pictures whose levels are smaller, or that have none.
    """

    images: list[Image]
    files: list[Path]
    notes: list[str]

    @property
    def removed(self) -> Path | None:
        """A file that does not exist any more: Cycles shows pink in its place."""
        return next((file for file in self.files if not file.is_file()), None)


def filter_textures(camera: PinholeCamera, cache: Path) -> FilteredTextures:
    """Filter the textures of the open scene for a camera. Levels that were made before are read
    from the folder `cache`.

    Left unfiltered: textures that are not read through a UV map, whose alpha or raw data is used,
    that end at their borders, that displace surfaces, or that have more than MAX_TEXELS; textures
    of libraries; and faces made by Geometry Nodes without the UV map.
    """
    pictures = Pictures(MipmapFiles(cache, VERSION))
    found = []
    for material in bpy.data.materials:
        if material.library is None:
            found += textures_of(material, pictures.size)
    halved = halvings({key: pictures.of(*key) for key in dict.fromkeys(map(_key, found))})
    notes = _notes_on(halved, found)
    found = [texture.halved(halved[_key(texture)]) for texture in found if _key(texture) in halved]
    pixel = _LEAST_FOOTPRINT / math.sqrt(camera.fx * camera.fy)
    whole = place(bpy.data.objects, found, pixel)
    measure_density(bpy.data.objects, [texture for texture in found if texture.node not in whole])
    made: dict[tuple[Image, str], Image] = {}
    noise: dict[tuple[int, int], Image] = {}
    # a node of a group is found in several materials
    for texture in {texture.node: texture for texture in found}.values():
        key = _key(texture)
        if key not in made:
            made[key] = pictures.with_levels(*key, halved[key])
        size = levels_shape(*texture.size)
        if size not in noise:
            noise[size] = noise_cells(*size)
        _read_levels(texture, made[key], noise[size], pixel, whole.get(texture.node))
    images = [*made.values(), *noise.values()]
    return FilteredTextures(images, pictures.files, notes)


def _notes_on(halved: dict[tuple[Image, str], int], found: list[Texture]) -> list[str]:
    """A sentence about pictures whose levels are smaller, and one about those that have none."""
    smaller = {image for (image, _), times in halved.items() if times}
    left = {texture.node.image for texture in found if _key(texture) not in halved}
    all_levels = f"all mipmaps together have {MAX_BYTES / 1e9:g} GB of memory"
    notes = []
    if smaller:
        notes.append(f"pictures ({names_of(smaller)}) are halved for mipmaps: {all_levels}")
    if left:
        notes.append(f"pictures ({names_of(left)}) have no mipmaps: {all_levels}")
    return notes


def _key(texture: Texture) -> tuple[Image, str]:
    return texture.node.image, texture.node.extension


def textures_of(
    material: Material,
    size_of: Callable[[Image, str], tuple[int, int]] = lambda image, _: decoded_size(image),
) -> list[Texture]:
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
            if source is None:
                continue
            size = size_of(node.image, node.extension)
            if 0 < math.prod(size) <= MAX_TEXELS:
                found.append(Texture(node, material, size, *source))
    return found


def _can_be_filtered(node: Node) -> bool:
    """Whether a picture may be filtered where this node reads it."""
    image = node.image
    if image is None or image.source not in ("FILE", "GENERATED"):
        return False
    if image.colorspace_settings.is_data or node.id_data.library is not None:
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
    width, height = texture.size
    rows, columns = levels_shape(width, height)
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
