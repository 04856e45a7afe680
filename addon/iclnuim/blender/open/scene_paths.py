"""References of a scene to other files: files outside the scene's folder are refused unless
allowed, and all are included in the scene's hash.

Where the kernel has a wall (scene_wall.py), Blender cannot open what is refused here; the refusal
says so in words, before a texture is missing. Where it has none, as in the panel, these names are
all there is.
"""

import glob
import hashlib
import itertools
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.types import ID

from ...errors import InputError
from ...geometry.scene_axes import SceneReading
from ...scene_files.search import NUMBER, allowed, is_hidden, resolved, visible, walk
from ..notes import names_of

#: Where files may be that a scene names; that of a format whose names are known late, which may not
#: read all of its folder.
_OWN = "in the scene's own folder"
_SHOWN = "in the scene's own folder, not in a hidden folder of it"
_LISTED = "in the scene's own folder, if that is not your home"
#: Names of files in a line of Blender's log: in quotes, or in USD's at signs.
_LOGGED = re.compile(r"'([^'\n]+)'|\"([^\"\n]+)\"|@([^@\n]+)@")


def check(path: Path, reading: SceneReading) -> list[str]:
    """Check the references of a scene before it is opened. Returns a sentence about missing files,
    if any. Raises InputError for references outside its folder.
    """
    missing = []
    for file, named, there in walk(path):
        refused = [target for target in there if not allowed(path, target, reading)]
        if named.computed or refused:
            own = path.parent.resolve()
            below = (one for one in map(resolved, refused) if one.is_relative_to(own))
            where = _SHOWN if any(is_hidden(one, own) for one in below) else _OWN
            _refuse(file, named.place, named.name, reading, where)
        if named.report_missing and not there:
            missing.append(Path(named.name.replace("\\", "/")).name)
    if not missing:
        return []
    names = names_of(set(missing))
    return [f"files that the scene refers to are missing ({names}): it is read without them"]


def check_open(path: Path, reading: SceneReading, log: str) -> None:
    """Check the files of the open scene: those that Blender lists, and those that it could not
    read, as its `log` says. Raises InputError.

    The strips of the sequencer are removed from the open scene: like scripts, they are never read.
    """
    for scene in bpy.data.scenes:
        scene.sequence_editor_clear()
    scripts = {bpy.path.abspath(text.filepath) for text in bpy.data.texts}
    names = filter(None, bpy.utils.blend_paths(absolute=True))  # a cache without a path has ""
    listed = (Path(name) for name in names if name not in scripts)
    # another .blend is a library, or only remembered as the origin of a copied block
    listed = (target for target in listed if target.suffix != ".blend")
    logged = (Path(name) for name in itertools.chain(*_LOGGED.findall(log)) if _is_denied(name))
    for target in listed:
        if target.exists() and not allowed(path, target, reading):
            _refuse(path, "a reference", str(target), reading)
    for target in logged:
        where = _LISTED if allowed(path, target, reading) else _OWN
        _refuse(path, "a reference", str(target), reading, where)


def sha256(path: Path) -> str:
    """The hash of the file and of every other file that it, the open scene, or one of these files
    refers to.
    """
    beside = set(_open_files())
    for _, _, there in walk(path):
        for target in there:
            beside.update(_files(path, target))
    digest = hashlib.sha256(_content_hash(path))
    for file in sorted({resolved(file): file for file in sorted(beside)}.values()):
        digest.update(file.name.encode("utf-8", "surrogateescape") + b"\0" + _content_hash(file))
    return digest.hexdigest()


def libraries(path: Path) -> list[Path]:
    """The .blend files that a scene refers to, and those that they refer to."""
    named = itertools.chain(*(there for _, _, there in walk(path)))
    return sorted({target for target in named if target.suffix == ".blend"})


def _refuse(file: Path, place: str, name: str, reading: SceneReading, where: str = _OWN) -> None:
    if not reading.allow_outside:
        options = "{textures} DIR to allow the folder DIR, or {allow_outside} to allow all files"
        hint = f"moving them there, packing them into the file, {options}"
        raise InputError(
            f"textures and other files {where}", path=f"{file}: {place}", found=name, hint=hint
        )


def _is_denied(name: str) -> bool:
    """Whether the wall around this process (scene_wall.py) hides a file that the user may read."""
    try:
        if os.path.isabs(name) and os.access(name, os.R_OK):
            os.close(os.open(name, os.O_RDONLY | os.O_NONBLOCK))
    except PermissionError:
        return True
    except (OSError, ValueError):
        pass
    return False


def _open_files() -> Iterator[Path]:
    """Every existing external file of the open session, except scripts, which are never read, and
    libraries, which the search finds.
    """
    data = bpy.data
    kinds = (data.images, data.cache_files, data.volumes, data.fonts)
    for block in itertools.chain(*kinds, data.movieclips, data.sounds):
        is_named = block.filepath and block.filepath != "<builtin>"
        if is_named and getattr(block, "packed_file", None) is None:
            file = Path(bpy.path.abspath(block.filepath, library=block.library))
            yield from _frames(block, file)


def _frames(block: ID, file: Path) -> list[Path]:
    """The existing files of a path: the file itself, UDIM tiles, or the images of a sequence."""
    pattern = glob.escape(file.name)
    if getattr(block, "source", "") == "SEQUENCE" or getattr(block, "is_sequence", False):
        pattern = re.sub(r"\d+(?=\D*$)", "*", pattern)
    with suppress(OSError, ValueError):
        return sorted(p for p in file.parent.glob(NUMBER.sub("*", pattern)) if p.is_file())
    return []


def _files(path: Path, target: Path) -> list[Path]:
    """The file; for a folder, all files in it, unless the scene itself is in that folder."""
    if not target.is_dir():
        return [target] if target.is_file() else []
    if path.parent.is_relative_to(resolved(target)):
        return []
    parts = visible(target)
    inside = itertools.chain(*(part.rglob("*") for part in parts))
    return [p for p in (*parts, *inside) if p.is_file()]


def _content_hash(file: Path) -> bytes:
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").digest()
