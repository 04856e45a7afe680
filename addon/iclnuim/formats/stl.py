"""Reads STL files, binary or in text."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from .files import read_bytes
from .number_lines import NumberLines, line_blocks

#: The comment and the number of triangles that begin a binary file.
_HEADER_BYTES = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_VERTEX = "vertex and three coordinates"


def read_stl(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) float64, which may be NaN or infinite, and triangles (m, 3) int64. Corners in
    the same place are one point: means over points would else depend on the format.

    Raises InputError for a file that is neither, or that is cut off.
    """
    head = read_bytes(path, "an STL file", _HEADER_BYTES)
    size = path.stat().st_size
    count = int.from_bytes(head[80:84], "little")
    is_text = head.lstrip()[:5].lower() == b"solid"
    if len(head) == _HEADER_BYTES and size == _HEADER_BYTES + count * _TRIANGLE.itemsize:
        return _merged(_binary_corners(path))
    if is_text:
        return _merged(_text_corners(path))
    whole = max(0, size - _HEADER_BYTES) / _TRIANGLE.itemsize
    expected = f"an STL file of {count} triangles, as its header says"
    raise InputError(expected, path=path, found=f"{size} bytes, of {whole:.10g} triangles")


def _binary_corners(path: Path) -> np.ndarray:
    """(3 m, 3) float32."""
    triangles = np.fromfile(path, _TRIANGLE, offset=_HEADER_BYTES)
    return triangles["corners"].reshape(-1, 3)


def _text_corners(path: Path) -> np.ndarray:
    """(3 m, 3) float64."""
    found = [np.zeros((0, 3))]
    loops = 0
    last = NumberLines(path, [b"nothing"], np.ones(1, np.int64))
    for lines in line_blocks(path, comments=False):
        words = np.array([text.split(None, 1)[0].lower() for text in lines.texts])
        is_vertex = words == b"vertex"
        ends = np.flatnonzero(words == b"endloop")
        corners = 3 * loops - sum(map(len, found)) - np.cumsum(is_vertex)[ends]
        wrong = np.flatnonzero(corners + 3 * np.arange(1, len(ends) + 1))
        if wrong.size:
            raise lines.error(int(ends[wrong[0]]), "loops of three vertices")
        found.append(_coordinates(lines.chosen(np.flatnonzero(is_vertex))))
        loops += len(ends)
        last = lines[-1:]
    end = b"".join(last.texts[0].lower().split())
    if not end.startswith(b"endsolid") or sum(map(len, found)) != 3 * loops:
        raise last.error(0, "endsolid at the end of the file")
    return np.concatenate(found)


def _coordinates(lines: NumberLines) -> np.ndarray:
    """(n, 3), of lines of vertices."""
    texts = [text[len("vertex") :] for text in lines.texts]
    values, counts = NumberLines(lines.path, texts, lines.numbers).values(_VERTEX)
    wrong = np.flatnonzero(counts != 3)
    if wrong.size:
        raise lines.error(wrong[0], _VERTEX)
    return values.reshape(-1, 3)


def _merged(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different corners (n, 3), sorted, and triangles (m, 3) of them."""
    order = np.lexsort(corners.T[::-1])
    ordered = corners[order]
    first = np.ones(len(ordered), bool)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    triangles = np.empty(len(ordered), np.int64)
    triangles[order] = np.cumsum(first) - 1
    return ordered[first].astype(np.float64), triangles.reshape(-1, 3)
