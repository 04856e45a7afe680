"""EXR: what is written is read back by either library, and what is broken is refused in one line."""

import io
import random
import struct
import time

import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.exr import exr_header, read_exr, write_exr
from iclnuim.formats.libraries import first_library


def _present(name):
    try:
        first_library("EXR", name)
    except WorkError:
        return False
    return True


BACKENDS = [n for n in ("OpenEXR", "OpenImageIO") if _present(n)]


@pytest.fixture
def channels():
    rng = np.random.default_rng(5)
    values = {c: rng.random((37, 53)).astype(np.float16) for c in "RGB"}
    values["Z"] = (1 + 9 * rng.random((37, 53))).astype(np.float32)
    values["Z"][0, :5] = [np.inf, -np.inf, np.nan, 1e10, -0.0]
    values["ViewLayer.Depth.Z"] = values["Z"][::-1].copy()
    return values


@pytest.fixture
def by(monkeypatch):
    """Returns a function that lets one library alone read and write."""
    return lambda name: monkeypatch.setattr("iclnuim.formats.exr.BACKENDS", (name,))


def _same(a, b):
    return a.keys() == b.keys() and all(
        a[k].dtype == b[k].dtype and a[k].tobytes() == b[k].tobytes() for k in a
    )


def compressed(path, channels, compression):
    OpenEXR = pytest.importorskip("OpenEXR")
    code = getattr(
        OpenEXR, "NO_COMPRESSION" if compression == "none" else f"{compression.upper()}_COMPRESSION"
    )
    with OpenEXR.File({"compression": code, "type": OpenEXR.scanlineimage}, dict(channels)) as file:
        file.write(str(path))


@pytest.mark.parametrize("writer", BACKENDS)
def test_either_library_reads_what_either_wrote_to_the_bit(tmp_path, channels, by, writer):
    by(writer)
    write_exr(tmp_path / "f.exr", channels)
    for reader in BACKENDS:
        by(reader)
        assert _same(read_exr(tmp_path / "f.exr"), channels), reader


@pytest.mark.parametrize("compression", ["none", "rle", "zips", "zip", "piz"])
def test_either_library_reads_every_lossless_compression(tmp_path, channels, by, compression):
    compressed(tmp_path / "f.exr", channels, compression)
    for reader in BACKENDS:
        by(reader)
        assert _same(read_exr(tmp_path / "f.exr"), channels), reader


def test_both_libraries_were_tried():
    if len(BACKENDS) < 2:
        pytest.skip(f"only {BACKENDS} here")
    assert BACKENDS == ["OpenEXR", "OpenImageIO"]


@pytest.mark.parametrize("writer", BACKENDS)
def test_the_same_pixels_give_the_same_bytes_at_another_second(tmp_path, channels, by, writer):
    by(writer)
    write_exr(tmp_path / "a.exr", channels, attributes={"recipe": "00ff"})
    time.sleep(1.05)
    write_exr(
        tmp_path / "b.exr",
        dict(reversed(channels.items())),
        attributes={"recipe": "00ff"},
    )
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert exr_header(tmp_path / "a.exr").parts[0].attributes["recipe"] == "00ff"


def test_the_header_tells_size_channels_and_compression_without_a_library(tmp_path, channels):
    compressed(tmp_path / "f.exr", channels, "piz")
    header = exr_header(tmp_path / "f.exr")
    assert (header.width, header.height, header.parts[0].compression) == (53, 37, "piz")
    assert header.channels == {
        **dict.fromkeys("RGB", "half"),
        "Z": "float",
        "ViewLayer.Depth.Z": "float",
    }


def test_a_file_split_into_parts_is_read_as_one(tmp_path, channels, by):
    OpenEXR = pytest.importorskip("OpenEXR")
    parts = [OpenEXR.Part({"name": f"part {n}"}, {n: v}) for n, v in channels.items()]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "f.exr"))
    assert len(exr_header(tmp_path / "f.exr").parts) == 5
    for reader in BACKENDS:
        by(reader)
        assert _same(read_exr(tmp_path / "f.exr"), channels), reader


@pytest.mark.parametrize("compression", ["none", "zip", "piz"])
def test_every_truncation_is_refused_in_one_line_and_silently(
    tmp_path, channels, compression, capfd
):
    compressed(tmp_path / "f.exr", channels, compression)
    data = (tmp_path / "f.exr").read_bytes()
    for size in sorted(
        {0, 1, 4, 8, 50, 200, 400, len(data) // 3, len(data) // 2, len(data) - 7, len(data) - 1}
    ):
        (tmp_path / "cut.exr").write_bytes(data[:size])
        with pytest.raises(InputError, match="cut.exr: expected a") as error:
            read_exr(tmp_path / "cut.exr")
        assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "corner", [(999_999, 999_999), (-5, -5), (2**31 - 1, 36), (52, 2**31 - 1), (65535, 65535)]
)
def test_a_header_that_claims_the_impossible_is_refused_before_any_memory_is_taken(
    tmp_path, channels, corner
):
    write_exr(tmp_path / "f.exr", channels)
    data = bytearray((tmp_path / "f.exr").read_bytes())
    place = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    struct.pack_into("<4i", data, place, 0, 0, *corner)
    (tmp_path / "f.exr").write_bytes(data)
    with pytest.raises(InputError, match="a header with|truncated"):
        read_exr(tmp_path / "f.exr")


def test_any_flipped_byte_gives_pixels_or_one_input_error(tmp_path, channels):
    write_exr(tmp_path / "f.exr", channels)
    data = (tmp_path / "f.exr").read_bytes()
    rng = random.Random(3)
    for _ in range(200):
        flipped = bytearray(data)
        flipped[rng.randrange(len(data) if rng.random() < 0.3 else 700)] ^= 1 << rng.randrange(8)
        (tmp_path / "f.exr").write_bytes(flipped)
        try:
            read_exr(tmp_path / "f.exr")
        except InputError as error:
            assert "\n" not in str(error)


def test_tiles_depth_lists_and_integer_channels_are_named_as_what_they_are(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    ids = np.zeros((4, 4), np.uint32)
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"id": ids}) as file:
        file.write(str(tmp_path / "ids.exr"))
    with pytest.raises(InputError, match="half or float channels.*id uint"):
        read_exr(tmp_path / "ids.exr")
    (tmp_path / "png.exr").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))
    with pytest.raises(InputError, match="expected an EXR image, found PNG"):
        read_exr(tmp_path / "png.exr")
    with pytest.raises(InputError, match="no such file"):
        exr_header(tmp_path / "absent.exr")
    with pytest.raises(InputError, match="a folder"):
        exr_header(tmp_path)


def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path, channels):
    with pytest.raises(WorkError, match="cannot write"):
        write_exr(tmp_path / "no such folder" / "f.exr", channels)
    (tmp_path / "in the way.exr").mkdir()
    with pytest.raises(WorkError, match="in the way.exr: cannot write"):
        write_exr(tmp_path / "in the way.exr", channels)
    for bad in (
        {},
        {"R": np.zeros((2, 2))},
        {"R": np.zeros((2, 2), np.float16), "G": np.zeros((3, 2), np.float16)},
    ):
        with pytest.raises(InputError):
            write_exr(tmp_path / "f.exr", bad)
    assert [p.name for p in tmp_path.iterdir()] == ["in the way.exr"]


@pytest.mark.parametrize("writer", BACKENDS)
def test_a_full_disk_leaves_no_file_and_one_line(tmp_path, channels, by, writer, file_size_limit):
    by(writer)
    with file_size_limit(3000), pytest.raises(WorkError, match="f.exr: cannot write"):
        write_exr(tmp_path / "f.exr", channels)
    assert list(tmp_path.iterdir()) == []


def test_the_pixels_of_a_file_are_read_once(tmp_path, channels, monkeypatch):
    """The header and the places of the chunks are checked without them."""
    write_exr(tmp_path / "f.exr", {"Z": np.random.default_rng(1).random((1000, 1000), np.float32)})
    size, read = (tmp_path / "f.exr").stat().st_size, []

    class Counted(io.FileIO):
        def read(self, count=-1):
            data = super().read(count)
            read.append(len(data))
            return data

    monkeypatch.setattr("builtins.open", lambda path, mode, buffering: Counted(path, mode))
    assert exr_header(tmp_path / "f.exr", whole=True).width == 1000
    assert sum(read) < size / 10
