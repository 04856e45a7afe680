"""The memory that the pictures of a scene take, which is said before the first frame."""

from bpy.types import Image

#: Pictures that take less memory, in bytes, have no note, and stay decoded once they are.
MUCH = 1_000_000_000
#: Bytes of a pixel of 8 bits, and of one of floats.
_BYTES, _FLOAT_BYTES = 4, 16


class DecodedPictures:
    """Counts pictures that were decoded. Beyond `much` bytes they are freed again: Cycles, or
    whoever asks, decodes them once more.
    """

    def __init__(self, much: int = MUCH) -> None:
        self._much = much
        self._count = 0
        self._bytes = 0

    def add(self, image: Image) -> None:
        """Count an image of a file, if it was decoded."""
        if image.source != "FILE" or not image.has_data:
            return
        width, height = image.size
        self._count += 1
        self._bytes += width * height * (_FLOAT_BYTES if image.is_float else _BYTES)
        if self._bytes > self._much and not image.is_dirty:
            image.buffers_free()

    def notes(self) -> list[str]:
        """A sentence if they take much memory."""
        if self._bytes <= self._much:
            return []
        size = f"{self._bytes / 1e9:.1f} GB"
        return [f"{self._count} pictures take {size} of memory in each process that renders"]
