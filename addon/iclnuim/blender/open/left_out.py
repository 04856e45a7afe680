"""What Blender's importers leave out of a file: colours of faces are read here, notes name the
rest.
"""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...formats.ply import face_colours, read_header
from ...scene_files import scene_names
from .. import compat
from ..notes import names_of
from ..surfaces import array_of
from . import glass, plain_names


def completed(path: Path) -> list[str]:
    """Read colours of the faces of an imported PLY, and hide what an FBX hides. Returns notes on
    what else is missing in the open scene.
    """
    finder = _FINDERS.get(path.suffix.lower())
    return finder(path) if finder else []


def _of_gltf(path: Path) -> list[str]:
    used = scene_names.gltf_content(path).get("extensionsUsed") or []
    unread = {str(name) for name in used} - compat.gltf_extensions()
    return _note("extensions that Blender does not read", unread, "left out")


def _of_obj(path: Path) -> list[str]:
    named = re.findall(rb"^[ \t]*usemtl[ \t]+(.+?)\s*$", path.read_bytes(), re.MULTILINE)
    described = {name for name, _ in glass.mtl_materials(path)}
    missing = {name.decode("utf-8", "replace") for name in named} - described
    return _note("materials that no .mtl file describes", missing, "plain grey")


def _of_ply(path: Path) -> list[str]:
    _colour_faces(bpy.data.meshes[0], face_colours(path))
    with open(path, "rb") as content:
        comments = content.read(read_header(path).at)
    images = re.findall(rb"^comment TextureFile (.+?)\s*$", comments, re.MULTILINE)
    names = {Path(image.decode("utf-8", "replace")).name for image in images}
    return _note("textures of a PLY, which Blender does not read", names, "left out")


def _colour_faces(mesh: bpy.types.Mesh, colours: np.ndarray) -> None:
    """Give a mesh without colours those of its faces (m, 3)."""
    if mesh.color_attributes or len(mesh.polygons) != len(colours):
        return
    sizes = array_of(mesh.polygons, "loop_total", 1, np.int32)
    rgba = np.ones((len(mesh.loops), 4), np.float32)
    rgba[:, :3] = np.repeat(colours, sizes, axis=0) / 255
    layer = mesh.color_attributes.new("colours of faces", "BYTE_COLOR", "CORNER")
    layer.data.foreach_set("color_srgb", rgba.ravel())


def _of_usd(_: Path) -> list[str]:
    """Materials of other renderers have no nodes, and some versions show them black."""
    unread = [m for m in bpy.data.materials if not (m.node_tree and m.node_tree.nodes)]
    notes = _note("materials without a USD Preview Surface", unread, "plain grey")
    for material in unread:
        material.user_remap(compat.matt_material(material.name, (0.8, 0.8, 0.8, 1.0))[0])
    return notes


def _of_fbx(_: Path) -> list[str]:
    """Blender hides in the viewport what the file hides."""
    hidden = [thing for thing in bpy.context.scene.objects if thing.hide_viewport]
    for thing in hidden:
        thing.hide_render = True
    return _note("objects that the file hides", hidden, "left out")


def _note(what: str, things: Collection[Any], done: str) -> list[str]:
    return [f"{what} ({plain_names.plain(names_of(things))}): {done}"] if things else []


_FINDERS = {
    **dict.fromkeys((".gltf", ".glb"), _of_gltf),
    ".obj": _of_obj,
    ".ply": _of_ply,
    ".fbx": _of_fbx,
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _of_usd),
}
