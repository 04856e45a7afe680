"""References of a scene to other files: files outside the scene's folder are refused unless
allowed, and all are included in the scene's hash.

Where the kernel has a wall (scene_wall.py), Blender cannot open what is refused here; the refusal
says so in words, before a texture is missing. Where it has none, as in the panel, these names are
all there is.
"""

import functools
import glob
import hashlib
import itertools
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

import bpy
from bpy.types import ID

from ...errors import InputError
from ...geometry.scene_axes import SceneReading
from ..notes import names_of
from . import scene_names
from .scene_names import FileReference

#: Variants of a name that importers may use; each function is applied to the results of the
#: previous ones.
_SPELLINGS = (
    unquote,
    lambda name: name.partition("\0")[0],  # C strings end here
    lambda name: name.replace("\\", "/"),
    lambda name: name.replace('"', ""),
    lambda name: re.sub("^file:(//(localhost)?)?", "", name, flags=re.IGNORECASE),
    lambda name: re.sub("^([A-Za-z]):/", lambda drive: f"/{drive[1].lower()}/", name),
    lambda name: re.sub("^//+", "", name),
    lambda name: name and os.path.normpath(name),
)
#: Maximum length of a path in Blender in bytes (FILE_MAX, without the terminating zero).
_LONGEST = 1023
#: Placeholders for the number of a tile or frame in a file's name.
_NUMBER = re.compile(r"<UDIM>|<UVTILE>|(?<=[._])#+(?=\.)")
#: Names of files in a line of Blender's log: in quotes, or in USD's at signs.
_LOGGED = re.compile(r"'([^'\n]+)'|\"([^\"\n]+)\"|@([^@\n]+)@")


def check(path: Path, reading: SceneReading) -> list[str]:
    """Check the references of a scene before it is opened. Returns a sentence about missing files,
    if any. Raises InputError for references outside its folder.
    """
    missing = []
    for file, named, there in _walk(path):
        if named.computed or any(not _allowed(path, target, reading) for target in there):
            _refuse(file, named.place, named.name, reading)
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
    for target in (*listed, *logged):
        if target.exists() and not _allowed(path, target, reading):
            _refuse(path, "a reference", str(target), reading)


def sha256(path: Path) -> str:
    """The hash of the file and of every other file that it, the open scene, or one of these files
    refers to.
    """
    beside = set(_open_files())
    for _, _, there in _walk(path):
        for target in there:
            beside.update(_files(path, target))
    digest = hashlib.sha256(_content_hash(path))
    for file in sorted({_resolved(file): file for file in sorted(beside)}.values()):
        digest.update(file.name.encode("utf-8", "surrogateescape") + b"\0" + _content_hash(file))
    return digest.hexdigest()


def libraries(path: Path) -> list[Path]:
    """The .blend files that a scene refers to, and those that they refer to."""
    named = itertools.chain(*(there for _, _, there in _walk(path)))
    return sorted({target for target in named if target.suffix == ".blend"})


def _walk(path: Path) -> Iterator[tuple[Path, FileReference, list[Path]]]:
    """(file, reference, existing files) for all references of the scene and, recursively, of the
    files it refers to.

    A file is opened only after the reference to it was yielded, so that the caller can refuse it.
    """
    own = _resolved(path.parent)

    @functools.cache
    def links(folder: Path) -> list[Path]:
        if not _resolved(folder).is_relative_to(own):
            return []
        return [p for p in folder.iterdir() if p.is_symlink()]

    todo = [(path, "")]
    seen = set()
    while todo:
        file, kind = todo.pop()
        key = (os.path.abspath(file), kind)
        if key in seen or not file.is_file():
            continue
        seen.add(key)
        for named in scene_names.named_in(file, kind):
            there: list[Path] = []
            for target in _targets(file.parent, named):
                there += _matches(target, named.folder, links)
            if not there and not named.blenders:
                for target in _last_resorts(file.parent, named):
                    there += _matches(target, False, links)
            yield file, named, there
            todo += [(target, named.kind) for target in there]


def _targets(folder: Path, named: FileReference) -> Iterator[Path]:
    """The paths that a name may refer to. In Blender's paths `//` is the file's folder, else they
    start in the working folder; Blender truncates paths that are too long.
    """
    name = named.name
    start: str | Path = folder
    from_file = named.blenders and name.startswith("//")
    if from_file:
        name = name[2:]
    elif named.blenders:
        start = ""
    for spelled in _spelled(name):
        if from_file:
            spelled = spelled.lstrip("/")
        whole = os.fsencode(os.path.join(start, spelled))
        for encoded in {whole, whole[:_LONGEST]}:
            yield Path(os.fsdecode(encoded))


def _last_resorts(folder: Path, named: FileReference) -> Iterator[Path]:
    """Further paths that importers try for a missing file: the working folder, the last parts of
    the name, spaces instead of underscores.
    """
    for name in _spelled(named.name):
        yield Path(name)
        yield folder / name.replace("_", " ")
        parts = name.split("/")
        for k in range(1, len(parts)):
            yield folder / "/".join(parts[k:])


def _spelled(name: str) -> list[str]:
    names = {name: None}
    for spelling in _SPELLINGS:
        names |= dict.fromkeys(map(spelling, names))
    return [n for n in names if n]


def _matches(target: Path, folder: bool, links: Callable[[Path], list[Path]]) -> list[Path]:
    """The existing files of a name: the file (or folder), tiles and frames of a pattern, and
    symbolic links with similar names next to it.
    """
    with suppress(OSError, ValueError):
        if _NUMBER.search(target.name):
            return sorted(target.parent.glob(_NUMBER.sub("*", glob.escape(target.name))))
        if target.exists() and (folder or not target.is_dir()):
            start = re.split(r"\d", target.name)[0]
            near = [p for p in links(target.parent) if p.suffix == target.suffix]
            return [target, *(p for p in near if p.name.startswith(start))]
    return []


def _allowed(path: Path, target: Path, reading: SceneReading) -> bool:
    if reading.allow_outside:
        return True
    if not target.is_file() and not target.is_dir():
        return False  # reading a pipe would block
    folders = [path.parent]
    if reading.textures:
        folders.append(Path(reading.textures).expanduser())
    return any(_resolved(target).is_relative_to(folder.resolve()) for folder in folders)


def _refuse(file: Path, place: str, name: str, reading: SceneReading) -> None:
    if not reading.allow_outside:
        options = "{textures} DIR to allow the folder DIR, or {allow_outside} to allow all files"
        hint = f"moving them there, packing them into the file, {options}"
        expected = "textures and other files in the scene's own folder"
        raise InputError(expected, path=f"{file}: {place}", found=name, hint=hint)


def _is_denied(name: str) -> bool:
    """Whether the wall around this process (scene_wall.py) hides the file."""
    try:
        if os.path.isabs(name):
            os.close(os.open(name, os.O_RDONLY | os.O_NONBLOCK))
    except PermissionError:
        return True
    except (OSError, ValueError):
        pass
    return False


def _resolved(target: Path) -> Path:
    try:
        return target.resolve()
    except (OSError, RuntimeError, ValueError):
        return Path("/")


def _open_files() -> Iterator[Path]:
    """Every existing external file of the open session, except scripts, which are never read."""
    data = bpy.data
    kinds = (data.images, data.libraries, data.cache_files, data.volumes, data.fonts)
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
        return sorted(p for p in file.parent.glob(_NUMBER.sub("*", pattern)) if p.is_file())
    return []


def _files(path: Path, target: Path) -> list[Path]:
    """The file; for a folder, all files in it, unless the scene itself is in that folder."""
    if not target.is_dir():
        return [target] if target.is_file() else []
    if path.parent.is_relative_to(_resolved(target)):
        return []
    return [p for p in target.rglob("*") if p.is_file()]


def _content_hash(file: Path) -> bytes:
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").digest()
