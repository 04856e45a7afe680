"""Arrays as text in a page: compressed, in base64. view.js unpacks them."""

import base64

import numpy as np

from ...formats.libraries import first_library


def packed_bytes(data: bytes) -> str:
    """Compressed bytes in base64."""
    name, module = first_library("compression", "deflate", "zlib")
    compress = module.zlib_compress if name == "deflate" else module.compress
    return base64.b64encode(compress(data, 9)).decode()


def packed_floats(values: np.ndarray, kind: str = "<f4") -> str:
    """Numbers of any shape as float32 or, with "<f8", float64."""
    return packed_bytes(np.ascontiguousarray(values, kind).tobytes())


def packed_whole(values: np.ndarray) -> str:
    """Unsigned whole numbers of any shape, read in the order of memory: neighbours differ by
    little, so their differences are stored, the sign in the lowest bit, all lowest bytes first.
    """
    flat = np.ascontiguousarray(values).ravel()
    size = flat.dtype.itemsize
    signed = np.dtype(f"i{size}")
    steps = np.diff(flat, prepend=flat.dtype.type(0)).view(signed)
    codes = ((steps << 1) ^ (steps >> (8 * size - 1))).astype(f"<u{size}")
    return packed_bytes(codes.view(np.uint8).reshape(-1, size).T.tobytes())
