"""Attributes of meshes that the shaders of filtered textures read: how densely a texture covers
each face, positions in the image with levels, and the width of a pixel at a distance of 1.
"""

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from bpy.types import Material, Mesh, MeshUVLoopLayer, Node, Object

from ..surfaces import array_of
from .mipmap_images import LEVELS, margins

#: Prefix of the face attributes with the square root of the area in a UV map per square metre; the
#: map's name follows.
DENSITY = "UV per metre "
#: Prefixes of attributes that depend on a texture, too: positions p in level 0, and the footprint
#: of a pixel at a distance of 1 m.
POSITION = "mipmap position "
FOOTPRINT = "mipmap footprint "
#: A face lies within one repeat of a texture if it does so up to this share of the repeat: rounded
#: coordinates. The margins are wider.
_OVER = 1e-4


@dataclass(frozen=True, eq=False)
class Texture:
    """An Image Texture node, its material, width and height of the finest level, the UV map that it
    reads (empty: the active one), and the scale of the mapping between them.

    mapped: whether there is a mapping.
    """

    node: Node
    material: Material
    size: tuple[int, int]
    uv_map: str
    scale: float
    mapped: bool = False

    def halved(self, times: int) -> "Texture":
        """The texture whose picture is halved this often."""
        width, height = self.size
        return replace(self, size=(width >> times, height >> times))

    @property
    def name(self) -> str:
        """A name of its UV map and size, on which the attributes with positions and footprints
        depend.
        """
        width, height = self.size
        return f"{width} x {height} {self.node.extension} {self.uv_map}"


def place(objects: Iterable[Object], found: list[Texture], pixel: float) -> dict[Node, bool]:
    """Add attributes with positions and footprints to the meshes that use the textures, where these
    do not depend on mappings or modifiers.

    Returns whether each face lies within one repeat, for the nodes whose textures are placed on all
    surfaces with the material.
    """
    objects = list(objects)
    modifiers = itertools.chain.from_iterable(thing.modifiers for thing in objects)
    if any(modifier.type == "NODES" for modifier in modifiers):
        return {}  # they may assign materials to new surfaces
    largest = _largest(objects)
    users: dict[Material, list[Object]] = {texture.material: [] for texture in found}
    for thing in objects:
        for material in {slot.material for slot in thing.material_slots} & users.keys():
            users[material].append(thing)
    left = set()
    for texture in found:
        things = users[texture.material]
        if texture.mapped or not all(_is_plain(thing, texture.uv_map) for thing in things):
            left.add(texture.node)
    whole: dict[Node, bool] = {}
    for texture in found:
        for thing in users[texture.material]:
            if texture.node in left:
                break
            layer = _layer(thing.data, texture.uv_map)
            texels = math.sqrt(math.prod(texture.size)) * pixel
            footprints = density(largest[thing.data], layer) * (texels / 2**LEVELS)
            fits = _add_positions(thing, layer, texture)  # from here on the layer has moved
            if texture.node.extension != "REPEAT" and not fits:
                left.add(texture.node)
                break
            _set_attribute(thing.data, FOOTPRINT + texture.name, "FACE", footprints)
            whole[texture.node] = whole.get(texture.node, True) and fits
    return {node: fits for node, fits in whole.items() if node not in left}


def measure_density(objects: Iterable[Object], found: list[Texture]) -> None:
    """Add the face attributes with densities to the meshes that use the textures.

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
                _set_attribute(mesh, DENSITY + name, "FACE", density(thing, layer))


def _largest(objects: Iterable[Object]) -> dict[Mesh, Object]:
    """The meshes of the objects, each with its largest object."""
    largest: dict[Mesh, Object] = {}
    for thing in objects:
        if thing.type == "MESH" and thing.data.library is None:
            user = largest.setdefault(thing.data, thing)
            if abs(thing.matrix_world.determinant()) > abs(user.matrix_world.determinant()):
                largest[thing.data] = thing
    return largest


def _layer(mesh: Mesh, uv_map: str) -> MeshUVLoopLayer | None:
    if uv_map:
        return mesh.uv_layers.get(uv_map)
    return next((layer for layer in mesh.uv_layers if layer.active_render), None)


def _set_attribute(mesh: Mesh, name: str, domain: str, values: np.ndarray) -> None:
    """(n,) numbers or (n, 3) vectors of the faces or corners."""
    is_vector = values.ndim == 2
    kind = "FLOAT_VECTOR" if is_vector else "FLOAT"
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, domain)
    content = "vector" if is_vector else "value"
    attribute.data.foreach_set(content, values.astype(np.float32).ravel())


def _is_plain(thing: Object, uv_map: str) -> bool:
    """Whether the object is a mesh that is rendered as it is, with the UV map."""
    if thing.type != "MESH" or thing.data.library is not None or thing.modifiers:
        return False
    return _layer(thing.data, uv_map) is not None


def _add_positions(thing: Object, layer: MeshUVLoopLayer, texture: Texture) -> bool:
    """Add the positions p in level 0 of the texture's image to the corners of a mesh; those of a
    face are shifted by whole repeats to the first one. Returns whether each face with the material
    lies within one repeat.
    """
    mesh = thing.data
    if not len(mesh.polygons):
        return True
    uv = array_of(layer.data, "uv", 2).astype(float)
    starts = array_of(mesh.polygons, "loop_start", 1, np.int32)
    low = np.minimum.reduceat(uv, starts)
    high = np.maximum.reduceat(uv, starts)
    shift = np.zeros_like(low)
    if texture.node.extension == "REPEAT":
        shift = np.floor(low + _OVER)
    uv -= shift.repeat(array_of(mesh.polygons, "loop_total", 1, np.int32), axis=0)
    width, height = texture.size
    left, right = margins(width)
    top, bottom = margins(height)
    total = (2 * (left + width + right), top + height + bottom)
    positions = np.zeros((len(uv), 3))
    positions[:, :2] = (uv * (width, height) + (left, top)) / total + (0.5, 0)
    _set_attribute(mesh, POSITION + texture.name, "CORNER", positions)
    inside = ((low - shift >= -_OVER) & (high - shift <= 1 + _OVER)).all(1)
    slots = [k for k, slot in enumerate(thing.material_slots) if slot.material == texture.material]
    index = array_of(mesh.polygons, "material_index", 1, np.int32)
    index = index.clip(0, len(thing.material_slots) - 1)
    return bool(inside[np.isin(index, slots)].all())


def density(thing: Object, layer: MeshUVLoopLayer) -> np.ndarray:
    """(F,) the square root of the area in the UV map per square metre, of each face of a mesh
    object. 0 for faces without area.
    """
    mesh = thing.data
    mesh.calc_loop_triangles()
    linear = np.array(thing.matrix_world)[:3, :3]
    vertices_m = array_of(mesh.vertices, "co", 3).astype(float) @ linear.T
    corners = array_of(mesh.loop_triangles, "loops", 3, np.int32)
    vertex = array_of(mesh.loops, "vertex_index", 1, np.int32)[corners]
    edges_m = np.diff(vertices_m[vertex], axis=1)
    edges_uv = np.diff(array_of(layer.data, "uv", 2).astype(float)[corners], axis=1)
    face = array_of(mesh.loop_triangles, "polygon_index", 1, np.int32)
    count = len(mesh.polygons)
    doubled_m2 = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
    area_m2 = np.bincount(face, doubled_m2, count)
    area_uv = np.bincount(face, np.abs(np.linalg.det(edges_uv)), count)
    share = np.divide(area_uv, area_m2, out=np.zeros(count), where=area_m2 > 0)
    return np.sqrt(share).astype(np.float32)
