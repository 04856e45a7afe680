"""The header of PLY files: the order of the bytes, and the elements that follow."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from .files import read_bytes

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_LONGEST_HEADER = 1 << 16
_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r|\Z)", re.MULTILINE)
_END_OF_MAC = re.compile(rb"(?:^|\r)end_header[ \t]*(\r)")


@dataclass
class Element:
    """An element such as `vertex` or `face`: its count, and its properties as (name, type, type of
    the list's length or None).
    """

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


@dataclass(frozen=True)
class PlyHeader:
    """The order of the bytes (numpy's, empty for ASCII), the elements, and where their data begins:
    a byte, in a line from 1.
    """

    order: str
    elements: list[Element]
    at: int
    line: int


def read_header(path: Path) -> PlyHeader:
    """Raises InputError for a file that is not a PLY, or with two elements or properties of the
    same name.
    """
    data = read_bytes(path, "a PLY file", _LONGEST_HEADER)
    end = (_END if b"\n" in data.partition(b"end_header")[0] else _END_OF_MAC).search(data)
    if not data.startswith(b"ply") or end is None:
        raise InputError("a PLY file", path=path, found="no header of a PLY file")
    order = None
    elements: list[Element] = []
    lines = data[: end.start()].decode("latin-1").splitlines()
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], _TYPES[words[1]], None))
        except (KeyError, IndexError, ValueError):
            raise InputError("a line of a PLY header", path=path, line=number, found=line) from None
    twice = len({element.name for element in elements}) < len(elements)
    for element in elements:
        twice = twice or len({name for name, *_ in element.properties}) < len(element.properties)
    if order is None or twice or any(not 0 <= e.count < 1 << 31 for e in elements):
        raise InputError("a format, counts and different properties in the PLY header", path=path)
    return PlyHeader(order, elements, end.end(), len(lines) + 2)
