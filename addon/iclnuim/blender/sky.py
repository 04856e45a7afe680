"""The sky of the open scene as a source of light: whether it gives any, and the size of the map by
which Cycles samples it.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from bpy.types import Node, World

from . import compat


def gives_light(world: World | None) -> bool:
    """Whether the sky may give light: False without a world, and for a Background of strength 0 or
    black colour.
    """
    if world is None:
        return False
    if not world.use_nodes:
        return max(world.color) > 0
    shaders = []
    for node in world.node_tree.nodes:
        if node.type == "OUTPUT_WORLD" and node.is_active_output:
            shaders += [link.from_node for link in node.inputs["Surface"].links]
    return not all(map(_is_black, shaders))


def _is_black(shader: Node) -> bool:
    if shader.type != "BACKGROUND":
        return False
    colour = shader.inputs["Color"]
    strength = shader.inputs["Strength"]
    no_colour = not colour.is_linked and max(colour.default_value[:3]) == 0
    return no_colour or (not strength.is_linked and strength.default_value == 0)


@contextmanager
def sampled_at_image_size(world: World | None) -> Iterator[None]:
    """Let Cycles sample a sky that is an image by a map of the image's width, temporarily.

    Cycles' automatic map is 4096 wide. It is made anew for each bake, and every sample searches it;
    texels finer than those of the image do not place samples better.
    """
    width = _image_width(world)
    if world is None or width is None:
        yield
        return
    with compat.temporarily(world.cycles, sampling_method="MANUAL", sample_map_resolution=width):
        yield


def _image_width(world: World | None) -> int | None:
    """The largest width of the images of a sky that only consists of equirectangular ones; None for
    another sky, whose detail is not known.
    """
    if world is None or not world.use_nodes or world.cycles.sampling_method != "AUTOMATIC":
        return None
    nodes = compat.nodes_of(world.node_tree)
    # includes Texture Coordinate
    placed = [node for node in nodes if node.type.startswith("TEX_") or node.type == "NEW_GEOMETRY"]
    if not placed or not all(_is_whole_sphere(node) for node in placed):
        return None
    return max(node.image.size[0] for node in placed)


def _is_whole_sphere(node: Node) -> bool:
    if node.type != "TEX_ENVIRONMENT" or node.inputs["Vector"].is_linked:
        return False
    return (
        node.projection == "EQUIRECTANGULAR" and node.image is not None and node.image.size[0] > 0
    )
