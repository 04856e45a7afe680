"""Reads the vertices and faces of Wavefront OBJ files (specification: Alias Wavefront, Advanced
Visualizer manual, appendix B1).
"""

import re
from pathlib import Path

import numpy as np

from ..geometry.triangles import fans
from .number_lines import NumberLines, line_blocks

_VERTEX = "v and three coordinates"
_FACE = "f and numbers of vertices, such as 1 2 3, 1/1/1 2/2/2 3/3/3 or -3 -2 -1"
#: Starts of the lines that are read.
_READ = (b"v ", b"f ", b"v\\", b"f\\")
#: What follows the number of a vertex: those of its texture coordinate and normal.
_OTHER_NUMBERS = re.compile(rb"(?<=\d)/\S*")


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) float64, which may be NaN or infinite, and triangles (m, 3) int64; polygons
    become fans. Only vertices and faces are read.

    Raises InputError for other text in them, and for faces of vertices that do not exist.
    """
    points = [np.zeros((0, 3))]
    triangles = [np.zeros((0, 3), np.int64)]
    total = 0
    largest = 0
    beyond = None
    for block in line_blocks(path):
        lines = _continued(block)
        starts = np.array([text[:2] for text in lines.texts], "S2")
        is_vertex = np.isin(starts, (b"v", b"v ", b"v\t"))
        is_face = np.isin(starts, (b"f", b"f ", b"f\t"))
        points.append(_points(_rest(lines, is_vertex)))
        faces = _rest(lines, is_face)
        known = total + np.cumsum(is_vertex)[is_face]
        corners, counts = _corners(faces, known)
        triangles.append(fans(corners, counts))
        if len(corners) and corners.max() > largest:
            largest = int(corners.max())
            beyond = faces[int(np.repeat(np.arange(len(counts)), counts)[corners.argmax()]) :][:1]
        total += len(points[-1])
    if beyond is not None and largest >= total:
        raise beyond.error(0, f"faces of vertices 1..{total}", largest + 1)
    return np.concatenate(points), np.concatenate(triangles)


def _continued(lines: NumberLines) -> NumberLines:
    """The lines of vertices and faces joined with those that follow a backslash at their end."""
    if b"\\\n" not in b"\n".join([*lines.texts, b""]):
        return lines
    texts: list[bytes] = []
    rows: list[int] = []
    for row, text in enumerate(lines.texts):
        if texts and texts[-1].endswith(b"\\") and texts[-1].startswith(_READ):
            texts[-1] = texts[-1][:-1] + b" " + text
            continue
        texts.append(text.replace(b"\t", b" "))
        rows.append(row)
    return NumberLines(lines.path, texts, lines.numbers[rows])


def _rest(lines: NumberLines, mask: np.ndarray) -> NumberLines:
    """The chosen lines without their first letter and the numbers after a slash."""
    chosen = lines.chosen(np.flatnonzero(mask))
    texts = [text[1:] for text in chosen.texts]
    whole = b"\n".join(texts)
    if b"/" in whole:
        texts = _OTHER_NUMBERS.sub(b"", whole).split(b"\n")
    return NumberLines(lines.path, texts, chosen.numbers)


def _points(lines: NumberLines) -> np.ndarray:
    """(n, 3), of lines of x y z, a weight or colours, or both."""
    values, counts = lines.values(_VERTEX)
    few = np.flatnonzero(counts < 3)
    if few.size:
        raise lines.error(few[0], _VERTEX)
    start = np.cumsum(counts) - counts
    weighted = np.flatnonzero(counts == 4)
    other = weighted[values[start[weighted] + 3] != 1]
    if other.size:
        found = f"{values[start[other[0]] + 3]:g}"
        raise lines.error(other[0], "x y z and, as a fourth number, a weight of 1", found)
    return values[start[:, None] + np.arange(3)]


def _corners(lines: NumberLines, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices from 0 of the corners of all faces, and the number of corners of each (n,).
    known (n,): the number of vertices before each, from which negative numbers count back.
    """
    corners, counts = lines.values(_FACE, int)
    before = np.repeat(known, counts)
    found = np.where(corners < 0, corners + before, corners - 1)
    wrong = np.flatnonzero((corners == 0) | (found < 0))
    if wrong.size:
        row = int(np.repeat(np.arange(len(counts)), counts)[wrong[0]])
        expected = f"faces of vertices 1..{known[row]}, or -{known[row]}..-1"
        raise lines.error(row, expected, corners[wrong[0]])
    return found, counts
