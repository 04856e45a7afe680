"""Meshes as other people's programs write them: each is read as what it says, or refused in a line
that names the cause.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.meshes import read_mesh, read_mesh_or_cloud

sys.path.insert(0, str(Path(__file__).parent))
import mesh_files as made  # noqa: E402


def area_and_volume(points, triangles):
    a, b, c = (points[triangles[:, n]] for n in range(3))
    cross = np.cross(b - a, c - a)
    return np.linalg.norm(cross, axis=1).sum() / 2, (a * cross).sum() / 6


@pytest.mark.parametrize(
    ("kind", "name"), [(k, n) for k, names in made.FILES.items() for n in names]
)
def test_a_box_is_read_from_every_dialect(tmp_path, kind, name):
    path = tmp_path / f"box.{kind}"
    path.write_bytes(made.content(kind, name))
    points, triangles, _ = read_mesh(path)
    assert points.dtype == np.float64 and triangles.dtype == np.int64
    area, volume = area_and_volume(points, triangles)
    assert abs(volume) == pytest.approx(8) and area == pytest.approx(24)
    assert len(np.unique(points[np.unique(triangles)], axis=0)) == 8


OFF = "OFF\n8 6 12\n" + made.OFF_POINTS + made.OFF_FACES
PLY = made.PLAIN_PLY.decode()
STRIP = made.content("ply", "strips").decode()
#: A kind, its file, and the place and words of the refusal.
REFUSED = [
    ("obj", made.V + made.F + "f 1 2 99\n", r":21: .* vertices 1\.\.8, found 99"),
    ("obj", made.V + made.F + "f 1/1 2/1 99/1\n", r":21: .* vertices 1\.\.8, found 99"),
    ("obj", made.V + made.F + "f 1 2 -9\n", r":21: .* or -8\.\.-1, found -9"),
    ("obj", "f 1 2 -1\n" + made.V, r":1: .* found -1"),
    ("obj", made.V + "f 0 1 2\n" + made.F, r":9: .* vertices 1\.\.8.*, found 0"),
    ("obj", made.V + "f 1 2 99999999999999999999\n", r":9: "),
    ("obj", made.V + "f 1 2 3.5\n", r":9: expected f and numbers .* found 1 2 3.5"),
    ("obj", made.V + "f 1 2 3 /4\n", r":9: "),
    ("obj", made.V + "f 1 2 \\\n x\n", r":9: "),
    ("obj", made.V + "f 1\\\n 2 3\nf 1 2 x\n", r":11: "),
    ("obj", "v 1 2\n" + made.V + made.F, r":1: expected v and three"),
    ("obj", "v\n" + made.V + made.F, r":1: expected v and three"),
    ("obj", "v 0,5 1 2\n" + made.V + made.F, r":1: expected v and three"),
    ("obj", made.V + "v 0 0 0 2\n" + made.F, r":9: expected .* a weight of 1, found 2"),
    ("obj", "", "with points, found none"),
    ("obj", "o nothing\n" + made.F, r":4: expected faces of vertices 1\.\.0"),
    ("obj", (made.V + made.F).encode("utf-16").decode("latin-1"), "with points, found none"),
    ("off", OFF.replace("OFF", "OFF BINARY"), r":1: .* text, found a binary one"),
    ("off", OFF.replace("OFF", "4OFF"), r":1: .* three coordinates \(OFF\), found 4OFF"),
    ("off", OFF.replace("OFF", "nOFF 3"), r":1: .* three coordinates \(OFF\)"),
    ("off", OFF.replace("8 6", "9 6"), r"faces"),
    ("off", OFF.replace("8 6", "8 7"), "7 of faces, found the end of the file after 6"),
    ("off", OFF.replace("8 6", "8 5"), r":16: expected 8 vertices and 5 faces.*no more"),
    ("off", OFF.replace("8 6", "8 1000000000000"), "the end of the file after 6"),
    ("off", OFF.replace("8 6", "-8 6"), r":2: "),
    ("off", OFF.replace("4 0 1 3 2", "4 0 1 3 8"), r":11: .* vertices 0\.\.7, found 8"),
    ("off", OFF.replace("4 0 1 3 2", "4 0 1 3 -1"), r":11: .* found -1"),
    ("off", OFF.replace("4 0 1 3 2", "4 0 1 3"), r":11: expected a face: a count"),
    ("off", OFF.replace("4 0 1 3 2", "nan 0 1 3"), r":11: expected a face: a count"),
    ("off", OFF.replace("-1 -1 -1", "-1 -1 x"), r":3: expected three coordinates"),
    ("off", "not a mesh", ":1: expected OFF and the numbers"),
    ("off", "", "1 of headers, found the end"),
    ("ply", PLY.replace("4 0 1 3 2", "4 0 1 3 -1"), r"vertices 0\.\.7, found vertex -1 in .* 0"),
    ("ply", PLY.replace("4 1 5 7 3", "4 1 5 7 8"), r"vertices 0\.\.7, found vertex 8 in .* 5"),
    ("ply", PLY.replace("4 1 5 7 3", "4 1 5 7 2.5"), r"found vertex 2.5 in"),
    ("ply", PLY.replace("4 1 5 7 3", "4 1 5 7"), r":23: expected face lines of numbers"),
    ("ply", PLY.replace("4 1 5 7 3", "3 1 5 7 3"), r":23: expected face lines of numbers"),
    ("ply", PLY.replace("4 1 5 7 3", "nan 1 5 7 3"), r":23: expected face lines of numbers"),
    ("ply", PLY.replace("-1 -1 -1", "-1 -1"), r":10: expected vertex lines"),
    ("ply", PLY + "4 0 1 3 2\n", r":24: expected no more lines"),
    ("ply", PLY.replace("face 6", "face 1000000000"), "the end of the file after 6"),
    ("ply", PLY.replace("face 6", "face 1000000000000"), "counts and different"),
    (
        "ply",
        PLY.replace("list uchar int", "uchar").replace("\n4 ", "\n"),
        ":18: expected face lines",
    ),
    ("ply", PLY.replace("vertex_indices", "others"), "a list of vertex_indices"),
    ("ply", PLY.replace("element face", "element vertex"), "different properties"),
    ("ply", PLY.replace("float z", "float height"), "with x, y and z, found x, y"),
    ("ply", PLY.replace("ascii", "binary"), r":2: expected a line of a PLY header"),
    ("ply", STRIP.replace("10 0 4", "10 0 -2"), "found vertex -2"),
    ("stl", made.TEXT_STL[:400], ":[0-9]+: expected"),
    ("stl", made.TEXT_STL.replace("endsolid box\n", ""), "expected endsolid"),
    ("stl", made.TEXT_STL.replace("vertex -1 -1 -1\n", "\n", 1), ":7: expected loops of three"),
    ("stl", made.TEXT_STL.replace("vertex -1 -1 -1", "vertex -1 -1 x", 1), ":4: expected vertex"),
    ("stl", made.TEXT_STL.replace("vertex -1 -1 -1", "vertex -1 -1", 1), ":4: expected vertex"),
    ("stl", made.binary_stl()[:-1].decode("latin-1"), "12 triangles, .* found 683 bytes"),
    ("stl", made.binary_stl()[:50].decode("latin-1"), "0 triangles, .* found 50 bytes"),
    ("stl", (made.binary_stl() + b"x" * 50).decode("latin-1"), "bytes, of 13 triangles"),
]


@pytest.mark.parametrize(("kind", "text", "words"), REFUSED)
def test_what_cannot_be_read_is_refused_with_place_and_cause(tmp_path, kind, text, words):
    path = tmp_path / f"a.{kind}"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=words) as raised:
        read_mesh(path)
    assert str(raised.value).startswith(str(path)) and "\n" not in str(raised.value)


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "NaN", "-nan", "1e999"])
@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("obj", made.V + "v 0 {} 0\n" + made.F),
        ("off", "OFF 9 6 0\n" + made.OFF_POINTS + "0 {} 0\n" + made.OFF_FACES),
        ("ply", PLY.replace("vertex 8", "vertex 9").replace("4 0 1 3 2", "0 {} 0\n4 0 1 3 2")),
    ],
)
def test_a_point_that_is_not_finite_is_read_as_such_in_every_format(tmp_path, kind, text, word):
    path = tmp_path / f"a.{kind}"
    path.write_text(text.format(word))
    points, triangles, _ = read_mesh_or_cloud(path)
    assert np.isfinite(points).all(axis=1).sum() == 8 and len(points) == 9
    area, _ = area_and_volume(points, triangles)
    assert area == pytest.approx(24)
    with pytest.raises(InputError, match="NaN or infinity in 1 of 9"):
        read_mesh(path)
