"""Labels on a reconstruction: by area of what was seen, whatever the density of the meshes."""

import json

import numpy as np
import pytest
from iclnuim.benchmark.fusion.labels import TrueLabels, label_samples, surface_labels
from iclnuim.benchmark.fusion.quality import SeenBy, what_was_seen
from iclnuim.benchmark.fusion.reconstruction import read_reconstruction
from iclnuim.benchmark.fusion.settings import QualitySettings
from iclnuim.benchmark.fusion.surface_error import TrueSurface
from iclnuim.errors import InputError
from iclnuim.formats.ply import MeshLabels, read_ply_labels, write_ply
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

pytest.importorskip("igl")
CORNERS = np.array([[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 2.0)])
#: Two triangles of each side of a room: x = 0, x = 4, y = 0, y = 3, floor, ceiling.
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
    + [[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)
#: Ours: walls but for a door and a window, a floor and a ceiling.
CLASSES = np.repeat([1, 4, 5, 1, 2, 3], 2)
SETTINGS = QualitySettings(samples=40_000)


def divided(points, triangles, labels, times=1):
    """Each triangle as four."""
    for _ in range(times):
        a, b, c = np.moveaxis(points[triangles], 1, 0)
        d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        points = np.concatenate([np.stack(part, 1) for part in parts]).reshape(-1, 3)
        triangles = np.arange(len(points)).reshape(-1, 3)
        labels = np.tile(labels, 4)
    return points, triangles, labels


def evaluated(path, points, triangles, labels, seen=None, classes="ours", **given):
    """The errors of a mesh with labels of its faces, by way of its file."""
    write_ply(path, points, triangles, face_values={"class": np.asarray(labels)})
    surface = TrueSurface(CORNERS, SIDES)
    truth = TrueLabels.of_mesh(MeshLabels(CLASSES, True))
    mesh = read_reconstruction(path, labelled=True)
    T = given.get("T", SE3.identity())
    if isinstance(seen, SeenBy):
        seen = what_was_seen(surface, seen, SETTINGS)
    return surface_labels(surface, truth, mesh, T, label_samples(surface, seen, SETTINGS), classes)


def test_a_perfect_surface_has_one_and_areas_are_those_of_the_sides(tmp_path):
    found = evaluated(tmp_path / "a.ply", CORNERS, SIDES, CLASSES)
    assert found.figures.mean_iou == found.figures.pixel_accuracy == 1
    shares = found.figures.truth / found.figures.truth.sum()
    areas_m2 = np.array([0, 6 + 8, 12, 12, 6, 8])
    assert np.abs(shares[:6] - areas_m2 / 52).max() < 1e-3


def test_figures_are_those_of_areas_at_any_density(tmp_path):
    """One of two triangles of the door is a wall, one of the floor has no label."""
    labels = CLASSES.copy()
    labels[[2, 8]] = (1, 0)
    expected = np.mean([14 / 17, 0.5, 1, 0.5, 1])  # wall, floor, ceiling, door, window
    for times in range(6):
        mesh = divided(CORNERS, SIDES, labels, times)
        found = evaluated(tmp_path / "a.ply", *mesh)
        assert found.figures.mean_iou == pytest.approx(expected, rel=0.005)
        assert found.figures.unlabelled == pytest.approx(6 / 52, rel=0.005)
    fine = divided(CORNERS, SIDES[:6], labels[:6], 4)
    points = np.concatenate([CORNERS, fine[0]])
    triangles = np.concatenate([SIDES[6:], fine[1] + len(CORNERS)])
    uneven = evaluated(tmp_path / "a.ply", points, triangles, np.concatenate([labels[6:], fine[2]]))
    assert uneven.figures.mean_iou == pytest.approx(expected, rel=0.005)


def test_a_dense_mesh_may_have_labels_of_its_vertices(tmp_path):
    points, triangles, labels = divided(CORNERS, SIDES, CLASSES, 6)
    path = tmp_path / "a.ply"
    at = np.repeat(labels, 3)
    rows = [f"{x} {y} {z} {label}" for (x, y, z), label in zip(points, at, strict=True)]
    faces = [f"3 {a} {b} {c}" for a, b, c in triangles]
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "property float x\nproperty float y\nproperty float z\nproperty uchar label\n"
    face = f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    for ending in (head + face, head + "end_header\n"):
        path.write_text(ending + "\n".join(rows + faces * ("face" in ending)) + "\n")
        mesh = read_reconstruction(path, labelled=True)
        assert mesh.labels is not None and not mesh.labels.of_triangles
        truth = TrueLabels.of_mesh(MeshLabels(CLASSES, True))
        surface = TrueSurface(CORNERS, SIDES)
        samples_m = label_samples(surface, None, SETTINGS)
        found = surface_labels(surface, truth, mesh, SE3.identity(), samples_m)
        assert found.figures.mean_iou > 0.95


def test_only_what_was_seen_counts_and_what_is_missing_is_wrong(tmp_path):
    """A camera in the middle looks at the door, at x = 4."""
    pose = SE3(np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), [2, 1.5, 1])
    camera = PinholeCamera(64, 48, 200.0, 200.0, 31.5, 23.5)
    seen = SeenBy(camera, SE3(pose.rotation[None], pose.translation[None]))
    labels = np.where(CLASSES == 4, 4, 7)
    found = evaluated(tmp_path / "a.ply", CORNERS, SIDES, labels, seen)
    assert found.figures.mean_iou == 1 and found.figures.truth[4] == found.figures.truth.sum()
    without_door = np.flatnonzero(CLASSES != 4)
    found = evaluated(tmp_path / "a.ply", CORNERS, SIDES[without_door], labels[without_door], seen)
    assert found.figures.mean_iou == 0 and found.figures.unlabelled == 1


def test_a_label_counts_within_five_centimetres(tmp_path):
    for off_m, unlabelled in ((0.04, 0), (0.06, 1)):
        points = CORNERS + np.where(CORNERS > 0, off_m, -off_m)
        found = evaluated(tmp_path / "a.ply", points, SIDES, CLASSES)
        assert found.figures.unlabelled == unlabelled
    moved = SE3(np.eye(3), [1.0, 2, 3])
    found = evaluated(tmp_path / "a.ply", CORNERS - moved.translation, SIDES, CLASSES, T=moved)
    assert found.figures.mean_iou == 1


def test_labels_are_read_in_other_numberings_and_unknown_ones_named(tmp_path):
    nyu40 = np.array([0, 1, 2, 22, 8, 9])[CLASSES]
    found = evaluated(tmp_path / "a.ply", CORNERS, SIDES, nyu40, classes="nyu40")
    assert found.figures.mean_iou == 1
    nyu40[0] = 77
    found = evaluated(tmp_path / "a.ply", CORNERS, SIDES, nyu40, classes="nyu40")
    assert [name for name, _ in found.unknown] == ["77"] and found.figures.mean_iou < 1


def test_classes_of_a_scene_are_known_by_their_names(tmp_path):
    """Also own ones, numbered from 1000 in alphabetical order, and objects without a class."""
    names = ("wall", "zebra", "", "bed", "floor", "ceiling")
    truth = TrueLabels.of_names(names, np.repeat(np.arange(6), 2))
    assert [kind.id for kind in truth.kinds] == [1, 1001, 0, 1000, 2, 3]
    surface = TrueSurface(CORNERS, SIDES)
    for classes, ids, without in (
        ("ours", [1, 1001, 7, 1000, 2, 3], set()),
        ("nyu40", [1, 7, 7, 4, 2, 22], {"zebra"}),
    ):
        path = tmp_path / "a.ply"
        write_ply(path, CORNERS, SIDES, face_values={"label": np.repeat(ids, 2)})
        mesh = read_reconstruction(path, labelled=True)
        samples_m = label_samples(surface, None, SETTINGS)
        found = surface_labels(surface, truth, mesh, SE3.identity(), samples_m, classes)
        assert found.figures.mean_iou == 1 and not found.unknown
        assert {name for name, _ in found.without} == without


def test_labels_of_polygons_are_those_of_their_triangles(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
        "property float z\nelement face 4\nproperty list uchar int vertex_indices\n"
        "property float label\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\nnan 2 0\n"
        "4 0 1 2 3 7\n3 0 1 2 8\n3 0 1 4 9\n3 1 2 3 2.5\n"
    )
    assert read_ply_labels(path).values.tolist() == [7, 7, 8, 9, -1]
    mesh = read_reconstruction(path, labelled=True)
    assert mesh.labels.values.tolist() == [7, 7, 8, -1] and len(mesh.triangles) == 4


def test_the_command_compares_labels_with_a_labelled_model(tmp_path, command_here):
    model, path = tmp_path / "model.ply", tmp_path / "mesh.ply"
    write_ply(model, CORNERS, SIDES, face_values={"class": CLASSES})
    write_ply(path, CORNERS, SIDES, face_values={"class": np.where(CLASSES == 3, 1, CLASSES)})
    options = ("evaluate", "surface", path, "--model", model, "--labels", "--samples", 20_000)
    code, text, _ = command_here(*options, "--seen-by", "all", "--json")
    values = json.loads(text)["labels"]
    assert code == 0 and values["mean_iou"] == pytest.approx(
        (14 / 26 + 0 + 1 + 1 + 1) / 5, abs=3e-3
    )
    code, text, _ = command_here(*options, "--seen-by", "all")
    assert code == 0 and "mean IoU" in text and "3 ceiling" in text
    code, _, error = command_here(*options)
    assert code == 2 and "--labels with --seen-by" in error and len(error.splitlines()) == 1


def test_meshes_without_labels_are_refused_in_one_line(tmp_path, command_here):
    path = tmp_path / "a.ply"
    write_ply(path, CORNERS, SIDES)
    with pytest.raises(InputError, match="a property of faces or vertices named class, class_id"):
        read_reconstruction(path, labelled=True)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="of the faces or vertices of a .ply, found .obj"):
        read_reconstruction(tmp_path / "a.obj", labelled=True)
    with pytest.raises(InputError, match="a model labelled in our numbering, found 48"):
        TrueLabels.of_mesh(MeshLabels(np.array([48]), True))
    with pytest.raises(InputError, match="labels of its faces, found labels of its vertices"):
        TrueLabels.of_mesh(MeshLabels(np.array([1]), False))
