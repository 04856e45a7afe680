"""Blender's readers behind one door: a scene file of any kind into the open session, in the file's own axes and units."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..formats.ply import check_ply
from ..geometry import axes
from . import compat

#: The file's own axes are kept: turning and scaling is the one business of placing.py.
_OWN_AXES = {"forward_axis": "Y", "up_axis": "Z"}

IMPORTERS: dict[str, Callable[[str], object]] = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path, **_OWN_AXES),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path, **_OWN_AXES),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".fbx": compat.import_fbx,
    **{kind: compat.import_usd for kind in (".usd", ".usda", ".usdc", ".usdz")},
}
KINDS = (".blend", *IMPORTERS)
#: What the importer itself has done to the file's axes.
_TURNED = {".glb": axes.Z_UP_FROM_Y_UP, ".gltf": axes.Z_UP_FROM_Y_UP}
#: Formats that say nothing about axes and units, and the axis that mostly points up in them.
SILENT = {".obj": "y", ".ply": "z"}


def checked_file(name: str) -> Path:
    """The file's full path. Raises InputError for what is not there or of no known kind."""
    path = Path(name).expanduser().resolve()
    if path.suffix.lower() not in KINDS:
        raise InputError(f"a scene file ending in {', '.join(KINDS)}", found=name)
    if not path.is_file():
        raise InputError("a scene file", path=path, found="a folder" if path.is_dir() else "nothing of that name")
    if not path.stat().st_size:
        raise InputError("a scene file", path=path, found="an empty file")
    return path


def importers_turn(path: Path) -> np.ndarray:
    """(3, 3) rotation by which what was imported differs from the file."""
    return _TURNED.get(path.suffix.lower(), np.eye(3))


def load(path: Path) -> None:
    """Bring the file into the open session; a .blend takes the session's place, and its scripts stay asleep. Raises InputError."""
    if path.suffix.lower() == ".ply":
        check_ply(path)
    logging.disable(logging.WARNING)  # readers written in Python tell every node of the file
    try:
        if path.suffix.lower() == ".blend":
            result = bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
        else:
            result = IMPORTERS[path.suffix.lower()](str(path))
    except AttributeError:
        raise InputError(
            "a Blender that reads this kind of file", path=path, found=f"{compat.version_line()} without its reader"
        ) from None
    except (RuntimeError, TypeError, UnicodeDecodeError) as error:
        raise InputError("a scene that Blender can read", path=path, found=_last_line(error)) from None
    finally:
        logging.disable(logging.NOTSET)
    if result != {"FINISHED"}:
        raise InputError("a scene that Blender can read", path=path, found="a file that its reader gives up on")


def _last_line(error: Exception) -> str:
    """What the reader said last; a Python reader's whole traceback comes with it."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(("Location:", "File "))]
    return (told or lines or ["no reason given"])[-1].removeprefix("Error: ")
