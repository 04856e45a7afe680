"""Reading of label images: PNG of 1 to 16 bits, grey, with a palette or in colour."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError, StrPath
from ..formats.libraries import first_library
from ..formats.png import PngHeader, checked_png, chunk, chunks_of

_PALETTE = 3
_GREY = 0


@dataclass(frozen=True, eq=False)
class LabelImage:
    """ids (h, w) uint16: grey values or indices into the palette; None for an image with colours.
    colours (h, w, 3) uint8; None for a grey image. An image in colour whose pixels are all grey has
    both.
    """

    ids: np.ndarray | None
    colours: np.ndarray | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width in pixels."""
        pixels = self.colours if self.ids is None else self.ids
        return () if pixels is None else pixels.shape[:2]


def read_label_image(path: StrPath) -> LabelImage:
    """Read a PNG of labels; alpha is dropped.

    Raises InputError for another file or a damaged one, and for colours of 16 bits.
    """
    data, header = checked_png(path)
    if header.colour == "palette":
        return _with_palette(path, data, header)
    pixels = _decoded(path, data, header)
    if header.colour.startswith("grey"):
        return LabelImage(_unscaled(pixels[..., 0], header.bits))
    colours = np.ascontiguousarray(pixels[..., 2::-1])
    is_grey = (colours == colours[..., :1]).all()
    if header.bits != 8 and not is_grey:
        raise InputError("labels in grey or in 8-bit colours", path=path, found=str(header))
    ids = colours[..., 0].astype(np.uint16) if is_grey else None
    return LabelImage(ids, colours if header.bits == 8 else None)


def _with_palette(path: StrPath, data: bytes, header: PngHeader) -> LabelImage:
    """Indices, decoded as the grey values of the same file without its palette, and colours."""
    kept = [data[:8]]
    palette = np.zeros((0, 3), np.uint8)
    for kind, content in chunks_of(data):
        if kind == b"PLTE":
            palette = np.frombuffer(content[: len(content) // 3 * 3], np.uint8).reshape(-1, 3)
        elif kind == b"IHDR":
            kept += chunk(kind, content[:9] + bytes([_GREY]) + content[10:])
        elif kind in (b"IDAT", b"IEND"):
            kept += chunk(kind, content)
    ids = _unscaled(_decoded(path, b"".join(kept), header)[..., 0], header.bits)
    if ids.max() >= len(palette):
        expected = f"indices into the palette of {len(palette)} colours"
        raise InputError(expected, path=path, found=int(ids.max()))
    return LabelImage(ids, palette[ids])


def _decoded(path: StrPath, data: bytes, header: PngHeader) -> np.ndarray:
    """(h, w, channels), blue first."""
    _, cv2 = first_library("label images", "cv2")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape[:2] != (header.height, header.width):
        raise InputError("a whole PNG image", path=path, found="pixels that cannot be decoded")
    return image if image.ndim == 3 else image[..., None]


def _unscaled(grey: np.ndarray, bits: int) -> np.ndarray:
    """The stored values (h, w) uint16 of grey pixels, which are decoded as 8 bits or more."""
    return (grey // (255 // ((1 << bits) - 1) if bits < 8 else 1)).astype(np.uint16)
