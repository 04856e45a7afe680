"""A scene's surface in files: other programs read the same triangles, and cutting changes nothing
but their number.
"""

import numpy as np
import pytest
from iclnuim.formats.scene_model import Appearance, SceneModel, write_obj, write_ply
from judges import judge_module


@pytest.fixture
def model():
    """Two walls with a corner between them and a big triangle, two objects, one texture."""
    corners = np.array(
        [
            [[0, 0, 3], [2, 0, 3], [2, 0, 5.4]],
            [[0, 0, 3], [2, 0, 5.4], [0, 0, 5.4]],
            [[0, 0, 3], [0, 0, 5.4], [0, 4, 3]],
        ],
        float,
    )
    normals = np.repeat([[[0.0, -1, 0]], [[0, -1, 0]], [[-1, 0, 0]]], 3, axis=1)
    uv = corners[:, :, [0, 2]] / 2
    stripes = np.random.default_rng(0).integers(0, 256, (8, 4, 3), np.uint8)
    looks = (Appearance("red paint", (0.8, 0.1, 0.1)), Appearance("red_paint", (1, 1, 1), stripes))
    names = {7: "wall", 3: "other wall"}
    return SceneModel(corners, normals, uv, np.array([1, 1, 0]), np.array([7, 7, 3]), looks, names)


def test_open3d_and_trimesh_like_readers_find_the_same_surface_in_ply(model, tmp_path):
    o3d = judge_module("open3d", "open3d-cpu")
    write_ply(tmp_path / "m.ply", model)
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "m.ply"))
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    assert vertices[triangles] == pytest.approx(model.corners_m, abs=1e-6)
    assert np.asarray(mesh.vertex_normals)[triangles] == pytest.approx(model.normals, abs=1e-6)
    assert len(vertices) == 7  # the four corners of a wall, and three again with another normal
    assert mesh.get_surface_area() == pytest.approx(model.area_m2().sum())


def test_blender_reads_the_obj_with_its_textures_where_they_belong(model, tmp_path):
    bpy = pytest.importorskip("bpy", reason="needs the bpy package")
    write_obj(tmp_path / "m.obj", model)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.obj_import(filepath=str(tmp_path / "m.obj"), forward_axis="Y", up_axis="Z")
    found = {o.name: o.data for o in bpy.context.scene.objects}
    assert set(found) == {"wall", "other wall"}
    wall = found["wall"]
    assert len(wall.polygons) == 2 and len(wall.vertices) == 4
    image = next(n.image for n in wall.materials[0].node_tree.nodes if n.type == "TEX_IMAGE")
    pixels = np.array(image.pixels[:]).reshape(8, 4, 4)[::-1, :, :3]
    assert np.rint(pixels * 255) == pytest.approx(model.looks[1].texture)
    for polygon in wall.polygons:
        for loop in polygon.loop_indices:
            x, _, z = wall.vertices[wall.loops[loop].vertex_index].co
            assert tuple(wall.uv_layers[0].data[loop].uv) == pytest.approx((x / 2, z / 2))
    plain = next(
        n.image for n in found["other wall"].materials[0].node_tree.nodes if n.type == "TEX_IMAGE"
    )
    assert np.rint(np.array(plain.pixels[:3]) * 255) == pytest.approx([204, 26, 26])


def test_cutting_keeps_area_planes_texture_and_owners(model):
    pieces, origin = model.cut(0.1)
    edges = np.linalg.norm(pieces.corners_m - np.roll(pieces.corners_m, -1, axis=1), axis=2)
    assert edges.max() <= 0.1
    for k in range(len(model)):
        mine = pieces.chosen(origin == k)
        assert mine.area_m2().sum() == pytest.approx(model.area_m2()[k])
        assert (mine.instance == model.instance[k]).all() and (
            mine.material == model.material[k]
        ).all()
        normal = np.cross(*(model.corners_m[k, 1:] - model.corners_m[k, 0]))
        turned = np.cross(
            mine.corners_m[:, 1] - mine.corners_m[:, 0], mine.corners_m[:, 2] - mine.corners_m[:, 0]
        )
        assert (turned @ normal > 0).all()
        assert mine.uv == pytest.approx(mine.corners_m[:, :, [0, 2]] / 2)
    whole, rows = model.cut(100.0)
    assert np.array_equal(whole.corners_m, model.corners_m) and np.array_equal(rows, np.arange(3))
