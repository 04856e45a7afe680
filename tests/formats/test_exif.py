"""An image that is to be turned when it is shown is refused, in every way to say so."""

import io
import struct
import zlib

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.images import image_header, read_colour8, write_jpeg
from iclnuim.formats.png import checked_png, read_depth16, read_rgb8, write_png

RGB = np.arange(8 * 12 * 3, dtype=np.uint8).reshape(8, 12, 3)
DEPTH = np.full((8, 12), 5000, np.uint16)


def tiff(orientation: int, order: str = "<") -> bytes:
    """EXIF data with an entry before the orientation, as cameras write it."""
    head = b"II*\0" if order == "<" else b"MM\0*"
    size = struct.pack(order + "HHIHH", 0x0100, 3, 1, 12, 0)
    turn = struct.pack(order + "HHIHH", 0x0112, 3, 1, orientation, 0)
    return head + struct.pack(order + "IH", 8, 2) + size + turn + struct.pack(order + "I", 0)


def into_jpeg(path, exif: bytes) -> None:
    data = path.read_bytes()
    segment = b"Exif\0\0" + exif
    head = b"\xff\xe1" + struct.pack(">H", len(segment) + 2)
    path.write_bytes(data[:2] + head + segment + data[2:])


def into_png(path, exif: bytes, end: int) -> None:
    """Put a chunk with EXIF data `end` bytes before the end of the file."""
    data = path.read_bytes()
    checksum = struct.pack(">I", zlib.crc32(b"eXIf" + exif))
    chunk = struct.pack(">I", len(exif)) + b"eXIf" + exif + checksum
    path.write_bytes(data[:-end] + chunk + data[-end:])


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("order", "<>")
def test_an_image_that_is_to_be_turned_is_refused(tmp_path, orientation, order):
    jpeg = tmp_path / "a.jpg"
    colour = tmp_path / "a.png"
    depth = tmp_path / "d.png"
    write_jpeg(jpeg, RGB)
    write_png(colour, RGB)
    write_png(depth, DEPTH)
    into_jpeg(jpeg, tiff(orientation, order))
    for path in (colour, depth):
        into_png(path, tiff(orientation, order), 12)
    for path, read in (
        (jpeg, image_header),
        (jpeg, read_colour8),
        (colour, checked_png),
        (colour, read_rgb8),
        (depth, read_depth16),
    ):
        if orientation == 1:
            read(path)
            continue
        with pytest.raises(InputError, match=f"found EXIF orientation {orientation}; try") as error:
            read(path)
        assert str(path) in str(error.value)


def test_the_orientation_that_pillow_writes_is_found(tmp_path):
    Image = pytest.importorskip("PIL.Image")
    exif = Image.Exif()
    exif[0x0112] = 6
    for name in ("a.jpg", "a.png"):
        content = io.BytesIO()
        Image.fromarray(RGB).save(content, name[2:].replace("jpg", "jpeg"), exif=exif)
        (tmp_path / name).write_bytes(content.getvalue())
        with pytest.raises(InputError, match="EXIF orientation 6"):
            image_header(tmp_path / name, whole=True)


@pytest.mark.parametrize(
    "exif", [b"", b"II*\0", b"II*\0\xff\xff\0\0", tiff(0), tiff(9), tiff(6)[:20], b"XX" + tiff(6)]
)
def test_damaged_exif_data_says_nothing(tmp_path, exif):
    write_jpeg(tmp_path / "a.jpg", RGB)
    into_jpeg(tmp_path / "a.jpg", exif)
    write_png(tmp_path / "a.png", RGB)
    into_png(tmp_path / "a.png", exif, 12)
    assert image_header(tmp_path / "a.jpg").width == 12
    assert checked_png(tmp_path / "a.png")[1].width == 12
