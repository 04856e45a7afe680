"""Reading and writing of PLY files: meshes and point clouds, binary or ASCII.

It uses only numpy, because it also runs inside Blender. Blender's PLY reader does not check the
vertex numbers of faces, so `check_ply` checks a file before.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError, StrPath
from ..geometry.triangles import check_mesh, fans, strips
from .files import atomic_write, read_bytes
from .number_lines import LineReader, NumberLines, line_blocks, parts

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


#: The largest size of a row in numpy.
_LONGEST_ROW = (1 << 31) - 1

#: Properties by name in some rows: values, and for a list, whose values stand one after the other,
#: the length of each row.
Block = dict[str, tuple[np.ndarray, np.ndarray | None]]


@dataclass(frozen=True, eq=False)
class ElementValues:
    """The properties of an element that are used: scalars (count,), and lists as the values of all
    rows one after the other and the length of each (count,). kinds: the types in the file.
    """

    count: int = 0
    kinds: dict[str, str] = field(default_factory=dict)
    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def read_elements(path: Path, used: dict[str, tuple[str, ...]]) -> dict[str, ElementValues]:
    """The elements of these names with these properties, empty where the file has none.

    Raises InputError for a file that is not a PLY or has other data than its header says.
    """
    header = read_header(path)
    blocks_of = _binary(path, header) if header.order else _ascii(path, header)
    found = {name: ElementValues() for name in used}
    for element, blocks in blocks_of:
        wanted = used.get(element.name, ())
        some = [{name: block[name] for name in wanted if name in block} for block in blocks]
        found[element.name] = _joined(element, wanted, some)
    return found


def _joined(element: Element, wanted: tuple[str, ...], blocks: list[Block]) -> ElementValues:
    columns = ElementValues(element.count)
    for name, kind, length in element.properties:
        if name not in wanted:
            continue
        columns.kinds[name] = kind
        values = np.concatenate([np.zeros(0, kind), *(block[name][0] for block in blocks)])
        if length is None:
            columns.scalars[name] = values
            continue
        none = np.zeros(0, np.int64)
        lengths = np.concatenate([none, *(block[name][1] for block in blocks)])
        columns.lists[name] = values, lengths
    return columns


def _ascii(path: Path, header: PlyHeader) -> Iterator[tuple[Element, Iterator[Block]]]:
    """The blocks of each element of a file in text. Raises InputError for more lines."""
    reader = LineReader(path, line_blocks(path, header.at, header.line, comments=False))
    for element in header.elements:
        if element.properties:
            lines = reader.take(element.count, element.name)
            yield element, (_ascii_block(part, element) for part in lines)
    reader.check_end("no more lines than the counts of the header")


def _ascii_block(lines: NumberLines, element: Element) -> Block:
    expected = f"{element.name} lines of numbers as the header has them"
    values, counts = lines.values(expected)
    ends = np.cumsum(counts)
    at = ends - counts
    last = len(values) - 1
    block: Block = {}
    for name, _, length in element.properties:
        here = values[np.minimum(at, last)]
        at = at + 1
        if length is None:
            block[name] = here, None
            continue
        fits = (here >= 0) & (here <= ends - at) & (here == np.floor(here))
        if not fits.all():
            raise lines.error(int(fits.argmin()), expected)
        lengths = here.astype(np.int64)
        block[name] = parts(values, at, lengths), lengths
        at = at + lengths
    if (at != ends).any():
        raise lines.error(int((at != ends).argmax()), expected)
    return block


def _binary(path: Path, header: PlyHeader) -> Iterator[tuple[Element, Iterator[Block]]]:
    """The blocks of each element of a binary file."""
    data = read_bytes(path, "a PLY file")
    at = header.at
    for element in header.elements:
        at, groups = _rows_of(path, data, at, header.order, element)
        yield element, (_binary_block(rows, element) for rows in groups)


def _binary_block(rows: np.ndarray, element: Element) -> Block:
    """ElementValues of structured rows, whose lists have one length."""
    block: Block = {}
    for name, _, length in element.properties:
        values = rows[name]
        if length is None:
            block[name] = values, None
        else:
            block[name] = values.reshape(-1), np.full(len(rows), values.shape[1], np.int64)
    return block


def _rows_of(
    path: Path, data: bytes, at: int, order: str, element: Element
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


def _row_type(path: Path, data: bytes, at: int, order: str, element: Element) -> np.dtype:
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
        if count < 0:
            raise InputError("lists of a possible length", path=path, found=count)
        fields += [(f"count of {name}", order + length), (name, order + kind, (count,))]
        here += size + count * np.dtype(kind).itemsize
    if here > len(data):
        raise _cut(path, element)
    if here - at > _LONGEST_ROW:
        raise InputError("lists of less than 2 GB", path=path, found=f"{here - at} bytes")
    return np.dtype(fields)


def _cut(path: Path, element: Element) -> InputError:
    return InputError(f"{element.count} of {element.name}", path=path, found="the end of the file")


_RGB = ("red", "green", "blue")
_INDICES = ("vertex_indices", "vertex_index")
#: What is read: the elements' properties.
_USED = {
    "vertex": ("x", "y", "z", *_RGB),
    "face": _INDICES,
    "tristrips": _INDICES,
}
_NAMES = {"f4": "float", "u1": "uchar", "i4": "int"}
#: Names of a property with a class of each face or vertex, the first one that is there is used.
_LABELS = ("class", "class_id", "label", "labels", "semantic", "scalar_label", "object_class")
#: Elements of polygons, and the triangles of their lists.
_UNROLLED = {"face": fans, "tristrips": strips}


@dataclass(frozen=True, eq=False)
class PlyModel:
    """points (n, 3) float64 in the file's unit; triangles (m, 3) int64, m = 0 for a point cloud;
    colours (n, 3) uint8 or (n, 0).
    """

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray


def read_ply(path: Path) -> PlyModel:
    """Read the vertices of a file and its faces as triangles (polygons become triangle fans, strips
    are unrolled).

    Raises InputError for a file that is not a PLY, is truncated, or whose faces use vertices that
    do not exist.
    """
    elements = _checked(path)
    vertices = elements["vertex"]
    if any(name not in vertices.scalars for name in "xyz"):
        found = ", ".join(vertices.scalars) or "none"
        raise InputError("vertices with x, y and z", path=path, found=found)
    points = np.stack([vertices.scalars[name] for name in "xyz"], -1).astype(np.float64)
    return PlyModel(points, _triangles(elements), _colours(vertices, len(points)))


def _triangles(elements: dict[str, ElementValues]) -> np.ndarray:
    triangles = [np.zeros((0, 3), np.int64)]
    for name, unrolled in _UNROLLED.items():
        for corners, counts in elements[name].lists.values():
            triangles.append(unrolled(corners, counts))
    return np.concatenate(triangles)


def face_colours(path: Path) -> np.ndarray:
    """(m, 3) uint8 the colours of the polygons of a file; (0, 3) without any."""
    faces = read_elements(path, {"face": _RGB})["face"]
    return _colours(faces, 0).reshape(-1, 3)


def _colours(rows: ElementValues, count: int) -> np.ndarray:
    """(count, 3) uint8 of integers, or of floats from 0 to 1; (count, 0) without colours."""
    if not rows.scalars.keys() >= set(_RGB):
        return np.zeros((count, 0), np.uint8)
    rgb = np.stack([rows.scalars[name] for name in _RGB], -1)
    if rows.kinds["red"][0] == "f":
        rgb = np.rint(255 * rgb)
    return np.clip(np.nan_to_num(rgb), 0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class MeshLabels:
    """Whole numbers of the triangles (m,), or of the points (n,); -1 for values that are none."""

    values: np.ndarray
    of_triangles: bool


def read_ply_labels(path: Path) -> MeshLabels:
    """The labels of the triangles of `read_ply`, as far as faces have a property of one of the
    names of _LABELS, else of its points. Raises InputError if there are none.
    """
    used = {"vertex": _LABELS, "face": (*_INDICES, *_LABELS), "tristrips": _INDICES}
    elements = read_elements(path, used)
    face = elements["face"]
    strips_too = elements["tristrips"].count
    for element in (face, elements["vertex"]):
        name = next((name for name in _LABELS if name in element.scalars), None)
        if name is None or (element is face and (strips_too or not face.lists)):
            continue
        values = _whole_numbers(element.scalars[name])
        if element is not face:
            return MeshLabels(values, False)
        corners = next(iter(face.lists.values()))[1]
        return MeshLabels(np.repeat(values, np.maximum(corners - 2, 0)), True)
    expected = f"a property of faces or vertices named {', '.join(_LABELS[:-1])} or {_LABELS[-1]}"
    raise InputError(expected, path=path, found="none")


def _whole_numbers(values: np.ndarray) -> np.ndarray:
    """As int64; -1 for fractions, NaN, infinity and numbers that are too large."""
    with np.errstate(invalid="ignore"):
        whole = (np.abs(values) < 1 << 31) & (values == np.floor(values))
    return np.where(whole, values, -1).astype(np.int64)


def check_ply(path: Path) -> np.ndarray:
    """The triangles (m, 3) of a file for Blender. Raises InputError if a face uses a vertex that
    does not exist, the file is truncated, or it has triangle strips.
    """
    elements = _checked(path)
    if elements["tristrips"].count:
        expected = "polygons, which Blender can read"
        raise InputError(expected, path=path, found="triangle strips")
    return _triangles(elements)


def write_ply(
    path: StrPath,
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


def _checked(path: Path) -> dict[str, ElementValues]:
    """The elements by name. Raises InputError for faces of vertices that do not exist."""
    elements = read_elements(path, _USED)
    count = elements["vertex"].count
    for name in _UNROLLED:
        faces = elements[name]
        if faces.count and len(faces.lists) != 1:
            found = " and ".join(faces.lists) or "a header without it"
            raise InputError(f"faces with a list of {_INDICES[0]}", path=path, found=found)
        least = -1 if name == "tristrips" else 0
        for corners, counts in faces.lists.values():
            good = (corners >= least) & (corners < count) & (corners == np.floor(corners))
            if not good.all():
                place = int(good.argmin())
                number = int(np.searchsorted(np.cumsum(counts), place, side="right"))
                found = f"vertex {corners[place]:g} in the one of index {number}"
                raise InputError(f"faces of vertices 0..{count - 1}", path=path, found=found)
    return elements
