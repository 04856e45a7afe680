"""Finds references to other files in a .blend before Blender opens it, because Blender reads
libraries while it opens a file.
"""

import re
from collections.abc import Container, Iterator
from pathlib import Path
from typing import NamedTuple

from ..errors import InputError
from .blend_file import BlendFile, text

#: Structs and fields with paths that Blender does not read: former locations of the file, output
#: paths, the sequencer, the window's layout.
_NOT_READ = {
    "FileGlobal", "LibraryWeakReference", "ImagePackedFile", "RenderData", "BakeData",
    "DynamicPaintSurface", "NodeImageMultiFile",
    "NodeImageMultiFileSocket", "Strip", "StripElem", "StripProxy", "Editing", "FileSelectParams",
    "Text", "UserDef", "Script",
    "CacheFile.handle_filepath", "Library.filepath", "Library.filepath_abs",
}  # fmt: skip
#: Structs whose missing file is reported; missing images are reported elsewhere.
_REQUIRED = {
    "Library", "CacheFile", "CacheFileLayer", "Volume", "MeshCacheModifierData", "VFont",
    "NodeShaderTexIES",
}  # fmt: skip
_FOLDER = re.compile(r"\.(path|cachepath|\w*dir|\w*directory)$")
_PATH = re.compile(
    r"\.(?!\w*object_path)\w*(path|dir|directory|file|filename)$"
    r"|^(Image|Library|VFont|bSound|MovieClip|NodeImageFile)\.name$"
    r"|^bNodeSocketValueString\.value$",
    re.IGNORECASE,
)
_POINTED = re.compile(r"\.\*\w*(directory|filepath)$")
#: Structs whose files FFmpeg may read, and names that it takes for an address: a protocol, which has
#: more letters than a drive, and what it reads. `file:` is a path.
_FILMS = {"Image", "MovieClip", "bSound"}
_ADDRESS = re.compile(r"(?!file:)[a-z0-9+.-]{2,}:|subfile,.*:", re.IGNORECASE | re.DOTALL)
#: Fields of a struct that show that its file is packed into the .blend.
_PACKED = {
    "PackedFile": ("*data",), "ImagePackedFile": ("*packedfile",), "Image": ("*packedfile",
    "packedfiles"),
    **dict.fromkeys(("Library", "VFont", "bSound", "Volume"), ("*packedfile",)),
}  # fmt: skip
#: Pointer from a library of packed datablocks to the library that they were linked from.
_ARCHIVE = "*archive_parent_library"
#: Prefix of the nodes that read files.
_IMPORT = b"GeometryNodeImport"
#: No struct of Blender contains as many paths; a damaged file may nest arrays of arrays.
_MAX_PATHS = 10_000


class _PathField(NamedTuple):
    """A path in a struct: its label `struct.field`, its offset, and its length; 0 for a pointer to
    it.
    """

    label: str
    offset: int
    length: int


def names(file: Path) -> Iterator[tuple[str, str, str]]:
    """(place, what, name); what is "file", "required" (reported if it is missing), "folder", or
    "computed" if it is an address, or a path that is not known in advance.

    Raises InputError for a file that is not a valid .blend.
    """
    try:
        yield from _PathSearch(BlendFile(file)).names()
    except InputError:
        raise
    except Exception as error:  # a damaged file may cause any error, also in the two decompressors
        damage = f"damaged blocks: {error}"
        raise InputError("a scene that Blender can read", path=file, found=damage) from None


class _PathSearch:
    def __init__(self, blend: BlendFile) -> None:
        self.blend = blend
        self.fields = blend.fields
        self.paths: dict[str, list[_PathField]] = {}
        self.at_address = {block.address: block for block in blend.blocks if block.address}

    def names(self) -> Iterator[tuple[str, str, str]]:
        structs = self.blend.structs
        present = {block.struct for block in self.blend.blocks}
        kinds = {structs[number][0] for number in present if number < len(structs)}
        with_paths = {kind for kind in kinds if self._paths(kind)}
        packed = self._packed_addresses()
        pointed: dict[int, str] = {}
        archived = self._archived_libraries()
        for block, kind, data in self.blend.each(with_paths):
            if block.address in archived:
                continue
            if self._points(kind, data, packed):
                if kind == "Library":
                    yield self._place(kind, data), "computed", "a library that is packed"
                continue
            for path in self._paths(kind):
                if not path.length:
                    pointed[self.blend.pointer(data, path.offset)] = kind
                elif data[path.offset]:
                    name = text(data[path.offset : path.offset + path.length])
                    yield self._place(kind, data), _what(kind, path.label, name), name
        blocks = [self.at_address[a] for a in pointed if a in self.at_address]
        for block, data in self.blend.contents(blocks):
            yield self._place(pointed[block.address], b""), "folder", text(data)
        if self._computes_an_import():
            yield "Geometry Nodes", "computed", "an Import node whose path other nodes make"

    def _packed_addresses(self) -> set[int]:
        """The addresses of packed files."""
        packed = {block.address for block, _, _ in self.blend.each({"ImagePackedFile"})}
        for block, kind, data in self.blend.each({"PackedFile"}):
            if self._points(kind, data, self.at_address):
                packed.add(block.address)
        return packed

    def _archived_libraries(self) -> set[int]:
        """The addresses of libraries of which all that is used is packed into the file, as Blender 5
        does with the assets of its own library: they are not read. What is linked from a library
        follows it as blocks `ID`.
        """
        if _ARCHIVE not in self.fields.get("Library", {}):
            return set()
        archived = set()
        for block, kind, data in self.blend.each({"Library"}):
            if parent := self.blend.pointer(data, self.fields[kind][_ARCHIVE].offset):
                archived |= {block.address, parent}
        library = 0
        for block in self.blend.blocks:
            if block.code == b"LI":
                library = block.address
            elif block.code == b"ID":
                archived.discard(library)
        return archived

    def _computes_an_import(self) -> bool:
        """Whether an Import node has an input that is linked to another node."""
        nodes: set[int] = set()
        linked: set[int] = set()
        for block, kind, data in self.blend.each({"bNode", "bNodeLink"}):
            if kind == "bNodeLink":
                linked.add(self.blend.pointer(data, self.fields[kind]["*tonode"].offset))
            elif data[self.fields[kind]["idname"].offset :].startswith(_IMPORT):
                nodes.add(block.address)
        return bool(nodes & linked)

    def _paths(self, kind: str, within: tuple[str, ...] = ()) -> list[_PathField]:
        """The paths in a struct and in the structs it contains; results are cached."""
        if kind in self.paths:
            return self.paths[kind]
        if kind in within:
            raise ValueError("a struct that contains itself")
        found: list[_PathField] = []
        for name, field in self.fields.get(kind, {}).items():
            label = f"{kind}.{name}"
            if kind in _NOT_READ or label in _NOT_READ or name.startswith("("):
                continue
            if name.startswith("*"):
                if field.kind == "char" and _POINTED.search(label):
                    found.append(_PathField(label, field.offset, 0))
            elif field.length > 1 and field.kind not in self.fields and _PATH.search(label):
                if field.kind != "char":  # no Blender writes it, and all convert it to text
                    raise ValueError(f"{label} of {field.kind}")
                found.append(_PathField(label, field.offset, field.length))
            elif inner := self._paths(field.kind, (*within, kind)):
                if len(found) + field.length * len(inner) > _MAX_PATHS:
                    raise ValueError("structs that contain too many paths")
                for k in range(field.length):
                    start = field.offset + k * field.size
                    found += [path._replace(offset=start + path.offset) for path in inner]
        self.paths[kind] = found
        return found

    def _points(self, kind: str, data: bytes, to: Container[int]) -> bool:
        """Whether the struct's file is packed: whether it has a pointer to a block of `to`."""
        present = self.fields[kind].keys() & set(_PACKED.get(kind, ()))
        return any(self.blend.pointer(data, self.fields[kind][n].offset) in to for n in present)

    def _place(self, kind: str, data: bytes) -> str:
        """A description such as `Image floor`; a struct that is not a datablock has no name: `Mesh
        Cache Modifier Data`.
        """
        words = re.sub("(?<=[a-z])(?=[A-Z])", " ", kind.removeprefix("b"))
        block = self.fields[kind].get("id")
        if block is None or block.kind != "ID":
            return words
        name = self.fields["ID"]["name"]
        at = block.offset + name.offset
        return f"{words} {text(data[at + 2 : at + name.length])}"


def _what(kind: str, label: str, name: str) -> str:
    if kind in _FILMS and _ADDRESS.match(name):
        return "computed"
    if _FOLDER.search(label):
        return "folder"
    return "required" if kind in _REQUIRED else "file"
