"""References of a scene to other files: files outside the scene's folder are refused unless
allowed, and all are included in the scene's hash.
"""

import functools
import glob
import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

import bpy

from ...errors import InputError
from ...geometry.scene_axes import SceneReading
from . import scene_names
from .scene_names import Named

#: Variants of a name that importers may use; each function is applied to the results of the
#: previous ones.
_SPELLINGS = (
    unquote,
    lambda name: name.partition("\0")[0],  # C strings end here
    lambda name: name.replace("\\", "/"),
    lambda name: name.replace('"', ""),
    lambda name: re.sub("^file:(//(localhost)?)?", "", name, flags=re.IGNORECASE),
    lambda name: re.sub("^([A-Za-z]):/", lambda drive: f"/{drive[1].lower()}/", name),
    lambda name: name.lstrip("/") if name.startswith("//") else name,
    lambda name: os.path.normpath(name) if name else name,
)
#: Maximum length of a path in Blender in bytes (FILE_MAX, without the terminating zero).
_LONGEST = 1023
#: Placeholders for the number of a tile or frame in a file's name.
_NUMBER = re.compile(r"<UDIM>|<UVTILE>|(?<=[._])#+(?=\.)")


def check(path: Path, reading: SceneReading) -> list[str]:
    """Check the references of a scene before it is opened. Returns a sentence about missing files,
    if any. Raises InputError for references
    outside its folder.
    """
    missing = []
    for file, named, there in _walk(path):
        if named.computed or any(not _allowed(path, target, reading) for target in there):
            _refuse(file, named.place, named.name, reading)
        if named.report_missing and not there:
            missing.append(Path(named.name.replace("\\", "/")).name)
    names = ", ".join(dict.fromkeys(missing))[:160]
    return (
        [f"files that the scene refers to are missing ({names}): it is read without them"]
        if missing
        else []
    )


def check_open(path: Path, reading: SceneReading) -> None:
    """Check the references of the open scene: textures, libraries, volumes, caches, fonts and
    sounds. Raises InputError.
    """
    for block, file in _referenced():
        for target in _frames(block, file):
            if not _allowed(path, target, reading):
                _refuse(path, block.name, block.filepath, reading)


def sha256(path: Path) -> str:
    """The hash of the file and of every other file that it, the open scene, or one of these files
    refers to.
    """
    named = {
        file for _, _, there in _walk(path) for target in there for file in _files(path, target)
    }
    beside = named | {target for block, file in _referenced() for target in _frames(block, file)}
    digest = hashlib.sha256(_content_hash(path))
    for file in sorted({_resolved(file): file for file in sorted(beside)}.values()):
        digest.update(file.name.encode("utf-8", "surrogateescape") + b"\0" + _content_hash(file))
    return digest.hexdigest()


def _walk(path: Path) -> Iterator[tuple[Path, Named, list[Path]]]:
    """(file, reference, existing files) for all references of the scene and, recursively, of the
    files it refers to.

    A file is opened only after the reference to it was yielded, so that the caller can refuse it.
    """
    todo, seen, own = [(path, "")], set(), _resolved(path.parent)

    @functools.cache
    def links(folder: Path) -> list[Path]:
        return (
            [p for p in folder.iterdir() if p.is_symlink()]
            if _resolved(folder).is_relative_to(own)
            else []
        )

    while todo:
        file, kind = todo.pop()
        if (key := (os.path.abspath(file), kind)) in seen or not file.is_file():
            continue
        seen.add(key)
        for named in scene_names.named_in(file, kind):
            there = [
                match
                for target in _targets(file.parent, named)
                for match in _matches(target, named.folder, links)
            ]
            if not there and not named.blenders:
                there = [
                    t
                    for target in _last_resorts(file.parent, named)
                    for t in _matches(target, False, links)
                ]
            yield file, named, there
            todo += [(target, named.kind) for target in there]


def _targets(folder: Path, named: Named) -> list[Path]:
    """The paths that a name may refer to. In Blender's paths `//` is the file's folder, else they
    start in the working folder; Blender truncates
    paths that are too long.
    """
    own = named.blenders and named.name.startswith("//")
    names = _spelled(named.name[2:]) if own else _spelled(named.name)
    start = "" if named.blenders and not own else folder
    wholes = [os.fsencode(os.path.join(start, name.lstrip("/") if own else name)) for name in names]
    return [Path(os.fsdecode(whole)) for name in wholes for whole in {name, name[:_LONGEST]}]


def _last_resorts(folder: Path, named: Named) -> Iterator[Path]:
    """Further paths that importers try for a missing file: the working folder, the last parts of
    the name, spaces instead of underscores.
    """
    for name in _spelled(named.name):
        parts = name.split("/")
        yield from (Path(name), folder / name.replace("_", " "))
        yield from (folder / "/".join(parts[k:]) for k in range(1, len(parts)))


def _spelled(name: str) -> list[str]:
    names = {name: None}
    for spelling in _SPELLINGS:
        names |= dict.fromkeys(spelling(n) for n in names)
    return [n for n in names if n]


def _matches(target: Path, folder: bool, links: Callable[[Path], list[Path]]) -> list[Path]:
    """The existing files of a name: the file (or folder), tiles and frames of a pattern, and
    symbolic links with similar names next to it.
    """
    with suppress(OSError, ValueError):
        if _NUMBER.search(target.name):
            return sorted(target.parent.glob(_NUMBER.sub("*", glob.escape(target.name))))
        if target.exists() and (folder or not target.is_dir()):
            alike = re.split(r"\d", target.name)[0]
            near = links(target.parent)
            return [
                target,
                *(p for p in near if p.suffix == target.suffix and p.name.startswith(alike)),
            ]
    return []


def _allowed(path: Path, target: Path, reading: SceneReading) -> bool:
    folders = [path.parent, *([Path(reading.textures).expanduser()] if reading.textures else [])]
    inside = any(_resolved(target).is_relative_to(folder.resolve()) for folder in folders)
    return reading.allow_outside or (
        inside and (target.is_file() or target.is_dir())
    )  # reading a pipe would block


def _refuse(file: Path, place: str, name: str, reading: SceneReading) -> None:
    if not reading.allow_outside:
        hint = "moving them there, packing them into the file, {textures} DIR to allow the folder DIR, or {allow_outside} to allow all files"
        expected = "textures and other files in the scene's own folder"
        raise InputError(expected, path=f"{file}: {place}", found=name, hint=hint)


def _resolved(target: Path) -> Path:
    try:
        return target.resolve()
    except (OSError, RuntimeError, ValueError):
        return Path("/")


def _referenced() -> Iterator[tuple[bpy.types.ID, Path]]:
    """(block, absolute path) of every external file of the open session, except scripts, which are
    never read.
    """
    data = bpy.data
    kinds = (
        data.images,
        data.libraries,
        data.cache_files,
        data.volumes,
        data.fonts,
        data.movieclips,
        data.sounds,
    )
    for block in (block for blocks in kinds for block in blocks):
        if (
            block.filepath
            and block.filepath != "<builtin>"
            and getattr(block, "packed_file", None) is None
        ):
            yield block, Path(bpy.path.abspath(block.filepath, library=block.library))


def _frames(block: bpy.types.ID, file: Path) -> list[Path]:
    """The existing files of a path: the file itself, UDIM tiles, or the images of a sequence."""
    pattern = glob.escape(file.name)
    if getattr(block, "source", "") == "SEQUENCE" or getattr(block, "is_sequence", False):
        pattern = re.sub(r"\d+(?=\D*$)", "*", pattern)
    with suppress(OSError, ValueError):
        return sorted(p for p in file.parent.glob(_NUMBER.sub("*", pattern)) if p.is_file())
    return []


def _files(path: Path, target: Path) -> list[Path]:
    """The file; for a folder, all files in it, unless the scene itself is in that folder."""
    if target.is_dir():
        inside = path.parent.is_relative_to(_resolved(target))
        return [] if inside else sorted(p for p in target.rglob("*") if p.is_file())
    return [target] if target.is_file() else []


def _content_hash(file: Path) -> bytes:
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").digest()
