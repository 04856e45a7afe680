"""Reads the vertices and faces of OFF files (specification: Geomview's manual, "OFF Files")."""

import re
from pathlib import Path

import numpy as np

from ..geometry.triangles import fans
from .number_lines import LineReader, NumberLines, line_blocks, parts

_KEYWORD = re.compile(rb"(?:ST)?C?N?(4?n?)(?:OFF|off)(?:\s+(.*))?$")
_HEADER = "OFF and the numbers of vertices and faces"
_VERTEX = "three coordinates"


def read_off(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) float64, which may be NaN or infinite, and triangles (m, 3) int64; polygons
    become fans. Colours, normals and texture coordinates are passed over.

    Raises InputError for other text, a binary file, vertices that are not (x, y, z), fewer or more
    lines than the header says, and faces of vertices that do not exist.
    """
    reader = LineReader(path, line_blocks(path))
    vertices, faces = _counts(reader)
    points = [_points(lines) for lines in reader.take(vertices, "vertices")]
    triangles = [_triangles(lines, vertices) for lines in reader.take(faces, "faces")]
    reader.check_end(f"{vertices} vertices and {faces} faces, as the header says, and no more")
    no_triangles = np.zeros((0, 3), np.int64)
    return np.concatenate([np.zeros((0, 3)), *points]), np.concatenate([no_triangles, *triangles])


def _counts(reader: LineReader) -> tuple[int, int]:
    """The numbers of vertices and faces; the keyword is optional."""
    (line,) = reader.take(1, "headers")
    if word := _KEYWORD.match(line.texts[0]):
        if word[1]:
            expected = "vertices of three coordinates (OFF)"
            raise line.error(0, expected)
        if (word[2] or b"").lower().startswith(b"binary"):
            raise line.error(0, "an OFF file in text", "a binary one")
        if word[2]:
            line = NumberLines(line.path, [word[2]], line.numbers)
        else:
            (line,) = reader.take(1, "headers with counts")
    counts, _ = line.values(_HEADER, int)
    if len(counts) not in (2, 3) or counts.min() < 0:
        raise line.error(0, _HEADER)
    return int(counts[0]), int(counts[1])


def _points(lines: NumberLines) -> np.ndarray:
    values, counts = lines.values(_VERTEX)
    few = np.flatnonzero(counts < 3)
    if few.size:
        raise lines.error(few[0], _VERTEX)
    return values[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def _triangles(lines: NumberLines, vertices: int) -> np.ndarray:
    """Triangles of lines of a count, that many vertices, and perhaps a colour."""
    expected = f"a face: a count and that many of the vertices 0..{vertices - 1}"
    values, counts = lines.values(expected)
    start = np.cumsum(counts) - counts
    corners = values[start]
    wrong = np.flatnonzero((corners != np.floor(corners)) | (corners < 0) | (corners >= counts))
    if wrong.size:
        raise lines.error(wrong[0], expected)
    length = corners.astype(np.int64)
    used = parts(values, start + 1, length)
    wrong = np.flatnonzero((used < 0) | (used >= vertices) | (used != np.floor(used)))
    if wrong.size:
        row = int(np.searchsorted(np.cumsum(length), wrong[0], side="right"))
        raise lines.error(row, f"faces of vertices 0..{vertices - 1}", f"{used[wrong[0]]:g}")
    return fans(used, length)
