"""The orientation in an image's EXIF data: how its pixels are to be turned when it is shown
(CIPA DC-008, Exif 2.32, section 4.6.4: tag 274).
"""

import struct

from ..errors import InputError, StrPath

_ORIENTATION = 0x0112
_UPRIGHT = 1
_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}


def refuse_turned(tiff: bytes, path: StrPath) -> None:
    """Raises InputError if the EXIF data, which has the form of a TIFF file, says that the pixels
    are to be turned or mirrored: readers differ on whether they do it, so that camera and depth
    would belong to other pixels.
    """
    orientation = _orientation(tiff)
    if orientation != _UPRIGHT:
        expected = "an image whose pixels are stored upright"
        hint = "images turned as this tag says, without the tag"
        found = f"EXIF orientation {orientation}"
        raise InputError(expected, path=path, found=found, hint=hint)


def _orientation(tiff: bytes) -> int:
    """The number in the first directory; 1 (upright) if there is none that is valid."""
    order = _ORDERS.get(tiff[:4])
    if order is None:
        return _UPRIGHT
    try:
        (place,) = struct.unpack_from(order + "I", tiff, 4)
        (count,) = struct.unpack_from(order + "H", tiff, place)
        for entry in range(count):
            tag, kind, _, value = struct.unpack_from(order + "HHIH", tiff, place + 2 + 12 * entry)
            if tag == _ORIENTATION and kind == 3 and 1 <= value <= 8:
                return int(value)
    except struct.error:
        pass
    return _UPRIGHT
