"""Reading and writing of PLY files: meshes and point clouds, binary or ASCII.

It uses only numpy, because it also runs inside Blender. Blender's PLY reader does not check the
vertex numbers of faces, so `check_ply` checks a file before.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry.triangles import check_mesh
from .files import atomic_write, read_bytes

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
_NAMES = {"f4": "float", "u1": "uchar", "i4": "int"}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_LONGEST_HEADER = 1 << 16
_INDICES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True, eq=False)
class PlyModel:
    """points (n, 3) float64 in the file's unit; triangles (m, 3) int64, m = 0 for a point cloud;
    colours (n, 3) uint8 or (n, 0).
    """

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray


@dataclass
class _Element:
    """An element such as `vertex` or `face`: its count, and its properties as (name, type, type of
    the list's length or None).
    """

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


def read_ply(path: Path) -> PlyModel:
    """Read the vertices of a file and its faces as triangles (polygons become triangle fans).

    Raises InputError for a file that is not a PLY, is truncated, or whose faces use vertices that
    do not exist.
    """
    vertices, polygons = _checked(path)
    if any(name not in vertices for name in "xyz"):
        raise InputError("vertices with x, y and z", path=path, found=", ".join(vertices) or "none")
    points = np.stack([vertices[name] for name in "xyz"], -1).astype(np.float64)
    fans = [_fans(corners) for corners in polygons if corners.shape[1] >= 3]
    triangles = np.concatenate([np.zeros((0, 3)), *fans]).astype(np.int64)
    colours = np.zeros((len(points), 0), np.uint8)
    if vertices.keys() >= {"red", "green", "blue"}:
        rgb = [vertices[name] for name in ("red", "green", "blue")]
        colours = np.stack(rgb, -1).astype(np.uint8)
    return PlyModel(points, triangles, colours)


def _fans(corners: np.ndarray) -> np.ndarray:
    """The triangles (m, 3) of polygons (k, corners)."""
    triangles = [corners[:, [0, i, i + 1]] for i in range(1, corners.shape[1] - 1)]
    return np.stack(triangles, 1).reshape(-1, 3)


def check_ply(path: Path) -> None:
    """Raises InputError if a face uses a vertex that does not exist, or the file is truncated."""
    _checked(path)


def write_ply(
    path: Path | str,
    points: np.ndarray,
    triangles: np.ndarray | None = None,
    *,
    colours: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    face_values: Mapping[str, np.ndarray] | None = None,
    comment: str | None = None,
) -> None:
    """Write binary little-endian PLY: float x y z (n, 3), float nx ny nz, uchar red green blue;
    faces of triangles (m, 3) with further int values (m,) by name. Without triangles there is no
    face element.

    Raises InputError for arrays of other shapes and for indices of no vertex, WorkError if it
    cannot be written.
    """
    points = np.asarray(points)
    check_mesh(points, np.zeros((0, 3), int) if triangles is None else np.asarray(triangles))
    columns = _columns("xyz", "f4", points)
    if normals is not None:
        normals = np.asarray(normals)
        if normals.shape != points.shape:
            raise InputError(f"normals {points.shape}", found=normals.shape)
        columns += _columns(("nx", "ny", "nz"), "f4", normals)
    if colours is not None:
        colours = np.asarray(colours)
        if colours.shape not in ((len(points), 3), (len(points), 0)) or colours.dtype != np.uint8:
            found = f"{colours.shape} {colours.dtype}"
            raise InputError(f"colours ({len(points)}, 3) as uint8", found=found)
        columns += _columns(("red", "green", "blue"), "u1", colours)
    header = ["ply", "format binary_little_endian 1.0"]
    if comment:
        header.append(f"comment {comment}")
    header += [f"element vertex {len(points)}", *_properties(columns)]
    data = _rows(len(points), columns)
    if triangles is not None:
        more = [(name, "i4", values) for name, values in (face_values or {}).items()]
        header += [f"element face {len(triangles)}", f"property list uchar int {_INDICES[0]}"]
        header += _properties(more)
        data += _rows(len(triangles), [("count", "u1", 3), ("corners", "i4", triangles), *more])
    head = "\n".join([*header, "end_header", ""]).encode()
    atomic_write(path, lambda temporary: temporary.write_bytes(head + data))


def _columns(names: Iterable[str], kind: str, values: np.ndarray) -> list[tuple]:
    """Name, type and values of each column of `values` (n, columns)."""
    return [(name, kind, column) for name, column in zip(names, values.T, strict=False)]


def _properties(columns: list[tuple]) -> list[str]:
    """The header's lines of columns."""
    return [f"property {_NAMES[kind]} {name}" for name, kind, _ in columns]


def _rows(count: int, columns: list[tuple]) -> bytes:
    kinds = [(name, f"<{kind}", np.shape(values)[1:]) for name, kind, values in columns]
    rows = np.empty(count, kinds)
    for name, _, values in columns:
        rows[name] = values
    return rows.tobytes()


def _checked(path: Path) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Properties of the vertices by name, and faces as arrays (k, corners) of vertex numbers."""
    data = read_bytes(path, "a PLY file")
    order, elements, at = _header(path, data)
    if not order:
        data = _doubles(path, data[at:].splitlines(), elements)
        at = 0
    count = next((e.count for e in elements if e.name == "vertex"), 0)
    vertices: dict[str, np.ndarray] = {}
    faces: list[np.ndarray] = []
    for element in elements:
        at, groups = _rows_of(path, data, at, order or "=", element)
        if element.name == "vertex":
            names = [name for name, _, length in element.properties if length is None]
            for name in names:
                vertices[name] = np.concatenate([rows[name] for rows in groups] or [np.zeros(0)])
        elif element.name == "face":
            lists = [name for name, _, _ in element.properties if name in _INDICES]
            for rows in groups:
                faces += [rows[name] for name in lists]
    for corners in faces:
        bad = (corners < 0) | (corners >= count) | (corners % 1 != 0)
        if bad.any():
            found = f"vertex {corners.max()}"
            raise InputError(f"faces of vertices 0..{count - 1}", path=path, found=found)
    return vertices, faces


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order, elements, and the offset of the data."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise InputError("a PLY file", path=path, found="no header of a PLY file")
    order = None
    elements = []
    for number, row in enumerate(data[:end].split(b"\n"), 1):
        line = row.decode("latin-1")
        words = line.split()
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
    twice = False
    for element in elements:
        names = {name for name, _, _ in element.properties}
        twice = twice or len(names) < len(element.properties)
        if element.name == "face" and not names & set(_INDICES):
            expected = f"faces with a list of {_INDICES[0]}"
            raise InputError(expected, path=path, found="a header without it")
    if order is None or twice or any(not 0 <= e.count < 1 << 31 for e in elements):
        raise InputError("a format, counts and different properties in the PLY header", path=path)
    after = data.find(b"\n", end)
    return order, elements, after + 1 if after >= 0 else len(data)


def _doubles(path: Path, lines: list[bytes], elements: list[_Element]) -> bytes:
    """Convert the numbers of an ASCII file to binary data of doubles.

    The types of the elements are changed to double accordingly.
    """
    found: list[np.ndarray] = []
    for element in elements:
        if len(lines) < element.count:
            raise _cut(path, element)
        rows = lines[: element.count]
        lines = lines[element.count :]
        numbers: list[float] = []
        try:
            for row in rows:
                here = len(numbers)
                numbers += map(float, row.split())
                for _, _, length in element.properties:
                    here += 1 if length is None else 1 + int(numbers[here])
                if here != len(numbers):
                    raise ValueError
        except (ValueError, IndexError, OverflowError):
            expected = f"{element.name} lines of numbers as the header has them"
            raise InputError(expected, path=path) from None
        found.append(np.array(numbers))
        doubles = [(name, "f8", length and "f8") for name, _, length in element.properties]
        element.properties = doubles
    return b"".join(array.tobytes() for array in found)


def _rows_of(
    path: Path, data: bytes, at: int, order: str, element: _Element
) -> tuple[int, list[np.ndarray]]:
    """The offset of the end of the element, and its rows as structured arrays, a new one wherever
    lists change their length. Rows are read together as long as their lists have the length of the
    first row's.
    """
    found = []
    done = 0
    ahead = 64
    while done < element.count and element.properties:
        row = _row_type(path, data, at, order, element)
        count = min(ahead, element.count - done, (len(data) - at) // row.itemsize)
        rows = np.frombuffer(data, row, count, at)
        same = np.ones(len(rows), bool)
        for name, _, length in element.properties:
            if length is not None:
                same &= rows[f"count of {name}"] == row[name].shape[0]
        like_first = len(rows) if same.all() else int(same.argmin())
        if not like_first:
            raise _cut(path, element)
        found.append(rows[:like_first])
        at = at + like_first * row.itemsize
        done = done + like_first
        # rows of changing length are not scanned repeatedly
        ahead = 2 * ahead if like_first == ahead else 64
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
            raise _cut(path, element)
        count = int(np.frombuffer(data, order + length, 1, here)[0])
        if not 0 <= count <= len(data):
            raise InputError("lists of a possible length", path=path, found=count)
        fields += [(f"count of {name}", order + length), (name, order + kind, (count,))]
        here += size + count * np.dtype(kind).itemsize
    return np.dtype(fields)


def _cut(path: Path, element: _Element) -> InputError:
    return InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")
