"""Images of a user-provided scene that are missing or broken: the plain colour of the surface, or
of the sky, replaces them.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.types import Image, Node, NodeTree, Scene

from ...scene_files.search import numbered
from .. import compat
from ..notes import names_of
from .picture_memory import DecodedPictures

#: Colour of a surface without its image, where nothing states one: Blender's own default.
_PLAIN = (0.8, 0.8, 0.8, 1.0)


def replace_missing(scene: Scene) -> tuple[list[str], bool]:
    """Unlink missing images and image nodes without an image, and give what they were linked to a
    plain colour. Returns a note if a node showed one, and one if the others take much memory, and
    whether one was that of the sky, and with it its light.

    A sequence or a set of tiles is missing if an image that may be shown is: Blender shows magenta
    or black there.
    """
    missing = set()
    decoded = DecodedPictures()
    for image in bpy.data.images:
        if _is_missing(image):
            missing.add(image)
        else:
            decoded.add(image)
    shown = []
    lost_sky = False
    sky = scene.world.node_tree if scene.world and scene.world.use_nodes else None

    def lacks(node: Node) -> bool:
        if node.type not in ("TEX_IMAGE", "TEX_ENVIRONMENT") or not _is_linked(node):
            return False
        return node.image in missing or node.image is None or _lacks_a_frame(node, scene)

    for tree, plain in _trees(lacks):
        for node in filter(lacks, tree.nodes):
            shown.append(Path(node.image.filepath).name if node.image else node.label or tree.name)
            lost_sky |= tree == sky and node.type == "TEX_ENVIRONMENT"
            _replace(node, plain)
    for image in missing:
        bpy.data.images.remove(image)
    if not shown:
        return decoded.notes(), False
    what = f"textures that are missing or broken ({names_of(set(shown))})"
    return [f"{what}: replaced by plain colour", *decoded.notes()], lost_sky


def _trees(lacks: Callable[[Node], bool]) -> Iterator[tuple[NodeTree, tuple[float, ...]]]:
    """The trees of nodes that may show images, with the plain colour of each: a group that lacks one
    has that of the material that it is in.
    """
    for material in bpy.data.materials:
        if material.node_tree is not None:
            plain = tuple(material.diffuse_color)
            yield material.node_tree, plain
            for group in _own_groups(material.node_tree, lacks):
                yield group, plain
    for group in bpy.data.node_groups:
        yield group, _PLAIN
    for block in (*bpy.data.worlds, *bpy.data.lights):
        if block.node_tree is not None:
            yield block.node_tree, _PLAIN


def _own_groups(tree: NodeTree, lacks: Callable[[Node], bool]) -> Iterator[NodeTree]:
    """The groups in a tree that lack an image, inner ones too. Where others use one, the tree gets
    a copy of it.
    """
    for node in tree.nodes:
        if node.type != "GROUP" or node.node_tree is None:
            continue
        if any(map(lacks, compat.nodes_of(node.node_tree))):
            if node.node_tree.users > 1:
                node.node_tree = node.node_tree.copy()
            yield node.node_tree
            yield from _own_groups(node.node_tree, lacks)


def _is_linked(node: Node) -> bool:
    return any(output.is_linked for output in node.outputs)


def _replace(node: Node, plain: tuple[float, ...]) -> None:
    """Unlink the outputs. Shaders keep the colour that stands in their own socket."""
    for output in node.outputs:
        for target in [link.to_socket for link in output.links]:
            is_shader = any(socket.type == "SHADER" for socket in target.node.outputs)
            if not is_shader and output.type == target.type == "RGBA":
                target.default_value = plain
            elif not is_shader and output.type == target.type == "VALUE":
                target.default_value = 1.0
        compat.unlink(output)


def _is_missing(image: Image) -> bool:
    if image.source in ("GENERATED", "VIEWER"):
        return False
    with suppress(RuntimeError, OSError, ValueError):
        if image.source == "SEQUENCE":
            return not _numbers(image)
        if image.source == "TILED":
            return not all(_tile_file(image, tile.number).is_file() for tile in image.tiles)
        return not (image.size[0] and image.size[1])
    return True


def _file(image: Image) -> Path:
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def _tile_file(image: Image, number: int) -> Path:
    file = _file(image)
    return file.with_name(numbered(file.name, number))


def _numbers(image: Image) -> set[int]:
    """The numbers of the files of a sequence."""
    file = _file(image)
    head, _, tail = re.fullmatch(r"(.*?)(\d*)(\D*)", file.name).groups()  # type: ignore[union-attr]
    pattern = re.compile(re.escape(head) + r"(\d+)" + re.escape(tail))
    found = map(pattern.fullmatch, (entry.name for entry in file.parent.iterdir()))
    return {int(match[1]) for match in found if match}


def _lacks_a_frame(node: Node, scene: Scene) -> bool:
    """Whether the image that a sequence's node shows in some frame from 0 on does not exist.

    Blender counts frame `frame_start` as 1, stays within 0 and the duration, and adds the offset.
    """
    if node.image.source != "SEQUENCE":
        return False
    user = node.image_user
    last = max(scene.frame_end, 0) - user.frame_start + 1
    if user.use_cyclic:
        shown = range(1, user.frame_duration + 1)
    else:
        shown = range(
            min(max(1 - user.frame_start, 0), user.frame_duration),
            min(max(last, 0), user.frame_duration) + 1,
        )
    return not {number + user.frame_offset for number in shown} <= _numbers(node.image)
