"""Finds references to other files in a .blend by parsing its blocks before Blender opens it,
because Blender reads libraries while it opens a file.

A .blend consists of a header and blocks. The block DNA1 describes the C structs in all other
blocks. Source: Blender's doc/blender_file_format. Fields have their DNA names, which files keep
even if the source code has renamed them.
"""

import gzip
import re
import struct
from collections import namedtuple
from collections.abc import Container, Iterator
from math import prod
from pathlib import Path
from typing import Any

from ...errors import InputError

#: Structs and fields with paths that Blender does not read: former locations of the file, output
#: paths, the sequencer, the window's layout.
_NOT_READ = {
    "FileGlobal", "LibraryWeakReference", "ImagePackedFile", "RenderData", "BakeData", "DynamicPaintSurface", "NodeImageMultiFile",
    "NodeImageMultiFileSocket", "Strip", "StripElem", "StripProxy", "Editing", "FileSelectParams", "Text", "UserDef", "Script",
    "CacheFile.handle_filepath", "Library.filepath", "Library.filepath_abs",
}  # fmt: skip
#: Structs whose missing file is reported; missing images are reported elsewhere.
_REQUIRED = {
    "Library",
    "CacheFile",
    "CacheFileLayer",
    "Volume",
    "MeshCacheModifierData",
    "VFont",
    "NodeShaderTexIES",
}
_FOLDER = re.compile(r"\.(path|cachepath|\w*dir|\w*directory)$")
_PATH = re.compile(
    r"\.(?!\w*object_path)\w*(path|dir|directory|file|filename)$"
    r"|^(Image|Library|VFont|bSound|MovieClip|NodeImageFile)\.name$|^bNodeSocketValueString\.value$",
    re.IGNORECASE,
)
_POINTED = re.compile(r"\.\*\w*(directory|filepath)$")
#: Fields of a struct that show that its file is packed into the .blend.
_PACKED = {
    "PackedFile": ("*data",), "ImagePackedFile": ("*packedfile",), "Image": ("*packedfile", "packedfiles"),
    **dict.fromkeys(("Library", "VFont", "bSound", "Volume"), ("*packedfile",)),
}  # fmt: skip
#: Prefix of the nodes that read files.
_IMPORT = b"GeometryNodeImport"


_Block = namedtuple("_Block", "struct address offset length")
_Field = namedtuple("_Field", "offset kind length size")


class _Blend:
    """The blocks of a file. Their offsets are stored; their contents are read when needed."""

    def __init__(self, file: Path) -> None:
        self.file, self.order, self.address = file, "<", "Q"
        self.blocks: list[_Block] = []
        self.paths: dict[str, list[tuple[str, int, int]]] = {}
        self.structs, self.fields = self._index()
        self.at_address = {block.address: block for block in self.blocks if block.address}

    def names(self) -> Iterator[tuple[str, str, str]]:
        """See the function `names`."""
        here = {
            self.structs[number][0]
            for number in {block.struct for block in self.blocks}
            if number < len(self.structs)
        }
        paths = {kind: self._paths(kind) for kind in here}
        packed = {block.address for block, _, _ in self._each({"ImagePackedFile"})}
        packed |= {
            b.address
            for b, kind, data in self._each({"PackedFile"})
            if self._points(kind, data, self.at_address)
        }
        nodes, linked, pointed = set(), set(), {}
        for block, kind, data in self._each(
            {kind for kind in paths if paths[kind]} | {"bNode", "bNodeLink"}
        ):
            if kind == "bNode" and data[self.fields[kind]["idname"].offset :].startswith(_IMPORT):
                nodes.add(block.address)
            if kind == "bNodeLink":
                linked.add(self._pointer(data, self.fields[kind]["*tonode"].offset))
            if self._points(kind, data, packed):
                if kind == "Library":
                    yield self._place(kind, data), "computed", "a library that is packed"
                continue
            for label, offset, size in paths[kind]:
                what = (
                    "folder"
                    if _FOLDER.search(label)
                    else "required"
                    if kind in _REQUIRED
                    else "file"
                )
                if "*" in label:
                    pointed[self._pointer(data, offset)] = kind
                elif data[offset]:
                    yield self._place(kind, data), what, _text(data[offset : offset + size])
        for block, data in self._contents(
            [self.at_address[a] for a in pointed if a in self.at_address]
        ):
            yield self._place(pointed[block.address], b""), "folder", _text(data)
        if nodes & linked:
            yield "Geometry Nodes", "computed", "an Import node whose path other nodes make"

    def _index(self) -> tuple[list[tuple[str, int]], dict[str, dict[str, _Field]]]:
        dna = b""
        with _opened(self.file) as content:
            head = content.read(12)
            if head[:7] != b"BLENDER":
                raise ValueError("no header")
            large = head[7:8].isdigit()  # from Blender 5.0 on
            self.order = ">" if head[8:9] == b"V" and not large else "<"
            self.address = "I" if head[7:8] == b"_" else "Q"
            block = struct.Struct(self.order + ("4siQqq" if large else f"4si{self.address}ii"))
            at = 17 if large else 12
            while True:
                content.seek(at)
                if len(data := content.read(block.size)) < block.size or data[:4] == b"ENDB":
                    break
                code, first, address, third, _ = block.unpack(data)
                kind, length = (first, third) if large else (third, first)
                if length < 0:
                    raise ValueError("a block of negative length")
                if code == b"DNA1":
                    dna = dna or content.read(length)
                self.blocks.append(_Block(kind, address, at + block.size, length))
                at += block.size + length
        return self._layout(dna)

    def _layout(self, dna: bytes) -> tuple[list[tuple[str, int]], dict[str, dict[str, _Field]]]:
        """(kind, size) of the structs by number, and a mapping kind -> name (with its stars) ->
        field.
        """
        texts, at = [], 0
        for tag in (b"NAME", b"TYPE"):
            at = dna.index(tag, at) + 8
            texts.append(
                dna[at:].split(
                    b"\0", count := struct.unpack_from(self.order + "i", dna, at - 4)[0]
                )[:count]
            )
            at += sum(len(text) + 1 for text in texts[-1])
        members, kinds = ([text.decode() for text in part] for part in texts)
        at = dna.index(b"TLEN", at) + 4
        sizes = struct.unpack_from(f"{self.order}{len(kinds)}H", dna, at)
        at = dna.index(b"STRC", at + 2 * len(kinds)) + 8
        structs: list[tuple[str, int]] = []
        fields: dict[str, dict[str, _Field]] = {}
        for _ in range(struct.unpack_from(self.order + "i", dna, at - 4)[0]):
            kind, count = struct.unpack_from(self.order + "HH", dna, at)
            numbers = struct.unpack_from(f"{self.order}{2 * count}H", dna, at + 4)
            at, offset = at + 4 + 4 * count, 0
            structs.append((kinds[kind], sizes[kind]))
            inside = fields[kinds[kind]] = {}
            for of, name in zip(numbers[::2], numbers[1::2], strict=True):
                member, *dimensions = re.findall(r"[^\[\]]+", members[name])
                size = struct.calcsize(f"={self.address}") if member[0] in "*(" else sizes[of]
                inside[member] = _Field(offset, kinds[of], prod(map(int, dimensions)), size)
                offset += inside[member].length * size
        return structs, fields

    def _paths(self, kind: str, within: tuple[str, ...] = ()) -> list[tuple[str, int, int]]:
        """(struct.field, offset, length) of the paths in a struct and in the structs it contains;
        results are cached.
        """
        if kind in self.paths:
            return self.paths[kind]
        if kind in within:
            raise ValueError("a struct that contains itself")
        found: list[tuple[str, int, int]] = []
        for name, field in self.fields.get(kind, {}).items():
            label, here = f"{kind}.{name}", field.offset
            if kind in _NOT_READ or label in _NOT_READ or name.startswith("("):
                continue
            if name.startswith("*"):
                found += (
                    [(label, here, 0)] if field.kind == "char" and _POINTED.search(label) else []
                )
            elif field.kind == "char":
                found += (
                    [(label, here, field.length)]
                    if field.length > 1 and _PATH.search(label)
                    else []
                )
            elif inner := self._paths(field.kind, (*within, kind)):
                if len(found) + field.length * len(inner) > 10_000:
                    raise ValueError("structs that contain too many paths")
                found += [
                    (text, here + k * field.size + o, n)
                    for k in range(field.length)
                    for text, o, n in inner
                ]
        self.paths[kind] = found
        return found

    def _each(self, kinds: set[str]) -> Iterator[tuple[_Block, str, bytes]]:
        """Every struct of these kinds."""
        numbers = {
            number for number, (kind, size) in enumerate(self.structs) if kind in kinds and size
        }
        for block, data in self._contents(
            [block for block in self.blocks if block.struct in numbers]
        ):
            kind, size = self.structs[block.struct]
            for at in range(0, len(data) - size + 1, size):
                yield block, kind, data[at : at + size]

    def _contents(self, blocks: list[_Block]) -> Iterator[tuple[_Block, bytes]]:
        if not blocks:
            return
        with _opened(self.file) as content:
            for block in sorted(set(blocks), key=lambda block: block.offset):
                content.seek(block.offset)
                yield block, content.read(block.length)

    def _pointer(self, data: bytes, offset: int) -> int:
        return struct.unpack_from(self.order + self.address, data, offset)[0]

    def _points(self, kind: str, data: bytes, to: Container[int]) -> bool:
        """Whether the struct's file is packed: whether it has a pointer to a block of `to`."""
        found = [
            self.fields[kind][name] for name in _PACKED.get(kind, ()) if name in self.fields[kind]
        ]
        return any(self._pointer(data, field.offset) in to for field in found)

    def _place(self, kind: str, data: bytes) -> str:
        """A description such as `Image floor`; a struct that is not a datablock has no name: `Mesh
        Cache Modifier Data`.
        """
        words = re.sub("(?<=[a-z])(?=[A-Z])", " ", kind.removeprefix("b"))
        if (block := self.fields[kind].get("id")) is None or block.kind != "ID":
            return words
        name = self.fields["ID"]["name"]
        at = block.offset + name.offset
        return f"{words} {_text(data[at + 2 : at + name.length])}"


def names(file: Path) -> Iterator[tuple[str, str, str]]:
    """(place, what, name); what is "file", "required" (reported if it is missing), "folder", or
    "computed" if the path is not known in advance.

    Raises InputError for a file that is not a valid .blend.
    """
    try:
        yield from _Blend(file).names()
    except InputError:
        raise
    except Exception as error:  # a damaged file may cause any error, also in the two decompressors
        raise InputError(
            "a scene that Blender can read", path=file, found=f"damaged blocks: {error}"
        ) from None


def _opened(file: Path) -> Any:
    """The uncompressed content, which can only be read forwards."""
    content = open(file, "rb")  # noqa: SIM115 (the caller closes it)
    magic = content.read(4)
    content.seek(0)
    if magic[:2] == b"\x1f\x8b":
        return gzip.open(content)
    if magic[:4] != b"\x28\xb5\x2f\xfd":
        return content
    try:
        import zstandard  # a dependency of bpy, and part of Blender
    except ImportError:
        raise InputError(
            "zstandard in this Python", path=file, hint="saving the file without compression"
        ) from None
    return zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("utf-8", "surrogateescape")
