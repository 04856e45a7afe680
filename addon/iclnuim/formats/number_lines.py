"""Lines of numbers of large text files (meshes), read in blocks of lines."""

import codecs
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError

#: Bytes of a block: little memory, and few of them in a large file.
BLOCK_BYTES = 1 << 22


@dataclass(frozen=True, eq=False)
class NumberLines:
    """Lines of a file that are not blank, with their numbers (n,) from 1."""

    path: Path
    texts: list[bytes]
    numbers: np.ndarray

    def __len__(self) -> int:
        return len(self.texts)

    def __getitem__(self, rows: slice) -> "NumberLines":
        return NumberLines(self.path, self.texts[rows], self.numbers[rows])

    def chosen(self, rows: np.ndarray) -> "NumberLines":
        """The lines of these indices."""
        texts = list(map(self.texts.__getitem__, rows.tolist()))
        return NumberLines(self.path, texts, self.numbers[rows])

    def error(self, row: int, expected: str, found: object = None) -> InputError:
        """The error for the line of this index."""
        if found is None:
            found = self.texts[row].decode("latin-1")
        return InputError(expected, path=self.path, line=int(self.numbers[row]), found=found)

    def values(self, expected: str, kind: type = float) -> tuple[np.ndarray, np.ndarray]:
        """The numbers of all lines in one array, and how many each line has (n,).

        Raises InputError for the first line that has something else.
        """
        counts = np.array(list(map(len, map(bytes.split, self.texts))), np.int64)
        values = _numbers(b"\n".join(self.texts), kind)
        if values is None:
            bad = (row for row, text in enumerate(self.texts) if _numbers(text, kind) is None)
            raise self.error(next(bad), expected)
        return values, counts


def _numbers(text: bytes, kind: type) -> np.ndarray | None:
    """The numbers of a text; None if it contains something else."""
    if not text.strip():
        return np.zeros(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # of numpy, for the first other text
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def parts(values: np.ndarray, start: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The values from each start (n,) on, `length` (n,) of them, one part after the other."""
    before = np.cumsum(length) - length
    return values[np.repeat(start - before, length) + np.arange(length.sum())]


def line_blocks(
    path: Path, offset: int = 0, first: int = 1, comments: bool = True
) -> Iterator[NumberLines]:
    """The lines of a file from a byte on, which begins line `first`, in blocks; without comments
    from `#` on, unless they are none. Lines end in LF, CRLF or CR; a block does not end in a
    backslash.

    Raises InputError for a file that cannot be read.
    """
    try:
        with open(path, "rb") as file:
            file.seek(offset)
            while data := file.read(BLOCK_BYTES):
                data += file.readline()
                while data.rstrip(b"\r\n").endswith(b"\\") and (more := file.readline()):
                    data += more
                data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
                if first == 1:
                    data = data.removeprefix(codecs.BOM_UTF8)
                texts = list(map(bytes.strip, data.removesuffix(b"\n").split(b"\n")))
                if comments and b"#" in data:
                    texts = [text.partition(b"#")[0].rstrip() for text in texts]
                lines = NumberLines(path, texts, np.arange(first, first + len(texts)))
                first += len(texts)
                yield lines.chosen(np.flatnonzero(list(map(len, texts))))
    except OSError as error:
        raise InputError("a mesh", path=path, found=error.strerror) from None


class LineReader:
    """Reads a file of `line_blocks` element by element."""

    def __init__(self, path: Path, blocks: Iterator[NumberLines]) -> None:
        self._blocks = blocks
        self._path = path
        self._here = NumberLines(path, [], np.zeros(0, np.int64))

    def take(self, count: int, what: str) -> Iterator[NumberLines]:
        """The next lines, `count` in all, in blocks. Raises InputError if the file has fewer."""
        left = count
        while left:
            if not len(self._here) and not self._fill():
                found = f"the end of the file after {count - left}"
                raise InputError(f"{count} of {what}", path=self._path, found=found)
            part = self._here[:left]
            self._here = self._here[left:]
            left -= len(part)
            yield part

    def check_end(self, expected: str) -> None:
        """Raises InputError if there are more lines."""
        if len(self._here) or self._fill():
            raise self._here.error(0, expected)

    def _fill(self) -> bool:
        """Whether there is another block of lines, which is then the current one."""
        self._here = next((lines for lines in self._blocks if len(lines)), self._here[:0])
        return bool(len(self._here))
