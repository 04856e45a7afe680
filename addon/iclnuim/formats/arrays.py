"""Reading of NumPy files (.npy, .npz) of floating-point numbers or masks. Python objects are never
loaded, and a header is believed only if the bytes behind it are as many as it says.
"""

import io
import os
import zipfile
import zlib
from typing import BinaryIO, Literal

import numpy as np

from ..errors import InputError, StrPath
from .files import read_bytes

_MAX_BYTES = 1 << 33


def read_npy(path: StrPath, expected: str) -> np.ndarray:
    """The array of a .npy file, of any kind but objects.

    Raises InputError, with `expected` as its words, for a damaged file.
    """
    return array_in(read_bytes(path, "an array"), path, expected)


def read_npz(path: StrPath, names: tuple[str, ...], expected: str) -> dict[str, np.ndarray]:
    """The arrays of a .npz file that are among `names`; the first one, under its own name, if none
    is, and the file has one alone.

    Raises InputError, with `expected` as its words, for a damaged file.
    """
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            there = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            wanted = [name for name in names if name in there]
            for name in wanted or (list(there) if len(there) == 1 else []):
                if there[name].file_size > _MAX_BYTES:
                    raise InputError(expected, path=path, found=f"{name} of more than 8 GB")
                found[name] = array_in(archive.read(there[name]), path, expected)
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError):
        raise InputError(expected, path=path, found="a damaged file") from None
    except RuntimeError:  # zipfile: encrypted
        raise InputError(expected, path=path, found="an encrypted file") from None
    except OSError as error:
        raise InputError(expected, path=path, found=error.strerror or error) from None
    if not found:
        listed = ", ".join(list(there)[:8]) or "nothing"
        raise InputError(f"one of the arrays {', '.join(names)}", path=path, found=listed)
    return found


def array_in(data: bytes, path: StrPath, expected: str) -> np.ndarray:
    """The array of the bytes of a .npy file; `path` and `expected` are for errors (InputError)."""
    file = io.BytesIO(data)
    shape, order, kind = _header(file, len(data), path, expected)
    return np.frombuffer(data, kind, offset=file.tell()).reshape(shape, order=order)


def map_npy(path: StrPath, expected: str) -> np.ndarray:
    """The array of a .npy file of any size, of which only what is used is read.

    Raises InputError as of read_npy().
    """
    try:
        with open(path, "rb") as file:
            size = os.stat(path).st_size
            shape, order, kind = _header(file, size, path, expected)
            return np.memmap(file, kind, "r", file.tell(), shape, order)
    except OSError as error:
        raise InputError(expected, path=path, found=error.strerror or error) from None


def _header(
    file: BinaryIO, size: int, path: StrPath, expected: str
) -> tuple[tuple[int, ...], Literal["C", "F"], np.dtype]:
    """Shape, order and type of the array of a file of `size` bytes, which is read up to its data."""
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_2_0
        if version == (1, 0):
            read = np.lib.format.read_array_header_1_0
        shape, by_columns, kind = read(file)
    except Exception:  # numpy's header parser may raise anything
        raise InputError(expected, path=path, found="a damaged header") from None
    count = 1
    for side in shape:
        count *= side
    if kind.hasobject or kind.kind not in "fbiu" or count < 1 or min(shape, default=1) < 1:
        raise InputError(expected, path=path, found=f"{kind} {shape}")
    body = size - file.tell()
    if body != count * kind.itemsize:
        sides = " x ".join(map(str, shape))
        raise InputError(expected, path=path, found=f"{body} bytes for {sides} {kind}")
    return shape, "F" if by_columns else "C", kind
