"""Values in COLMAP's binary files, which are little-endian."""

import struct
from pathlib import Path

from ..errors import InputError
from ..formats.files import read_bytes


class BinaryFile:
    """The content of a binary file, taken from its start."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.place = 0

    def take(self, form: str) -> tuple:
        """The next values of a form of `struct`, little-endian."""
        form = "<" + form
        try:
            found = struct.unpack_from(form, self.data, self.place)
        except struct.error:
            raise self.cut() from None
        self.place += struct.calcsize(form)
        return found

    def take_name(self) -> str:
        """The next text, which ends in a zero."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise self.cut()
        name = self.data[self.place : end].decode("utf-8", "replace")
        self.place = end + 1
        return name

    def skip(self, size: int) -> None:
        """Leave out the next bytes."""
        self.place += size
        if self.place > len(self.data):
            raise self.cut()

    def cut(self) -> InputError:
        """The error for a file that ends too early."""
        return InputError("a whole binary file of COLMAP", path=self.path, found="a damaged file")
