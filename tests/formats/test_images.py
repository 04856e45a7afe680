"""JPEG and NumPy images: through OpenCV and through OpenImageIO, which Blender has; damaged ones
refused in a line.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.images import image_header, read_array, read_colour8, write_array, write_jpeg
from iclnuim.formats.libraries import first_library


def _present(name):
    try:
        first_library("JPEG", name)
    except WorkError:
        return False
    return True


BACKENDS = [name for name in ("cv2", "OpenImageIO") if _present(name)]


@pytest.fixture
def by(monkeypatch):
    """Returns a function that lets one library alone read and write."""
    return lambda name: monkeypatch.setattr("iclnuim.formats.png.BACKENDS", (name,))


@pytest.fixture(scope="module")
def ramp():
    v, u = np.mgrid[0:48, 0:64]
    return np.stack([4 * u, 5 * v, 2 * (u + v)], -1).astype(np.uint8)


@pytest.mark.parametrize("writer", BACKENDS)
@pytest.mark.parametrize("reader", BACKENDS)
def test_a_jpeg_keeps_colour_to_four_levels_whoever_writes_and_reads_it(
    tmp_path, ramp, by, writer, reader
):
    by(writer)
    write_jpeg(tmp_path / "a.jpg", ramp)
    by(reader)
    assert str(image_header(tmp_path / "a.jpg", whole=True)) == "64 x 48, 8-bit RGB"
    assert np.abs(read_colour8(tmp_path / "a.jpg").astype(int) - ramp).max() <= 4


@pytest.mark.parametrize("reader", BACKENDS)
@pytest.mark.parametrize(("mode", "kind"), [("L", "8-bit grey"), ("CMYK", "8-bit with 4 channels")])
def test_jpegs_of_other_colours_are_colour(tmp_path, ramp, by, reader, mode, kind):
    by(reader)
    Image = pytest.importorskip("PIL.Image")
    made = Image.fromarray(ramp).convert(mode)
    made.save(tmp_path / "a.jpg", quality=100, subsampling=0)
    assert str(image_header(tmp_path / "a.jpg")) == f"64 x 48, {kind}"
    expected = np.array(made.convert("RGB")).astype(int)
    assert np.abs(read_colour8(tmp_path / "a.jpg") - expected).max() <= 4


@pytest.mark.parametrize("kind", ["<f4", "<f2", ">f8"])
def test_depth_in_metres_is_read_in_every_kind_of_float(tmp_path, kind):
    depth = np.arange(12.0).reshape(3, 4)
    for order in "CF":
        np.save(tmp_path / "d.npy", np.asarray(depth, kind, order=order))
        assert np.array_equal(read_array(tmp_path / "d.npy"), depth)
    write_array(tmp_path / "e.npy", depth)
    assert np.load(tmp_path / "e.npy").dtype == np.float32
    assert (image_header(tmp_path / "e.npy").width, image_header(tmp_path / "e.npy").height) == (
        4,
        3,
    )


@pytest.mark.parametrize(
    "array", [np.zeros(3), np.zeros((2, 2), int), np.array([[{}]]), np.zeros((0, 4))]
)
def test_other_arrays_are_refused_and_objects_never_loaded(tmp_path, array):
    np.save(tmp_path / "d.npy", array, allow_pickle=True)
    with pytest.raises(InputError, match="a NumPy array of depth"):
        read_array(tmp_path / "d.npy")


def test_a_cut_jpeg_is_refused(tmp_path, ramp):
    write_jpeg(tmp_path / "a.jpg", ramp)
    (tmp_path / "a.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:900])
    with pytest.raises(InputError, match="a whole JPEG image"):
        read_colour8(tmp_path / "a.jpg")
