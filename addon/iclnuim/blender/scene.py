"""Opening a scene: a shipped one, or a user-provided file. The file itself is never written."""

import hashlib
from pathlib import Path

import bpy

from .. import shipped
from ..errors import InputError
from ..geometry.scene_axes import SceneReading
from ..shipped import SCENES
from . import compat, scene_paths, user_scene


def open_empty() -> None:
    """An empty scene with factory settings, whatever the user's start-up file holds. Scripts in .blend files do not run."""
    compat.require_supported_version()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def open_scene(name: str, reading: SceneReading | None = None) -> list[str]:
    """Open `name`; returns notes worth telling. Raises InputError for what cannot be opened."""
    open_empty()
    if is_shipped(name):
        bpy.ops.wm.open_mainfile(filepath=str(_shipped_file(name)), load_ui=False, use_scripts=False)
        return []
    return user_scene.open_file(_checked_file(name), reading or SceneReading())


def is_shipped(name: str) -> bool:
    return name in SCENES


def scene_sha256(name: str) -> str:
    """What tells one version of a scene from another: the hash of its file, and of what it takes from beside it.

    Textures of a file that only Blender can read count once it is open: open it first.
    """
    if not is_shipped(name):
        return scene_paths.sha256(_checked_file(name))
    return hashlib.sha256(_shipped_file(name).read_bytes()).hexdigest()


def _checked_file(name: str) -> Path:
    try:
        return user_scene.checked_file(name)
    except InputError as error:
        if error.path is not None:
            raise
        raise InputError(f"a scene: {', '.join(SCENES)} or {error.expected[2:]}", found=name) from None


def _shipped_file(name: str) -> Path:
    """The built .blend of a shipped scene. Raises InputError where it is not there."""
    path = shipped.folder("blend") / f"{name}.blend"
    if not path.is_file():
        raise InputError("the shipped scene", path=path, found="no such file", hint="installing iclnuim again")
    return path
