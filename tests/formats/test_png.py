"""PNG: lossless with either compressor and reader, readable by an independent one, and broken files
refused in one line.
"""

import random

import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.libraries import first_library
from iclnuim.formats.png import (
    COMPRESSORS,
    png_header,
    read_depth16,
    read_rgb8,
    read_rgb16,
    same_pixels,
    write_png,
)


def _present(name):
    try:
        first_library("PNG", name)
    except WorkError:
        return False
    return True


BACKENDS = [n for n in ("cv2", "OpenImageIO") if _present(n)]


@pytest.fixture
def rgb():
    return np.random.default_rng(1).integers(0, 256, (31, 45, 3), np.uint8)


@pytest.fixture
def by(monkeypatch):
    """Returns a function that lets one library alone read, or compress."""

    def choose(name):
        kind = "COMPRESSORS" if name in COMPRESSORS else "BACKENDS"
        monkeypatch.setattr(f"iclnuim.formats.png.{kind}", (name,))

    return choose


@pytest.fixture
def depth():
    values = np.random.default_rng(2).integers(0, 65536, (31, 45), np.uint16)
    values[0, :3] = [0, 65535, 256]
    return values


@pytest.mark.parametrize("writer", COMPRESSORS)
def test_either_library_reads_what_either_compressor_wrote(tmp_path, rgb, depth, by, writer):
    by(writer)
    write_png(tmp_path / "rgb.png", rgb)
    write_png(tmp_path / "depth.png", depth)
    for reader in BACKENDS:
        by(reader)
        assert np.array_equal(read_rgb8(tmp_path / "rgb.png"), rgb)
        assert np.array_equal(read_depth16(tmp_path / "depth.png"), depth)
    assert str(png_header(tmp_path / "depth.png")) == "45 x 31, 16-bit grey"
    assert str(png_header(tmp_path / "rgb.png")) == "45 x 31, 8-bit RGB"


@pytest.mark.parametrize("writer", COMPRESSORS)
def test_sixteen_bit_colours_keep_every_bit_and_their_order(tmp_path, depth, by, writer):
    by(writer)
    normals = np.stack([depth, depth[::-1], 65535 - depth], -1)
    write_png(tmp_path / "normal.png", normals)
    for reader in BACKENDS:
        by(reader)
        assert np.array_equal(read_rgb16(tmp_path / "normal.png"), normals)
    for wrong in (read_rgb8, read_depth16):
        with pytest.raises(InputError, match="found 45 x 31, 16-bit RGB"):
            wrong(tmp_path / "normal.png")


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1), (3, 2000)])
def test_images_of_any_size_keep_their_pixels(tmp_path, shape):
    values = np.random.default_rng(5).integers(0, 65536, (*shape, 3), np.uint16)
    for image, read in (
        (values, read_rgb16),
        (values.astype(np.uint8), read_rgb8),
        (values[..., 1], read_depth16),
    ):
        write_png(tmp_path / "f.png", image)
        assert np.array_equal(read(tmp_path / "f.png"), image)


def test_images_are_the_same_if_their_pixels_are_however_they_are_compressed(
    tmp_path, rgb, depth, by
):
    for name, image in (("rgb", rgb), ("depth", depth)):
        for compressor in COMPRESSORS:
            by(compressor)
            write_png(tmp_path / f"{name}_{compressor}.png", np.sort(image, axis=0))
    a, b = ((tmp_path / f"rgb_{c}.png") for c in COMPRESSORS)
    assert a.read_bytes() != b.read_bytes() and same_pixels(a, b)
    assert same_pixels(*((tmp_path / f"depth_{c}.png") for c in COMPRESSORS))
    assert not same_pixels(a, tmp_path / "depth_zlib.png")
    other = np.sort(rgb, axis=0)
    other[-1, -1, -1] ^= 1
    write_png(tmp_path / "other.png", other)
    assert not same_pixels(a, tmp_path / "other.png")


def test_pillow_as_an_independent_reader_sees_the_same_pixels(tmp_path, rgb, depth):
    Image = pytest.importorskip("PIL.Image")
    write_png(tmp_path / "rgb.png", rgb)
    write_png(tmp_path / "depth.png", depth)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "rgb.png")), rgb)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "depth.png")).astype(np.uint16), depth)


@pytest.mark.parametrize("reader", BACKENDS)
def test_alpha_is_dropped_and_grey_is_repeated(tmp_path, rgb, by, reader):
    by(reader)
    Image = pytest.importorskip("PIL.Image")
    alpha = np.dstack([rgb, np.full(rgb.shape[:2], 7, np.uint8)])
    Image.fromarray(alpha).save(tmp_path / "alpha.png")
    Image.fromarray(rgb[..., 0]).save(tmp_path / "grey.png")
    assert np.array_equal(read_rgb8(tmp_path / "alpha.png"), rgb)
    assert np.array_equal(read_rgb8(tmp_path / "grey.png"), np.repeat(rgb[..., :1], 3, -1))


def test_the_wrong_kind_is_named(tmp_path, rgb, depth):
    write_png(tmp_path / "rgb.png", rgb)
    write_png(tmp_path / "depth.png", depth)
    with pytest.raises(
        InputError, match="rgb.png: expected a 16-bit grey depth PNG, found 45 x 31, 8-bit RGB"
    ):
        read_depth16(tmp_path / "rgb.png")
    with pytest.raises(
        InputError, match="depth.png: expected an 8-bit colour PNG, found 45 x 31, 16-bit grey"
    ):
        read_rgb8(tmp_path / "depth.png")
    (tmp_path / "photo.png").write_bytes(b"\xff\xd8\xff\xe0" + bytes(99))
    with pytest.raises(InputError, match="found a JPEG"):
        png_header(tmp_path / "photo.png")
    with pytest.raises(InputError, match="no such file"):
        png_header(tmp_path / "absent.png")


def test_truncated_and_flipped_files_are_refused_silently_but_for_one_line(tmp_path, depth, capfd):
    write_png(tmp_path / "f.png", depth)
    data = (tmp_path / "f.png").read_bytes()
    rng = random.Random(1)
    broken = [data[:n] for n in (0, 4, 20, 40, len(data) // 2, len(data) - 1)]
    for _ in range(100):
        flipped = bytearray(data)
        flipped[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        broken.append(bytes(flipped))
    for content in broken:
        (tmp_path / "f.png").write_bytes(content)
        with pytest.raises(InputError) as error:
            read_depth16(tmp_path / "f.png")
        assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("writer", COMPRESSORS)
def test_a_full_disk_leaves_no_file_and_one_line(tmp_path, rgb, by, writer, file_size_limit):
    by(writer)
    with file_size_limit(500), pytest.raises(WorkError, match="cannot write"):
        write_png(tmp_path / "f.png", rgb)
    assert list(tmp_path.iterdir()) == []


def test_arrays_of_another_kind_are_refused(tmp_path):
    for bad in (np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8), np.zeros((4, 4, 3), np.float32)):
        with pytest.raises(InputError, match="expected .h, w, 3. or .h, w. of uint8 or uint16"):
            write_png(tmp_path / "f.png", bad)
