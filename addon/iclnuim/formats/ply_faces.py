"""Looks at a PLY file before Blender does: its reader follows a face's vertex numbers without asking whether they are there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

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
_INDICES = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """`vertex` or `face`: how many, and its properties as (name, type, type of the list's length or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]

    def is_plain(self) -> bool:
        return all(length is None for _, _, length in self.properties)


def check(path: Path) -> None:
    """Raises InputError where a face names a vertex that is not there, or the file ends too early."""
    data = read_bytes(path, "a PLY file")
    order, elements, start = _header(path, data)
    vertices = next((e.count for e in elements if e.name == "vertex"), 0)
    walk = _ascii if order == "" else _binary
    for numbers in walk(path, data[start:] if order == "" else data, start, order, elements):
        if len(numbers) and not (numbers.min() >= 0 and numbers.max() < vertices):
            raise InputError(f"faces of vertices 0..{vertices - 1}", path=path, found=f"vertex {int(numbers.max())}")


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise InputError("a PLY file", path=path, found="no header of one")
    order, elements = None, []
    for number, row in enumerate(data[:end].split(b"\n"), 1):
        line = row.decode("latin-1")
        words = [word.decode("latin-1") for word in row.split()]
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], _TYPES[words[1]], None))
        except (KeyError, IndexError, ValueError):
            raise InputError("a line of a PLY header", path=path, line=number, found=line) from None
    if any(e.name == "face" and not {name for name, _, _ in e.properties} & set(_INDICES) for e in elements):
        raise InputError(f"faces with a list of {_INDICES[0]}", path=path, found="a header without it")
    if order is None or any(not 0 <= e.count < 1 << 31 for e in elements):
        raise InputError("a format and counts in the PLY header", path=path)
    after = data.find(b"\n", end)
    return order, elements, after + 1 if after >= 0 else len(data)


def _binary(path: Path, data: bytes, at: int, order: str, elements: list[_Element]):
    """Yields the vertex numbers of faces, arrays of them."""
    for element in elements:
        if element.is_plain():
            at += element.count * sum(np.dtype(kind).itemsize for _, kind, _ in element.properties)
            if at > len(data):
                raise InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")
        else:
            at, found = _lists(path, data, at, order, element)
            yield from found if element.name == "face" else ()


def _lists(path: Path, data: bytes, at: int, order: str, element: _Element) -> tuple[int, list[np.ndarray]]:
    """All rows at once while their lists are as long as the first row's; row by row from where they are not."""
    found, done, ahead = [], 0, 64
    while done < element.count:
        row = _row_type(path, data, at, order, element)
        rows = np.frombuffer(data, row, min(ahead, element.count - done, (len(data) - at) // row.itemsize), at)
        same = np.ones(len(rows), bool)
        for name, _, length in element.properties:
            if length is not None:
                same &= rows[f"count of {name}"] == row[name].shape[0]
        like_first = len(rows) if same.all() else int(same.argmin())
        if not like_first:
            raise InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")
        found += [rows[name][:like_first] for name, _, _ in element.properties if name in _INDICES]
        at, done = at + like_first * row.itemsize, done + like_first
        ahead = 2 * ahead if like_first == ahead else 64  # rows of changing length are not looked at again and again
    return at, found


def _row_type(path: Path, data: bytes, at: int, order: str, element: _Element) -> np.dtype:
    """The layout of the row at `at`."""
    fields: list[tuple] = []
    here = at
    for name, kind, length in element.properties:
        if length is None:
            fields.append((name, order + kind))
            here += np.dtype(kind).itemsize
            continue
        size = np.dtype(length).itemsize
        if here + size > len(data):
            raise InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")
        count = int(np.frombuffer(data, order + length, 1, here)[0])
        if not 0 <= count <= len(data):
            raise InputError("lists of a possible length", path=path, found=count)
        fields += [(f"count of {name}", order + length), (name, order + kind, (count,))]
        here += size + count * np.dtype(kind).itemsize
    return np.dtype(fields)


def _ascii(path: Path, data: bytes, at: int, order: str, elements: list[_Element]):
    lines = data.splitlines()
    done = 0
    for element in elements:
        rows = lines[done : done + element.count]
        if len(rows) < element.count:
            raise InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")
        done += element.count
        first_is_list = bool(element.properties) and element.properties[0][0] in _INDICES
        if element.name == "face" and first_is_list:
            yield _numbers(path, rows)


def _numbers(path: Path, rows: list[bytes]) -> np.ndarray:
    try:
        split = [row.split() for row in rows]
        return np.array([int(word) for words in split for word in words[1 : 1 + int(words[0])]], np.int64)
    except (ValueError, IndexError, OverflowError):
        raise InputError("faces as whole numbers", path=path) from None
