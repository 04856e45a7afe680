"""The data of PLY files, binary or ASCII, as columns of its elements."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from .files import read_bytes
from .number_lines import LineReader, NumberLines, line_blocks, parts
from .ply_header import Element, PlyHeader, read_header

#: The largest size of a row in numpy.
_LONGEST_ROW = (1 << 31) - 1

#: Properties by name in some rows: values, and for a list, whose values stand one after the other,
#: the length of each row.
Block = dict[str, tuple[np.ndarray, np.ndarray | None]]


@dataclass(frozen=True, eq=False)
class Columns:
    """The properties of an element that are used: scalars (count,), and lists as the values of all
    rows one after the other and the length of each (count,). kinds: the types in the file.
    """

    count: int = 0
    kinds: dict[str, str] = field(default_factory=dict)
    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def read_elements(path: Path, used: dict[str, tuple[str, ...]]) -> dict[str, Columns]:
    """The elements of these names with these properties, empty where the file has none.

    Raises InputError for a file that is not a PLY or has other data than its header says.
    """
    header = read_header(path)
    blocks_of = _binary(path, header) if header.order else _ascii(path, header)
    found = {name: Columns() for name in used}
    for element, blocks in blocks_of:
        wanted = used.get(element.name, ())
        some = [{name: block[name] for name in wanted if name in block} for block in blocks]
        found[element.name] = _joined(element, wanted, some)
    return found


def _joined(element: Element, wanted: tuple[str, ...], blocks: list[Block]) -> Columns:
    columns = Columns(element.count)
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
    """Columns of structured rows, whose lists have one length."""
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
