"""Finds references to other files in a scene file of any format that Blender opens, without opening
these files.
"""

import functools
import html
import json
import mmap
import os
import re
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from . import blend_names

#: Blender takes every byte up to the space for white space. A backslash at the end of a line
#: continues it on the next line.
_REST = rb"(?:[\0-\x09\x0b-\x20]|\\\r?\n)((?:\\\r?\n|[^\n])+)"
_BLANK = bytes(range(33))
_MTLLIB = re.compile(rb"mtllib" + _REST)
_MAP = re.compile(rb"(?:map_\w+|bump|disp|decal|refl|norm)" + _REST, re.IGNORECASE)
#: A string of a binary FBX: its length in four bytes, of which the last two are 0.
_FBX_STRING = re.compile(rb"S(?=[^\0][\0-\x10]\0\0)")
#: Keys of an FBX before the path of its own or its original file, which no importer reads.
_FBX_ORIGIN = re.compile(r"\w*DocumentUrl$|(Original|LastSaved)\|")
_LAYERS = (".usd", ".usda", ".usdc", ".usdz", ".sdf", ".mtlx")


@dataclass(frozen=True)
class FileReference:
    """A reference. place: its position in the file. report_missing: report it if the file is
    missing.

    kind: the format that the file will be read as, whatever its ending. folder: all files of this
    folder may be read. blenders: the path has Blender's syntax. computed: it is an address, or a
    path that is not known in advance.
    """

    place: str
    name: str
    report_missing: bool = False
    folder: bool = False
    blenders: bool = False
    computed: bool = False
    kind: str = ""


def named_in(file: Path, kind: str = "") -> Iterator[FileReference]:
    """The references in a file, read as a file of that kind (`.mtl`), or else by its ending and its
    first bytes. If the file cannot be read, there are none, because Blender's importer will report
    the error; for a .blend, raises InputError. Layers of USD are listed once Blender is loaded;
    before, they may be anywhere in the folder.

    The result is cached until the file changes: scenes are checked before they are opened, and
    hashed afterwards.
    """
    ending = file.suffix.lower()
    with suppress(OSError):
        state = file.stat()
        changes = (state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
        yield from _kept(file, kind, changes, "bpy" in sys.modules)
        if ending == ".obj" and file.with_suffix(".mtl").exists():
            yield FileReference("its materials", f"{file.stem}.mtl")


@functools.lru_cache(maxsize=1024)
def _kept(
    file: Path, kind: str, changes: tuple[int, ...], has_blender: bool
) -> tuple[FileReference, ...]:
    return tuple(_looked_through(file, kind))


def _looked_through(file: Path, kind: str) -> Iterator[FileReference]:
    with open(file, "rb") as content:
        head = content.read(18)
    if not head:
        return
    finders = {finder for start, finder in _MAGIC.items() if head.startswith(start)}
    by_ending = _FINDERS.get(kind or file.suffix.lower())
    if by_ending is not None:
        finders.add(by_ending)
    for finder in finders:
        yield from finder(file)


def _in_blend(file: Path) -> Iterator[FileReference]:
    for place, kind, name in blend_names.names(file):
        if kind == "computed":
            yield FileReference(place, name, computed=True)
        elif name not in ("", "<builtin>"):
            yield FileReference(place, name, kind == "required", kind == "folder", blenders=True)
    yield FileReference("disk cache", f"//blendcache_{file.stem}", folder=True, blenders=True)


def _in_obj(file: Path) -> Iterator[FileReference]:
    for line, name in _lines(file, _MTLLIB):
        yield FileReference(line, name.strip('"'), report_missing=True, kind=".mtl")


def _in_mtl(file: Path) -> Iterator[FileReference]:
    for line, arguments in _lines(file, _MAP):
        # `-bm 0.5 my wood.png`: only Blender's parser decides where the options end, so the name
        # may begin at any word
        yield FileReference(line, arguments)
        if arguments.startswith("-"):
            for word in re.finditer(r"[^\0- ]+", arguments):
                yield FileReference(line, arguments[word.start() :])


@contextmanager
def _mapped(file: Path) -> Iterator[mmap.mmap]:
    with (
        open(file, "rb") as content,
        mmap.mmap(content.fileno(), 0, access=mmap.ACCESS_READ) as whole,
    ):
        yield whole


def _lines(file: Path, pattern: re.Pattern[bytes]) -> Iterator[tuple[str, str]]:
    """(place, argument) of the lines that match."""
    at = 0
    line = 1
    with _mapped(file) as content:
        for found in pattern.finditer(content):
            start = content.rfind(b"\n", 0, found.start()) + 1
            if not content[start : found.start()].strip(_BLANK):
                line += content[at:start].count(b"\n")
                at = start
                joined = re.sub(rb"\\\r?\n", b" ", found[1])
                yield f"line {line}", _text(joined.strip(_BLANK))


def _text(data: bytes) -> str:
    return data.decode("utf-8", "surrogateescape")


def gltf_content(file: Path) -> Any:
    """The JSON of a glTF or GLB file. Raises ValueError if it has none."""
    data = file.read_bytes()
    if data.startswith(b"glTF"):
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    return json.loads(data)


def _in_gltf(file: Path) -> Iterator[FileReference]:
    entries = []
    try:
        content = gltf_content(file)
        for key in ("buffers", "images"):
            for k, entry in enumerate(content.get(key) or []):
                if isinstance(entry, dict):
                    entries.append((f"{key}[{k}].uri", entry.get("uri")))
    except (OSError, ValueError, AttributeError, TypeError, RecursionError):
        return
    for place, uri in entries:
        # importers treat as paths what is not data in base64
        if isinstance(uri, str) and not (uri.startswith("data:") and ";base64," in uri):
            yield FileReference(place, uri, report_missing=place.startswith("buffers"))


def _in_fbx(file: Path) -> Iterator[FileReference]:
    """All texts of the file, because it depends on the program that wrote it which of them are
    paths.
    """
    with _mapped(file) as content:
        if content[:18] == b"Kaydara FBX Binary":
            strings = [_fbx_string(content, found.end()) for found in _FBX_STRING.finditer(content)]
        else:
            strings = re.findall(rb'"([^"\r\n]{1,4096})"', content)
    texts = [html.unescape(_text(string)) for string in strings]
    origins: set[int] = set()
    for k, text in enumerate(texts):
        if _FBX_ORIGIN.match(text):
            origins.update(range(k + 1, k + 5))
    for name in dict.fromkeys(text for k, text in enumerate(texts) if k not in origins):
        yield FileReference("a text", name)


def _fbx_string(content: mmap.mmap, at: int) -> bytes:
    length = struct.unpack_from("<I", content, at)[0]
    return content[at + 4 : at + 4 + length]


def _in_usd(file: Path) -> Iterator[FileReference]:
    """References of the layer, and of the layers that are packed into it."""
    if "bpy" not in sys.modules:  # its library of USD is that of Blender
        yield FileReference("its layers", ".", folder=True)
        return
    pxr = _usd_library()
    if pxr is None:
        raise InputError("a Blender that reads USD", path=file, found="one without its library")
    own = os.path.realpath(file)
    todo = [own]
    seen = set()
    while todo:
        layer = todo.pop()
        if layer in seen:
            continue
        seen.add(layer)
        try:
            kinds = pxr.UsdUtils.ExtractExternalReferences(layer)
            opened = pxr.Sdf.Layer.FindOrOpen(layer)
        except RuntimeError:
            continue
        for place, names in zip(("sublayer", "reference or asset", "payload"), kinds, strict=True):
            for name in names:
                whole = opened.ComputeAbsolutePath(name) if opened else name
                if not (pxr.Ar.IsPackageRelativePath(whole) and whole.startswith(f"{own}[")):
                    yield _usd_reference(place, name)
                elif Path(whole.rstrip("]")).suffix in _LAYERS:
                    todo.append(whole)


def _usd_library() -> Any:
    """Blender's USD library for Python, or None.

    In the package bpy it must first be added to the import path.
    """
    getattr(sys.modules["bpy"].utils, "expose_bundled_modules", list)()
    try:
        import pxr.Ar
        import pxr.Sdf
        import pxr.UsdUtils
    except ImportError:
        return None
    return pxr


def _in_materialx(file: Path) -> Iterator[FileReference]:
    """All texts of the file: USD's library would open what they name."""
    for found in re.findall(rb"[\"']([^\"']{1,4096})[\"']", file.read_bytes()):
        yield FileReference("a text", html.unescape(_text(found)))


def _usd_reference(place: str, name: str) -> FileReference:
    plain = name.partition("[")[0].partition(":SDF_FORMAT_ARGS:")[0]
    is_layer = Path(plain).suffix in _LAYERS
    return FileReference(place, plain, report_missing=is_layer, computed=name.startswith("`"))


def _in_playlist(file: Path) -> Iterator[FileReference]:
    """A video playlist that refers to other videos."""
    for line in file.read_text("utf-8", "surrogateescape").splitlines():
        quoted = re.findall("[\"']([^\"']+)[\"']", line)
        for name in (line.strip(), *quoted, line.rpartition(" ")[2]):
            yield FileReference("playlist", name)


_Finder = Callable[[Path], Iterator[FileReference]]
_MAGIC: dict[bytes, _Finder] = {
    **dict.fromkeys((b"BLENDER", b"\x1f\x8b", b"\x28\xb5\x2f\xfd"), _in_blend),
    b"glTF": _in_gltf,
    b"Kaydara FBX Binary": _in_fbx,
    **dict.fromkeys((b"PXR-USDC", b"#usda"), _in_usd),
    **dict.fromkeys((b"#EXTM3U", b"ffconcat"), _in_playlist),
}
_FINDERS: dict[str, _Finder] = {
    ".blend": _in_blend,
    ".obj": _in_obj,
    ".mtl": _in_mtl,
    **dict.fromkeys((".gltf", ".glb"), _in_gltf),
    ".fbx": _in_fbx,
    **dict.fromkeys(_LAYERS, _in_usd),
    ".mtlx": _in_materialx,
}
