"""A key of everything that determines a scene's light: surfaces, materials, images, lamps, world,
bounces. Equal scenes have equal keys.

Texture coordinates that Blender's modifiers compute differ by some 1e-7 from process to process, and
no rounding makes them equal: they are compared within a tolerance instead.
"""

import hashlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import (
    ColorRamp,
    CurveMap,
    CurveMapping,
    Image,
    Material,
    Node,
    NodeTree,
    Object,
    Scene,
    bpy_struct,
)

from ..compat import nodes_of
from ..surfaces import Part, array_of

#: Cycles settings that change the light, not only its noise.
_CYCLES = (
    "max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces",
    "transparent_max_bounces",
    "caustics_reflective", "caustics_refractive", "blur_glossy", "sample_clamp_direct",
    "sample_clamp_indirect",
    "light_sampling_threshold", "use_fast_gi",
)  # fmt: skip
#: Properties of nodes and lamps that do not change light.
_NOT_LIGHT = {
    "rna_type", "name", "location", "width", "height", "select", "show_options", "show_preview",
    "hide", "label", "color",
    "use_custom_color", "parent", "inputs", "outputs", "internal_links", "dimensions", "bl_idname",
    "location_absolute",
    "warning_propagation", "name_full", "users", "use_fake_user", "tag", "session_uid",
    "is_missing", "preview", "asset_data",
    "library", "image_user", "show_texture",
}  # fmt: skip
#: Texture coordinates that differ by less are equal: a sixth of a pixel of a picture 16k wide, and
#: 25 times what two processes differ by. Far from 0, float32 is coarser.
_UV = 1e-5
_UV_SHARE = 1e-6
#: Types of a struct's pointers that are included.
_POINTED = (ColorRamp, CurveMapping, Image)


def key_parts(found: list[Part], scene: Scene, with_uv: bool = False) -> dict[str, str]:
    """A hash (hexadecimal) for each of: surfaces, materials, images, lamps, world, bounces.

    with_uv: surfaces with their texture coordinates, whose last bits depend on the process.
    """
    materials: set[Material] = set()
    for part in found:
        materials.update(material for material in part.mesh.materials if material is not None)
    images: set[str] = set()
    for block in (*materials, scene.world):
        if block is not None and block.node_tree:
            nodes = nodes_of(block.node_tree)
            images.update(_image(n.image) for n in nodes if getattr(n, "image", None))
    lamps = [o for o in scene.objects if o.type == "LIGHT" and not o.hide_render]
    world = {}
    if scene.world is not None:
        world = {"colour": tuple(scene.world.color), "nodes": _tree(scene.world.node_tree)}
    return {
        "surfaces": _hash(*(_part(part, with_uv) for part in found)),
        "materials": _hash(*sorted(_text(_material(m)) for m in materials)),
        "images": _hash(*sorted(images)),
        "lamps": _hash(*sorted(_text(_lamp(lamp)) for lamp in lamps)),
        "world": _hash(_text(world)),
        "bounces": _hash(_text(_present(scene.cycles, _CYCLES))),
    }


def _present(thing: object, names: tuple[str, ...]) -> dict:
    return {name: getattr(thing, name) for name in names if hasattr(thing, name)}


def _hash(*items: bytes | str) -> str:
    digest = hashlib.sha256()
    for item in items:
        item = item.encode() if isinstance(item, str) else item
        digest.update(len(item).to_bytes(8, "little") + item)
    return digest.hexdigest()


def _text(value: object) -> str:
    """Convert plain values to text that does not depend on addresses or the order of
    dictionaries.
    """
    if isinstance(value, dict):
        return "{" + ",".join(f"{k}:{_text(v)}" for k, v in sorted(value.items())) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_text, value)) + "]"
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def uv_of(found: list[Part]) -> np.ndarray:
    """(n, 2) float32: the texture coordinates of all parts, layer by layer."""
    layers = [layer for part in found for layer in part.mesh.uv_layers]
    whole = [array_of(layer.data, "uv", 2, np.float32) for layer in layers]
    return np.concatenate([np.zeros((0, 2), np.float32), *whole])


def same_uv(uv: np.ndarray, other: np.ndarray) -> bool:
    """Whether texture coordinates are equal but for rounding."""
    return uv.shape == other.shape and np.allclose(
        uv, other, rtol=_UV_SHARE, atol=_UV, equal_nan=True
    )


def _part(part: Part, with_uv: bool) -> bytes:
    mesh = part.mesh
    arrays = [
        np.array(part.matrix, np.float32),
        array_of(mesh.vertices, "co", 3, np.float32),
        array_of(mesh.loops, "vertex_index", 1, np.int32),
        array_of(mesh.polygons, "loop_start", 1, np.int32),
        array_of(mesh.polygons, "material_index", 1, np.int32),
        np.round(array_of(mesh.corner_normals, "vector", 3, np.float32) * 1e4).astype(np.int32),
    ]
    if with_uv:
        arrays += [array_of(layer.data, "uv", 2, np.float32) for layer in mesh.uv_layers]
    names = [getattr(material, "name", "") for material in mesh.materials]
    rays = _visible(part.source, "diffuse", "glossy", "transmission", "shadow")
    named = [part.name, names, rays]
    if not with_uv:
        named.append([layer.name for layer in mesh.uv_layers])
    return _hash(*[a.tobytes() for a in arrays], _text(named)).encode()


def _visible(thing: Object, *rays: str) -> list[bool]:
    return [getattr(thing, f"visible_{ray}", True) for ray in rays]


def _material(material: Material) -> dict:
    names = ("emission_sampling", "use_transparent_shadow")
    return {
        "name": material.name,
        "cycles": {name: getattr(material.cycles, name, None) for name in names},
        "nodes": _tree(material.node_tree),
        "colour": tuple(material.diffuse_color),
    }


def _lamp(thing: Object) -> dict:
    data = thing.data
    names = ("is_portal", "cast_shadow", "max_bounces", "use_multiple_importance_sampling")
    return {
        "matrix": np.round(np.array(thing.matrix_world), 6).ravel().tolist(),
        "cycles": {name: getattr(data.cycles, name, None) for name in names},
        "rays": _visible(thing, "diffuse", "glossy", "transmission", "camera"),
        "data": _plain_properties(data),
        "nodes": _tree(data.node_tree),
    }


def _tree(tree: NodeTree | None) -> list:
    """The nodes with their settings and unlinked inputs, and the links between them, without layout
    and selection.
    """
    if tree is None:
        return []
    nodes = [_node(node) for node in sorted(tree.nodes, key=lambda n: n.name)]
    ends = []
    for link in tree.links:
        source = (link.from_node.name, link.from_socket.identifier)
        ends.append((*source, link.to_node.name, link.to_socket.identifier))
    return [nodes, sorted(ends)]


def _node(node: Node) -> dict:
    sockets = [s for s in [*node.inputs, *node.outputs] if hasattr(s, "default_value")]
    return {
        "name": node.name,
        "kind": node.bl_idname,
        "settings": _plain_properties(node),
        "inputs": [(s.identifier, _value(s.default_value)) for s in sockets],
        "inner": _tree(node.node_tree) if node.type == "GROUP" else [],
    }


def _plain_properties(thing: bpy_struct) -> dict:
    """The numbers, texts, colour ramps and curves of an RNA struct."""
    found = {}
    for entry in thing.bl_rna.properties:
        name = entry.identifier
        if name in _NOT_LIGHT or name.startswith("bl_") or entry.type == "COLLECTION":
            continue
        is_pointer = entry.type == "POINTER"
        if entry.is_readonly and not is_pointer:
            continue
        value = getattr(thing, name, None)
        if value is not None and (not is_pointer or isinstance(value, _POINTED)):
            found[name] = _value(value)
    return found


def _value(value: Any) -> Any:
    if isinstance(value, ColorRamp):
        stops = [(e.position, tuple(e.color)) for e in value.elements]
        return [value.interpolation, value.color_mode, value.hue_interpolation, stops]
    if isinstance(value, CurveMapping):
        return [_curve_points(curve) for curve in value.curves]
    if isinstance(value, bool | int | float | str | list | tuple):
        return value
    return tuple(value) if hasattr(value, "__len__") else str(getattr(value, "name", ""))


def _curve_points(curve: CurveMap) -> list:
    return [(tuple(point.location), point.handle_type) for point in curve.points]


def _image(image: Image) -> str:
    """A hash of name, colour space and content: the packed or referenced file, or the pixels of an
    image that is only in memory.
    """
    file = Path(bpy.path.abspath(image.filepath, library=image.library))
    is_saved = image.source == "FILE" and image.filepath and not image.is_dirty
    if image.packed_file is not None:
        content = image.packed_file.data
    elif is_saved and file.is_file():
        content = file.read_bytes()
    else:
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        content = pixels.tobytes()
    return _hash(image.name, image.colorspace_settings.name, image.alpha_mode, content)
