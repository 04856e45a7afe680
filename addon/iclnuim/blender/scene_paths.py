"""Which other files a scene names: none outside its folder is read, and all of them count in the scene's hash."""

import hashlib
import json
import mmap
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

import bpy

from ..errors import InputError

_MTLLIB = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_MAPS = re.compile(r"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+(.+?)[ \t]*$", re.MULTILINE | re.IGNORECASE)


def refuse_outside(path: Path, textures: str | None) -> None:
    """Before the file is opened, for formats whose text says what they will read. Raises InputError for a way out of the folder."""
    for name in _named(path):
        _check(path, path.parent / name, name, textures)


def refuse_open_outside(path: Path, textures: str | None) -> None:
    """Once it is open: textures, libraries, volumes, caches and fonts of the session. Raises InputError."""
    for block, file in _referenced():
        if file.exists() or _is_pattern(block):
            _check(path, file.parent if _is_pattern(block) else file, block.filepath, textures)


def sha256(path: Path) -> str:
    """Of the file and of every file that the open scene takes from beside it."""
    beside = {path.parent / name for name in _named(path)} | {file for _, file in _referenced()}
    digest = hashlib.sha256(_content_hash(path))
    for file in sorted({p for b in beside for p in _expanded(b)}):
        digest.update(file.name.encode("utf-8", "surrogateescape") + b"\0" + _content_hash(file))
    return digest.hexdigest()


def _check(path: Path, target: Path, name: str, textures: str | None) -> None:
    allowed = [path.resolve().parent, *([Path(textures).expanduser().resolve()] if textures else [])]
    try:
        target = target.resolve()
    except (OSError, RuntimeError, ValueError):
        target = Path("/")
    if not any(target.is_relative_to(folder) for folder in allowed):
        hint = "moving them there, packing them into the file, or {textures} DIR if DIR may be read"
        raise InputError("textures and other parts from the scene's own folder", path=path, found=name, hint=hint)


def _named(path: Path) -> list[str]:
    """Files that an OBJ with its materials, or a glTF, names in plain text."""
    if path.suffix.lower() == ".obj":
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            found = [m.group(1).decode("utf-8", "surrogateescape") for m in _MTLLIB.finditer(content)]
        libraries = list(dict.fromkeys(name.strip().strip('"') for name in found))
        return [*libraries, *(name for library in libraries for name in _maps_of(path.parent / library))]
    return _uris_of(path) if path.suffix.lower() in (".gltf", ".glb") else []


def _maps_of(library: Path) -> list[str]:
    try:
        text = library.read_bytes()[: 1 << 26].decode("utf-8", "replace")
    except (OSError, ValueError):
        return []
    return [_without_options(m.group(1)) for m in _MAPS.finditer(text)]


def _without_options(arguments: str) -> str:
    """`-bm 0.5 -o 1 1 1 my wood.png` -> `my wood.png`."""
    words = arguments.split(" ")
    while len(words) > 1 and words[0].startswith("-"):
        words.pop(0)
        while len(words) > 1 and re.fullmatch(r"-?[\d.eE+-]+|on|off", words[0]):
            words.pop(0)
    return " ".join(words).strip().strip('"').replace("\\", "/")


def _uris_of(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
        if path.suffix.lower() == ".glb":
            data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
        content = json.loads(data)
        entries = [e for key in ("buffers", "images") for e in content.get(key) or []]
        names = [e["uri"] for e in entries if isinstance(e, dict) and isinstance(e.get("uri"), str)]
    except (OSError, ValueError, AttributeError, TypeError, RecursionError):
        return []  # the reader will say what is wrong with it
    return [unquote(name) for name in names if not name.startswith("data:")]


def _referenced() -> Iterator[tuple[bpy.types.ID, Path]]:
    """(block, absolute path) of every outside file of the open session but scripts, which are never read."""
    data = bpy.data
    for blocks in (data.images, data.libraries, data.cache_files, data.volumes, data.fonts, data.movieclips):
        for block in blocks:
            if block.filepath and block.filepath != "<builtin>" and getattr(block, "packed_file", None) is None:
                yield block, Path(bpy.path.abspath(block.filepath, library=block.library))


def _is_pattern(block: bpy.types.ID) -> bool:
    """One name for many files: UDIM tiles or the pictures of a sequence."""
    return getattr(block, "source", "") in ("TILED", "SEQUENCE")


def _expanded(file: Path) -> list[Path]:
    """The file, or those that its pattern stands for; none where nothing is there."""
    if "<UDIM>" in file.name:
        return sorted(file.parent.glob(file.name.replace("<UDIM>", "[0-9]" * 4)))
    with suppress(OSError, ValueError):
        if file.is_file():
            return [file]
    return []


def _content_hash(file: Path) -> bytes:
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").digest()
