"""How large the levels of all textures may be together: beyond it, the largest pictures are halved
before their levels are made.
"""

from collections.abc import Mapping
from typing import TypeVar

from .mipmap_images import LEVELS, levels_shape

Key = TypeVar("Key")

#: What the levels of all pictures may take in the memory of a process, in bytes.
MAX_BYTES = 2_000_000_000
#: Bytes of a texel of an image of 8 bits, which Cycles reads from a file, and of one of floats, which
#: both Blender and Cycles hold.
BYTE, FLOAT = 4, 2 * 16


def halvings(
    pictures: Mapping[Key, tuple[int, int, int]], limit: int = MAX_BYTES
) -> dict[Key, int]:
    """How often each picture (width, height, bytes of a texel) is halved, so that the levels of all
    take at most `limit` bytes. Pictures that are too many even so are missing: the smallest remain.

    The largest are halved first, and of equal ones the last. Halves have whole texels, and at least
    as many as one of the coarsest level has.
    """
    found = dict.fromkeys(pictures, 0)
    sizes = {key: _bytes(*picture, 0) for key, picture in pictures.items()}
    while sum(sizes.values()) > limit:
        largest = max(reversed(sizes), key=sizes.__getitem__)
        width, height, texel = pictures[largest]
        step = 2 ** (found[largest] + 1)
        if width % step or height % step or min(width, height) < step * 2**LEVELS:
            del found[largest], sizes[largest]
        else:
            found[largest] += 1
            sizes[largest] = _bytes(width, height, texel, found[largest])
    return found


def _bytes(width: int, height: int, texel: int, times: int) -> int:
    rows, columns = levels_shape(width >> times, height >> times)
    return rows * columns * texel
