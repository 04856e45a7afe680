"""Opening a scene: a shipped one, or anybody's .blend, .obj, .glb. The file itself is never written."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy

from .. import scenes, shipped
from ..errors import InputError
from . import session

IMPORTERS = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
}


def open_scene(name: str) -> list[str]:
    """Reset the session and open `name`; returns notes worth telling. Raises InputError for what cannot be opened."""
    session.reset()
    if name in scenes.SCENES:
        _open_shipped(name)
        return []
    path = _checked_file(name)
    try:
        if path.suffix.lower() == ".blend":
            bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
        else:
            IMPORTERS[path.suffix.lower()](str(path))
    except RuntimeError as error:
        raise InputError(
            "a scene that Blender can open", path=path, found=str(error).strip().splitlines()[-1]
        ) from None
    if not any(o.type in {"MESH", "CURVE", "SURFACE", "META", "FONT"} for o in bpy.context.scene.objects):
        raise InputError("a scene with at least one surface", path=path, found="none")
    return _add_light_where_there_is_none()


def scene_sha256(name: str) -> str:
    """What tells one version of a scene from another: the hash of its file."""
    path = _shipped_file(name) if name in scenes.SCENES else _checked_file(name)
    if path is not None:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    sources = sorted(Path(scenes.__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in sources)).hexdigest()


def _shipped_file(name: str) -> Path | None:
    """The built .blend of a shipped scene, or None where it is not there or newer than this Blender."""
    try:
        path = shipped.folder("blend") / f"{name}.blend"
    except InputError:
        return None
    return path if path.is_file() else None


def _open_shipped(name: str) -> None:
    path = _shipped_file(name)
    if path is None:
        scenes.build_scene(name)
    else:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)


def _checked_file(name: str) -> Path:
    path = Path(name).expanduser().resolve()
    kinds = (".blend", *IMPORTERS)
    if path.suffix.lower() not in kinds:
        raise InputError(f"a scene: {', '.join(scenes.SCENES)} or a file ending in {', '.join(kinds)}", found=name)
    if not path.is_file():
        raise InputError("a scene file", path=path, found="nothing of that name")
    return path


def _add_light_where_there_is_none() -> list[str]:
    """Imported geometry often has no light at all: then an even grey sky, and a note."""
    world = bpy.context.scene.world
    if world is not None or any(o.type == "LIGHT" for o in bpy.context.scene.objects) or _any_emission():
        return []
    world = bpy.data.worlds.new("Neutral light")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    bpy.context.scene.world = world
    return ["the scene has no light: an even white sky was added"]


def _any_emission() -> bool:
    trees = [m.node_tree for m in bpy.data.materials if m.use_nodes and m.node_tree]
    return any(node.type == "EMISSION" for tree in trees for node in tree.nodes)
