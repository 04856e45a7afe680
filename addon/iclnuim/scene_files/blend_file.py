"""The blocks of a .blend, read before Blender opens it.

A .blend consists of a header and blocks. The block DNA1 describes the C structs in all other
blocks. Source: Blender's doc/blender_file_format. Fields have their DNA names, which files keep
even if the source code has renamed them.
"""

import gzip
import re
import struct
from collections.abc import Iterable, Iterator
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import InputError


class Block(NamedTuple):
    """The number of its struct, its address in the memory of the writer, its content's place in
    the file, and its code: of a datablock its type, `LI` of a library, `ID` of what is linked.
    """

    struct: int
    address: int
    offset: int
    length: int
    code: bytes


class Field(NamedTuple):
    """A field of a struct: its offset, its type, and its number of values of `size` bytes."""

    offset: int
    kind: str
    length: int
    size: int


class BlendFile:
    """The blocks and structs of a file. The blocks' contents are read when they are needed.

    version: of the Blender that wrote it, (4, 5). structs: (type, size) by number; fields: type ->
    name (with its stars) -> field. Raises an error
    of any type for a damaged file.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.blocks: list[Block] = []
        dna = b""
        with _opened(file) as content:
            head = content.read(12)
            if head[:7] != b"BLENDER":
                raise ValueError("no header")
            large = head[7:8].isdigit()  # from Blender 5.0 on
            number = int(head[9:12])
            if large:
                head += content.read(5)
                number = int(head[13:17])
            self.version = (number // 100, number % 100)
            self.order = ">" if head[8:9] == b"V" and not large else "<"
            self.address = "I" if head[7:8] == b"_" else "Q"
            layout = struct.Struct(self.order + ("4siQqq" if large else f"4si{self.address}ii"))
            at = 17 if large else 12
            while True:
                content.seek(at)
                data = content.read(layout.size)
                if len(data) < layout.size or data[:4] == b"ENDB":
                    break
                code, second, address, fourth, _ = layout.unpack(data)
                number, length = (second, fourth) if large else (fourth, second)
                if length < 0:
                    raise ValueError("a block of negative length")
                if code == b"DNA1":
                    dna = dna or content.read(length)
                code = data[:4].rstrip(b"\0")
                self.blocks.append(Block(number, address, at + layout.size, length, code))
                at += layout.size + length
        self.structs: list[tuple[str, int]] = []
        self.fields: dict[str, dict[str, Field]] = {}
        self._read_structs(dna)

    def _read_structs(self, dna: bytes) -> None:
        names, at = self._texts(dna, b"NAME", 0)
        kinds, at = self._texts(dna, b"TYPE", at)
        at = dna.index(b"TLEN", at) + 4
        sizes = struct.unpack_from(f"{self.order}{len(kinds)}H", dna, at)
        at = dna.index(b"STRC", at + 2 * len(kinds)) + 8
        pointer_size = struct.calcsize(f"={self.address}")
        for _ in range(self._whole_number(dna, at - 4)):
            number, count = struct.unpack_from(self.order + "HH", dna, at)
            members = struct.unpack_from(f"{self.order}{2 * count}H", dna, at + 4)
            at += 4 + 4 * count
            self.structs.append((kinds[number], sizes[number]))
            fields = self.fields[kinds[number]] = {}
            offset = 0
            for kind, name in zip(members[::2], members[1::2], strict=True):
                member, *dimensions = re.findall(r"[^\[\]]+", names[name])
                length = prod(map(int, dimensions))
                size = pointer_size if member[0] in "*(" else sizes[kind]
                fields[member] = Field(offset, kinds[kind], length, size)
                offset += length * size

    def _texts(self, dna: bytes, tag: bytes, at: int) -> tuple[list[str], int]:
        """The texts of a section of the DNA, and the position after them."""
        at = dna.index(tag, at) + 8
        count = self._whole_number(dna, at - 4)
        texts = dna[at:].split(b"\0", count)[:count]
        return [text.decode() for text in texts], at + sum(len(text) + 1 for text in texts)

    def _whole_number(self, data: bytes, offset: int) -> int:
        return struct.unpack_from(self.order + "i", data, offset)[0]

    def each(self, kinds: set[str]) -> Iterator[tuple[Block, str, bytes]]:
        """(block, type, content) of every struct of these types."""
        wanted = {n for n, (kind, size) in enumerate(self.structs) if kind in kinds and size}
        for block, data in self.contents(b for b in self.blocks if b.struct in wanted):
            kind, size = self.structs[block.struct]
            for at in range(0, len(data) - size + 1, size):
                yield block, kind, data[at : at + size]

    def contents(self, blocks: Iterable[Block]) -> Iterator[tuple[Block, bytes]]:
        """The contents of the blocks, in their order: a compressed file is only read forwards."""
        ordered = sorted(set(blocks), key=lambda block: block.offset)
        if ordered:
            with _opened(self.file) as content:
                for block in ordered:
                    content.seek(block.offset)
                    yield block, content.read(block.length)

    def pointer(self, data: bytes, offset: int) -> int:
        return struct.unpack_from(self.order + self.address, data, offset)[0]


def may_simulate(scene: Path) -> bool:
    """Whether a scene may have simulations: a .blend with a cache of points, a node that is baked,
    or a library. Also True for a file that cannot be read.
    """
    if scene.suffix.lower() != ".blend":
        return False
    try:
        return any(BlendFile(scene).each({"PointCache", "NodesModifierBake", "Library"}))
    except Exception:  # as for any damaged file
        return True


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
        hint = "saving the file without compression"
        raise InputError("zstandard in this Python", path=file, hint=hint) from None
    return zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)


def text(data: bytes) -> str:
    """A C string."""
    return data.split(b"\0", 1)[0].decode("utf-8", "surrogateescape")
