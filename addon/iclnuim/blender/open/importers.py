"""Reading a scene file of any supported format into the open session."""

import io
import logging
import os
import re
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import bpy
import numpy as np

from ...errors import InputError
from ...formats.obj import read_obj
from ...formats.ply import check_ply
from ...shipped import SCENES
from .. import compat

#: Importers leave out faces that are not valid, which are few.
_WHOLE = 0.9
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


def load(path: Path, log: Path = Path(os.devnull)) -> None:
    """Import the file into the open session. log: what Blender's libraries print meanwhile.

    A .blend replaces the session, and its scripts are not run. Raises InputError.
    """
    kind = path.suffix.lower()
    triangles = np.zeros((0, 3), np.int64)
    if kind == ".ply":
        triangles = check_ply(path)
    elif kind == ".obj":
        _, triangles = read_obj(path)
    before = _triangle_count()
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
        raise _unread(path, _last_message(error), log.read_text("utf-8", "replace")) from None
    finally:
        logging.disable(logging.NOTSET)
    if result != {"FINISHED"}:
        rejected = "a file that its importer rejects"
        raise InputError("a scene that Blender can read", path=path, found=rejected)
    if kind == ".fbx":
        _order_by_name()
    _check_whole(path, triangles, _triangle_count() - before)


def _order_by_name() -> None:
    """Link the objects of the scene anew in the order of their names: Blender's importer of
    FBX links them in another one in every process, and light maps and frames depend on it.
    """
    collection = bpy.context.scene.collection
    for place in (collection, *collection.children_recursive):
        things = sorted(place.objects, key=lambda thing: thing.name)
        for thing in things:
            place.objects.unlink(thing)
        for thing in things:
            place.objects.link(thing)


def _triangle_count() -> int:
    """The triangles of all meshes; a polygon of n corners has n - 2."""
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in bpy.data.meshes)


def _check_whole(path: Path, triangles: np.ndarray, imported: int) -> None:
    """Raises InputError if Blender's importer has passed over triangles (m, 3) of a file, as for
    comments in lines of an OBJ file. Faces that stand twice may be missing.
    """
    if not len(triangles) or imported == len(triangles):
        return
    corners = np.sort(triangles, axis=1)
    proper = corners[(np.diff(corners, axis=1) > 0).all(axis=1)]
    least = _WHOLE * len(np.unique(proper, axis=0))
    if not least <= imported <= len(triangles):
        expected = f"{len(triangles)} triangles that Blender can read"
        hint = "writing the file again with another program"
        raise InputError(expected, path=path, found=imported, hint=hint)


def open_blend(path: Path) -> object:
    """Open a .blend without its windows; its scripts are not run."""
    return bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)


def _unread(path: Path, found: str, log: str) -> InputError:
    """The error of a file that an importer rejects with the message `found`; if it is a USD file,
    with the place where the log says that parsing ended.
    """
    line = hint = None
    if place := re.search(rf"{re.escape(path.name)}:(\d+):\d+: .* at '(.*)' in <", log):
        line = int(place[1])
        found = f"what USD cannot parse: {place[2]}"
    if found.startswith("Extension "):
        hint = "exporting it again without this extension"
    return InputError("a scene that Blender can read", path=path, line=line, found=found, hint=hint)


def _last_message(error: Exception) -> str:
    """The last line of an importer's message, which contains a traceback if it is in Python."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    messages = [line for line in lines if not line.startswith(("Location:", "File "))]
    last = (messages or lines or ["no reason given"])[-1]
    return last.removeprefix("Error: ").removesuffix(", see console for detail")
