"""The search for the files that a scene names, and which of them it may read: those in its own
folder, but not through a hidden folder below it, and those in the folder that the user allows.
"""

import functools
import glob
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

from ..errors import InputError
from ..geometry.scene_axes import SceneReading
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
NUMBER = re.compile(r"<UDIM>|<UVTILE>|(?<=[._])#+(?=\.)")
#: The numbers of frames, and of tiles (1001 to 2000), that are tried in a folder that is not listed.
_NUMBERS = 10_000
#: A name with its last number.
_LAST_NUMBER = re.compile(r"(.*?)(\d*)(\D*)", re.DOTALL)


def allowed(scene: Path, target: Path, reading: SceneReading) -> bool:
    """Whether a scene may read the target: a file or folder in its own folder and in no hidden
    folder below it, or in the folder that the user allows.
    """
    if reading.allow_outside:
        return True
    if not target.is_file() and not target.is_dir():
        return False  # reading a pipe would block
    if reading.textures:
        textures = Path(reading.textures).expanduser().resolve()
        if resolved(target).is_relative_to(textures):
            return True
    own = scene.parent.resolve()
    return resolved(target).is_relative_to(own) and not is_hidden(resolved(target), own)


def is_hidden(target: Path, below: Path) -> bool:
    """Whether a file below a folder is hidden, or in a hidden folder below it."""
    return any(part.startswith(".") for part in target.relative_to(below).parts)


def readable(scene: Path, reading: SceneReading) -> list[Path]:
    """The files and folders that a process may read which opens the scene: its file, and what it
    names and may read. Where a name has a number, so do the frames and tiles beside it.

    Where the names cannot be found, as in USD without Blender or in a damaged file, all that is
    visible in its folder.
    """
    found = [scene]

    @functools.cache
    def names_beside(folder: Path) -> list[str]:
        return _names_in(folder) if allowed(scene, folder, reading) else []

    try:
        if not scene.stat().st_size:
            found += visible(scene.parent)
        for file, named, there in walk(scene):
            if not all(allowed(scene, target, reading) for target in there):
                break  # it is refused in words; what it names must not even be searched
            near = _near(file.parent, named, names_beside)
            for target in (*there, *(one for one in near if allowed(scene, one, reading))):
                found += visible(target) if target.is_dir() else [target]
    except (InputError, OSError):
        found += visible(scene.parent)
    return list(dict.fromkeys(found))


def visible(folder: Path) -> list[Path]:
    """The folder if nothing in it is hidden, else the parts of it that are not; nothing of the home
    folder.
    """
    if resolved(Path.home()).is_relative_to(resolved(folder)):
        return []
    found = []
    hidden = False
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                hidden = True
            elif entry.is_symlink():  # it may lead anywhere
                continue
            elif entry.is_dir(follow_symlinks=False):
                parts = visible(Path(entry.path))
                hidden |= parts != [Path(entry.path)]
                found += parts
            else:
                found.append(Path(entry.path))
    return found if hidden else [folder]


def _names_in(folder: Path) -> list[str]:
    with suppress(OSError, ValueError):  # also of a NUL in a damaged name
        return os.listdir(folder)
    return []


def _near(
    folder: Path, named: FileReference, names_beside: Callable[[Path], list[str]]
) -> Iterator[Path]:
    """What Blender finds by a name besides its file: the other frames of a sequence, and files
    whose names differ in upper and lower case.
    """
    for target in _targets(folder, named):
        head, digits, tail = _LAST_NUMBER.fullmatch(target.name).groups()  # type: ignore[union-attr]
        number = r"\d+" if digits else ""
        pattern = re.compile(re.escape(head) + number + re.escape(tail), re.IGNORECASE)
        for name in names_beside(target.parent):
            if pattern.fullmatch(name):
                yield target.with_name(name)


def walk(path: Path) -> Iterator[tuple[Path, FileReference, list[Path]]]:
    """(file, reference, existing files) for all references of the scene and, recursively, of the
    files it refers to.

    A file is opened only after the reference to it was yielded, so that the caller can refuse it.
    """
    own = resolved(path.parent)

    @functools.cache
    def may_list(folder: Path) -> bool:
        there = resolved(folder)
        return there.is_relative_to(own) and not is_hidden(there, own)

    @functools.cache
    def links(folder: Path) -> list[Path]:
        return [p for p in folder.iterdir() if p.is_symlink()] if may_list(folder) else []

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
                there += _matches(target, named.folder, may_list, links)
            if not there and not named.blenders:
                for target in _last_resorts(file.parent, named):
                    there += _matches(target, False, may_list, links)
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


def _matches(
    target: Path,
    folder: bool,
    may_list: Callable[[Path], bool],
    links: Callable[[Path], list[Path]],
) -> list[Path]:
    """The existing files of a name: the file (or folder), tiles and frames of a pattern, and
    symbolic links with similar names next to it.

    A folder that is not the scene's is not listed: it is asked for tiles and frames by name.
    """
    beside = target.parent
    with suppress(OSError, ValueError):
        if NUMBER.search(target.name):
            if may_list(beside):
                return sorted(beside.glob(NUMBER.sub("*", glob.escape(target.name))))
            named = (beside / numbered(target.name, number) for number in range(_NUMBERS))
            return [one for one in named if one.exists()] if beside.is_dir() else []
        if target.exists() and (folder or not target.is_dir()):
            start = re.split(r"\d", target.name)[0]
            near = [p for p in links(beside) if p.suffix == target.suffix]
            return [target, *(p for p in near if p.name.startswith(start))]
    return []


def numbered(pattern: str, number: int) -> str:
    """The name of a tile, by its number (UDIM) or by its column and row from 1, or of a frame."""
    column, row = (number - 1001) % 10 + 1, (number - 1001) // 10 + 1
    words = {"<UDIM>": str(number), "<UVTILE>": f"u{column}_v{row}"}
    return NUMBER.sub(lambda found: words.get(found[0]) or f"{number:0{len(found[0])}}", pattern)


def resolved(target: Path) -> Path:
    """The file that a link leads to; / for none."""
    try:
        return target.resolve()
    except (OSError, RuntimeError, ValueError):
        return Path("/")
