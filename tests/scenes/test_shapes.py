"""Shapes as plain meshes: closed ones are watertight and turned outwards, volumes are right, curves
pass through their points.
"""

import numpy as np
import pytest
from iclnuim.blend.builder.hard import chair
from iclnuim.blend.builder.mesh import face_normals, grid, join
from iclnuim.blend.builder.shapes import bar, lathe, rounded_box, sheet, smooth_profile, tube
from iclnuim.blend.builder.soft import pillow
from iclnuim.blend.builder.tableware import fruit, plate, vase

RING = [(np.cos(t), np.sin(t), 0.1 * t) for t in np.linspace(0, 4, 30)]


def closed_shapes():
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 7))
    return {
        "box": rounded_box((1, 2, 3), 0.1, 2, (2, 3, 4)),
        "thin board": rounded_box((1, 1, 0.01), 0.02),
        "ball": lathe(
            [(0, -1), *[(np.cos(a), np.sin(a)) for a in np.linspace(-1.4, 1.4, 20)], (0, 1)], 24
        ),
        "tube": tube(RING, 0.05, 9),
        "bar": bar((0, 0, 0), (0, 0, 1), [0.1, 0.2], 12),
        "sheet": sheet(np.stack([x, y, 0.2 * np.sin(5 * x)], -1), 0.01),
        "vase": vase(1.0),
        "plate": plate(1.0),
        "fruit": fruit(np.random.default_rng(0), 0.04, 1.0),
    }


def volume(mesh):
    corners = mesh.verts[np.where(mesh.faces < 0, mesh.faces[:, 2:3], mesh.faces)]
    a, b, c, d = corners.transpose(1, 0, 2)
    return (np.einsum("ij,ij->", a, np.cross(b, c)) + np.einsum("ij,ij->", a, np.cross(c, d))) / 6


def directed_edges(mesh):
    pairs = []
    for face in mesh.faces:
        ring = face[face >= 0]
        pairs += list(zip(ring, np.roll(ring, -1), strict=True))
    return pairs


@pytest.mark.parametrize("name", list(closed_shapes()))
def test_every_edge_of_a_closed_shape_is_walked_once_each_way(name):
    pairs = directed_edges(closed_shapes()[name])
    assert len(set(pairs)) == len(pairs)
    assert {(b, a) for a, b in pairs} == set(pairs)


@pytest.mark.parametrize("name", list(closed_shapes()))
def test_closed_shapes_are_turned_outwards(name):
    assert volume(closed_shapes()[name]) > 0


def test_volumes_are_those_of_the_formulas():
    assert volume(rounded_box((1, 2, 3), 0.001)) == pytest.approx(6, rel=1e-3)
    assert volume(closed_shapes()["ball"]) == pytest.approx(4 / 3 * np.pi, rel=0.02)
    assert volume(bar((0, 0, 0), (1, 2, 2), 0.1, 64)) == pytest.approx(3 * np.pi * 0.01, rel=0.01)


def test_a_rounded_box_keeps_its_size_and_its_radius():
    box = rounded_box((1.0, 2.0, 3.0), 0.2, 3)
    assert np.ptp(box.verts, axis=0) == pytest.approx([1, 2, 3])
    core = np.clip(box.verts, -np.array([0.3, 0.8, 1.3]), np.array([0.3, 0.8, 1.3]))
    assert np.linalg.norm(box.verts - core, axis=1) == pytest.approx(0.2)


def test_a_curve_passes_through_its_points():
    points = np.random.default_rng(2).normal(size=(5, 3))
    assert smooth_profile(points, 4 * 10 + 1)[::10] == pytest.approx(points, abs=1e-6)


def test_mirroring_and_turning_keep_the_volume():
    box = rounded_box((1, 2, 3), 0.1)
    assert volume(box.mirrored(0).turned("x", 33).turned("z", -70).moved(1, 2, 3)) == pytest.approx(
        volume(box)
    )


def test_a_grid_faces_along_columns_cross_rows():
    x, y = np.meshgrid([0.0, 1.0], [0.0, 1.0])
    assert face_normals(grid(np.stack([x, y, 0 * x], -1))) == pytest.approx(np.array([[0, 0, 1]]))


def test_furniture_has_no_face_without_area_at_any_detail():
    for detail in (0.2, 0.5, 1.0, 2.0):
        rng = np.random.default_rng(1)
        for mesh in (join([chair(detail)]), pillow(rng, 0.4, 0.2, detail), vase(detail)):
            assert np.linalg.norm(face_normals(mesh), axis=1).min() > 0.99
            assert mesh.faces.max() == len(mesh.verts) - 1
