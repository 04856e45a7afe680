"""Poses as blocks of a 4x4 matrix: alone, or each after a line with its frame number, as in the
.log files of Redwood's data sets, of the augmented ICL-NUIM data set and of Open3D.
"""

from itertools import chain

import numpy as np

from ..errors import InputError
from ..formats.files import data_lines, is_number
from .columns import NumberTable
from .source import Source

_SQUARE = "blocks of a 4x4 matrix that ends in 0 0 0 1"
_NUMBERED = (
    f"{_SQUARE}, each after a line with its frame number (once, or twice and a third number)"
)
#: Numbers on the first line of a block, without and with a line of frame numbers.
_LENGTHS_BY_HEAD = ((4,), (1, 3))


def is_blocks(source: Source) -> bool:
    """Whether a file starts with a 4x4 matrix, or with one or three numbers and four after them."""
    rows = source.first_rows
    lengths = [len(row) for row in rows]
    if len(rows) < 4 or not source.starts_with_numbers:
        return False
    if lengths == [4, 4, 4, 4]:
        return all(map(is_number, rows[3])) and [float(field) for field in rows[3]] == [0, 0, 0, 1]
    return lengths[0] in (1, 3) and lengths[1:] == [4, 4, 4]


def block_rows(source: Source) -> NumberTable:
    """(n, 12), or (n, 13) with the frame number first.

    Raises InputError with the line where a block is not as expected.
    """
    lines = data_lines(source.table)
    head = int(source.columns != 4)
    starts = range(0, len(lines), 4 + head)
    blocks = [lines[start : start + 4 + head] for start in starts]
    values = np.array([_values(source, block, head) for block in blocks])
    return NumberTable(values, lambda row: (source.path, blocks[row][0][0]))


def _values(source: Source, block: list[tuple[int, str]], head: int) -> list[float]:
    """The frame number, if there is one, and the first three rows of the matrix."""
    rows = [line.split(source.delimiter) for _, line in block]
    fields = list(chain.from_iterable(rows))
    lengths = [len(row) for row in rows]
    expected = _NUMBERED if head else _SQUARE
    found = "a block of another length"
    words = [field for field in fields if not is_number(field)]
    if words:
        found = repr(words[0].strip()[:40])
    elif lengths[head:] == [4, 4, 4, 4] and lengths[0] in _LENGTHS_BY_HEAD[head]:
        values = np.array(fields, float)
        lost = not np.isfinite(values[-4:]).all()
        whole = lost or np.abs(values[-4:] - (0, 0, 0, 1)).max() <= 1e-6
        if whole and (lengths[0] != 3 or values[0] == values[1]):
            return [*values[:head].tolist(), *values[-16:-4].tolist()]
        found = " ".join(f"{value:g}" for value in (*values[:-16], *values[-4:]))
    raise InputError(expected, path=source.path, line=block[0][0], found=found)
