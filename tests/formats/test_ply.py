"""PLY: what is written is read again, by us and by others; what is broken is refused in a line."""

import contextlib

import numpy as np
import pytest
from iclnuim.errors import IclnuimError, InputError
from iclnuim.formats.ply import check_ply, read_ply, write_ply
from judges import judge_module

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 2.25]], np.float32)
TRIANGLES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
COLOURS = np.arange(15, dtype=np.uint8).reshape(5, 3)
ASCII = """ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
property list uchar int others
element face 3
property uchar flag
property list uchar int vertex_indices
element edge 1
property int a
end_header
0 0 0 0
1 0 0 1 7
1 1 0 0
0 1 0 2 1 2
.5 .5 2.25 0
1 3 0 1 4
1 4 0 1 2 3
0 3 2 3 4
0
"""


@pytest.mark.parametrize("colours", [COLOURS, None])
@pytest.mark.parametrize("triangles", [TRIANGLES, None])
def test_what_is_written_is_read_again(tmp_path, triangles, colours):
    write_ply(tmp_path / "a.ply", POINTS, triangles, colours=colours, normals=POINTS)
    model = read_ply(tmp_path / "a.ply")
    assert (model.points == POINTS).all()
    assert (model.triangles == (TRIANGLES if triangles is not None else np.zeros((0, 3)))).all()
    assert (model.colours == (COLOURS if colours is not None else np.zeros((5, 0)))).all()


def test_open3d_reads_a_point_cloud_as_we_wrote_it(tmp_path):
    o3d = judge_module("open3d", "open3d-cpu")
    write_ply(tmp_path / "cloud.ply", POINTS, colours=COLOURS)
    cloud = o3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    assert (np.asarray(cloud.points) == POINTS).all()
    assert np.allclose(np.asarray(cloud.colors) * 255, COLOURS)


@pytest.mark.parametrize("ascii", [True, False])
def test_files_of_open3d_are_read(tmp_path, ascii):
    o3d = judge_module("open3d", "open3d-cpu")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(POINTS.astype(float)), o3d.utility.Vector3iVector(TRIANGLES)
    )
    mesh.vertex_colors = o3d.utility.Vector3dVector(COLOURS / 255)
    o3d.io.write_triangle_mesh(str(tmp_path / "m.ply"), mesh, write_ascii=ascii)
    model = read_ply(tmp_path / "m.ply")
    assert (
        (model.points == POINTS).all()
        and (model.triangles == TRIANGLES).all()
        and (model.colours == COLOURS).all()
    )


def test_polygons_become_fans_and_other_elements_and_lists_are_passed_over(tmp_path):
    (tmp_path / "a.ply").write_text(ASCII)
    model = read_ply(tmp_path / "a.ply")
    assert (model.points == POINTS).all()
    assert model.triangles.tolist() == [[0, 1, 4], [0, 1, 2], [0, 2, 3], [2, 3, 4]]


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_lists_of_changing_length_are_read_in_either_byte_order(tmp_path, order):
    name = {"<": "little", ">": "big"}[order]
    head = f"ply\nformat binary_{name}_endian 1.0\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\n"
    head += "element face 3\nproperty list uchar int vertex_index\nend_header\n"
    polygons = [[0, 1, 4], [0, 1, 2, 3], [2, 3, 4]]
    faces = b"".join(bytes([len(p)]) + np.array(p, f"{order}i4").tobytes() for p in polygons)
    (tmp_path / "a.ply").write_bytes(head.encode() + POINTS.astype(f"{order}f8").tobytes() + faces)
    model = read_ply(tmp_path / "a.ply")
    assert (model.points == POINTS).all()
    assert model.triangles.tolist() == [[0, 1, 4], [0, 1, 2], [0, 2, 3], [2, 3, 4]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ply\n", "plx\n", "no header"),
        ("float x", "flaot x", "a.ply:4: expected a line of a PLY header"),
        ("property float z\n", "", "vertex lines of numbers"),
        ("property float x", "property float w", "vertices with x, y and z"),
        ("3 2 3 4", "3 2 3 5", "faces of vertices 0..4, found vertex 5"),
        ("3 2 3 4", "3 2 3", "face lines of numbers"),
        ("vertex_indices", "corners", "a list of vertex_indices"),
        ("0\n", "", "the end of the file"),
    ],
)
def test_a_broken_file_is_refused_in_words(tmp_path, old, new, words):
    head, _, tail = ASCII.rpartition(old) if old == "0\n" else ASCII.partition(old)
    (tmp_path / "a.ply").write_text(head + new + tail)
    with pytest.raises(InputError, match=words):
        read_ply(tmp_path / "a.ply")


def test_damaged_bytes_never_end_in_another_exception(tmp_path):
    write_ply(tmp_path / "a.ply", POINTS, TRIANGLES, colours=COLOURS)
    random = np.random.default_rng(1)
    for original in ((tmp_path / "a.ply").read_bytes(), ASCII.encode()):
        for _ in range(300):
            data = bytearray(original)
            for place in random.integers(len(data), size=3):
                data[place] = random.integers(256)
            (tmp_path / "b.ply").write_bytes(data[: random.integers(len(data) // 2, len(data) + 1)])
            for read in (check_ply, read_ply):
                with contextlib.suppress(IclnuimError):
                    read(tmp_path / "b.ply")
