"""Reading a scene file of any supported format into the open session."""

import io
import logging
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import bpy

from ...errors import InputError
from ...formats.ply import check_ply
from ...shipped import SCENES
from .. import compat

#: The importers keep the file's axes: orient.py rotates and scales.
_OWN_AXES = {"forward_axis": "Y", "up_axis": "Z"}

IMPORTERS: dict[str, Callable[[str], object]] = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path, **_OWN_AXES),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path, **_OWN_AXES),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".fbx": compat.import_fbx,
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), compat.import_usd),
}
KINDS = (".blend", *IMPORTERS)


def checked_file(name: str) -> Path:
    """The full path of a user-provided file.

    Raises InputError if it does not exist or its format is not supported.
    """
    path = Path(name).expanduser().resolve()
    if path.suffix.lower() not in KINDS:
        files = f"a scene file ending in {', '.join(KINDS)}"
        raise InputError(f"a scene: {', '.join(SCENES)} or {files}", found=name)
    if path.is_dir():
        raise InputError("a scene file", path=path, found="a folder")
    if not path.is_file():
        raise InputError("a scene file", path=path, found="no such file")
    if not path.stat().st_size:
        raise InputError("a scene file", path=path, found="an empty file")
    return path


def load(path: Path) -> None:
    """Import the file into the open session.

    A .blend replaces the session, and its scripts are not run. Raises InputError.
    """
    kind = path.suffix.lower()
    if kind == ".ply":
        check_ply(path)
    # importers written in Python log every node of the file and every missing texture
    logging.disable(logging.ERROR)
    try:
        with redirect_stdout(io.StringIO()):  # bpy.ops prints the errors of importers a second time
            result = open_blend(path) if kind == ".blend" else IMPORTERS[kind](str(path))
    except AttributeError:
        wanted = "a Blender that can import this format"
        without = f"{compat.version_line()} without its importer"
        raise InputError(wanted, path=path, found=without) from None
    except (RuntimeError, TypeError, UnicodeDecodeError) as error:
        raise InputError(
            "a scene that Blender can read", path=path, found=_last_message(error)
        ) from None
    finally:
        logging.disable(logging.NOTSET)
    if result != {"FINISHED"}:
        rejected = "a file that its importer rejects"
        raise InputError("a scene that Blender can read", path=path, found=rejected)


def open_blend(path: Path) -> object:
    """Open a .blend without its windows; its scripts are not run."""
    return bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)


def _last_message(error: Exception) -> str:
    """The last line of an importer's message, which contains a traceback if it is in Python."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    messages = [line for line in lines if not line.startswith(("Location:", "File "))]
    return (messages or lines or ["no reason given"])[-1].removeprefix("Error: ")
