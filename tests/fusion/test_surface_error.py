"""Distances to the true surface, alignment, and the commands that fuse and judge."""

import json
import re
import subprocess

import numpy as np
import pytest
from iclnuim.formats.png import write_png
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import write_trajectory
from judges import judge_module

pytest.importorskip("numba")
pytest.importorskip("embreex")
from iclnuim.benchmark.fusion.alignment import doubtful_pairs  # noqa: E402
from iclnuim.benchmark.fusion.pictures import picture  # noqa: E402
from iclnuim.benchmark.fusion.reconstruction import read_pairs, read_reconstruction  # noqa: E402
from iclnuim.benchmark.fusion.surface_error import SurfaceError, TrueSurface  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.formats.meshes import read_mesh  # noqa: E402
from iclnuim.formats.ply import write_ply  # noqa: E402
from iclnuim.headless import cli  # noqa: E402

#: A box, 2 x 2 x 1 m, seen from inside.
BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 1)], float)
SIDES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 7, 5],
        [4, 6, 7],
        [0, 5, 1],
        [0, 4, 5],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)


def on_the_box(rng, n=20_000):
    corners = BOX[SIDES[rng.integers(0, len(SIDES), n)]]
    shares = rng.dirichlet((1, 1, 1), n)
    return np.einsum("ni,nij->nj", shares, corners)


def test_points_on_the_surface_are_at_zero_and_others_at_their_distance():
    rng = np.random.default_rng(3)
    surface, points = TrueSurface(BOX, SIDES), on_the_box(rng)
    assert surface.error(points).distances_m.max() < 1e-6
    lifted = np.column_stack([rng.uniform(-0.4, 0.4, (1000, 2)), np.full(1000, 0.2)])
    np.testing.assert_allclose(surface.error(lifted).distances_m, 0.2, atol=1e-6)
    outside = np.array([[2.0, 2.0, 0.5]])
    assert surface.error(outside).distances_m[0] == pytest.approx(np.sqrt(2), abs=1e-6)


def test_the_shares_within_are_those_of_one_five_ten_and_fifty_millimetres():
    """One distance below and one above each of the four bounds."""
    distances_m = np.array([0.0009, 0.0011, 0.0049, 0.0051, 0.009, 0.011, 0.049, 0.051])
    within = SurfaceError(distances_m, SE3.identity()).to_dict()["within"]
    assert within == {"1mm": 1 / 8, "5mm": 3 / 8, "10mm": 5 / 8, "50mm": 7 / 8}


def test_the_fit_finds_the_motion_back():
    points, T = (
        on_the_box(np.random.default_rng(4)),
        SE3.exp(np.array([0.02, -0.03, 0.01, 0.02, 0.01, -0.03])),
    )
    moved = T.apply(points)
    surface = TrueSurface(BOX, SIDES)
    found = surface.aligned(moved, SE3.identity())
    np.testing.assert_allclose((found @ T).matrix, np.eye(4), atol=1e-4)
    assert surface.error(moved, found).statistics.mean < 1e-4


def test_a_plane_alone_cannot_be_fitted():
    surface = TrueSurface(BOX[:4], np.array([[0, 1, 3], [0, 3, 2]]))
    with pytest.raises(InputError, match="determine a motion"):
        surface.aligned(
            np.random.default_rng(1).uniform(0, 1, (100, 3)) * (0, 1, 1) - (1, 0, 0), SE3.identity()
        )


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("mesh.txt", "x", "a mesh"),
        ("mesh.ply", "ply\nnonsense", "PLY"),
        ("mesh.ply", None, "no such file"),
        (
            "mesh.off",
            "CNOFF\n2 0 0\n0 0 0 0 0 1 1 1 1 1\n",
            "2 of vertices, found the end of the file after 1",
        ),
        (
            "mesh.glb",
            "nonsense",
            "a glTF file from which Open3D reads a mesh, found other text",
        ),
    ],
)
def test_what_is_no_mesh_is_refused_in_words(tmp_path, name, text, match):
    if name.endswith(".glb"):
        judge_module("open3d", "open3d-cpu")
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("points", "match"),
    [
        (BOX * 0 + 1, "all vertices in one place"),
        (BOX * [1e300, 1, 1], r"at most 1e\+06 m, found 1e\+300 m"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_model_without_extent_or_far_away_is_refused(points, match):
    with pytest.raises(InputError, match=match):
        TrueSurface(points, SIDES)


def test_a_model_whose_vertices_are_nearly_all_in_one_place_gives_distances_and_no_warning():
    points = np.vstack([BOX, np.zeros((3000, 3))])
    triangles = np.vstack([SIDES, np.arange(8, 3008).reshape(-1, 3)])
    error = TrueSurface(points, triangles).error(BOX * 2)
    assert error.distances_m.max() > 0.9 and error.warnings == ()


@pytest.mark.parametrize("far_m", [2e6, 1e11])
@pytest.mark.filterwarnings("error")
def test_a_reconstruction_far_away_is_refused_with_the_file(tmp_path, far_m):
    write_ply(
        tmp_path / "far.ply", np.vstack([BOX, [[far_m, 0, 0]]]), np.vstack([SIDES, [0, 1, 8]])
    )
    with pytest.raises(
        InputError,
        match=r"far\.ply: expected coordinates of at most 1e\+06 m, found .*; try another unit",
    ):
        read_reconstruction(tmp_path / "far.ply")
    assert len(read_reconstruction(tmp_path / "far.ply", 1e5 / far_m).points) == 9


def test_pairs_are_read_whatever_a_comment_contains_and_too_few_name_the_file(
    tmp_path, command_here
):
    write_ply(tmp_path / "box.ply", BOX, SIDES)
    (tmp_path / "pairs.txt").write_text(
        "0 0 0 1 0 0  # corner\x85\u2028\x0cpicked twice\n1 0 0 2 0 0\n"
    )
    assert [points.tolist() for points in read_pairs(tmp_path / "pairs.txt")] == [
        [[0, 0, 0], [1, 0, 0]],
        [[1, 0, 0], [2, 0, 0]],
    ]
    box, pairs = tmp_path / "box.ply", tmp_path / "pairs.txt"
    code, _, error = command_here("evaluate", "surface", box, "--model", box, "--pairs", pairs)
    assert code == 2 and "pairs.txt: expected three or more pairs of points" in error


ROOM = np.vstack([BOX, BOX[[0, 1, 3, 2]] * (0.2, 0.3, 0.4) + (0.9, 0.4, 0)])
#: The box with a slanted panel in one corner, so that no reflection of it is itself.
ROOM_SIDES = np.vstack([SIDES, [[8, 9, 10], [8, 10, 11]]])


def in_the_room(rng, n=5000):
    corners = ROOM[ROOM_SIDES[rng.integers(0, len(ROOM_SIDES), n)]] + (5, 2, 0)
    return np.einsum("ni,nij->nj", rng.dirichlet((1, 1, 1), n), corners) + rng.normal(
        0, 0.001, (n, 3)
    )


@pytest.mark.parametrize(
    ("unit", "words", "factor"),
    [
        ("mm", "millimetres", 1000),
        ("cm", "centimetres", 100),
        ("in", "inches", 1 / 0.0254),
        ("ft", "feet", 1 / 0.3048),
    ],
)
def test_another_unit_is_named(unit, words, factor):
    surface, points = (
        TrueSurface(ROOM + (5, 2, 0), ROOM_SIDES),
        in_the_room(np.random.default_rng(1)),
    )
    (warning,) = surface.error(factor * points).warnings
    assert (
        f"seems to be in {words}, not in metres" in warning and f"set {{unit}} to {unit}" in warning
    )
    away = factor * (points + (50, 0, 0))
    assert (
        "times as large as the model" in surface.error(away).warnings[0]
        or unit in surface.error(away).warnings[0]
    )
    assert surface.error(points).warnings == ()


@pytest.mark.parametrize(
    ("unit", "words", "factor"),
    [
        ("mm", "millimetres", 1000),
        ("cm", "centimetres", 100),
        ("in", "inches", 1 / 0.0254),
        ("ft", "feet", 1 / 0.3048),
    ],
)
def test_another_unit_of_the_model_is_named_with_both_sizes(unit, words, factor):
    surface = TrueSurface(factor * (ROOM + (5, 2, 0)), ROOM_SIDES)
    points = in_the_room(np.random.default_rng(1))
    (warning,) = surface.error(points).warnings
    assert f"the model seems to be in {words}, not in metres" in warning
    assert re.search(r"reconstruction is 3\.\d+ m large and the model", warning)
    assert re.search(r"then 0\.\d+ mm instead of", warning)
    assert warning.endswith(f"set {{model_unit}} to {unit}")
    right = TrueSurface(ROOM + (5, 2, 0), ROOM_SIDES).error(points, model_unit_m=1 / factor)
    assert right.warnings == ()
    (warning,) = right_unit_of_metres(points, factor).warnings
    assert f"the model seems to be in metres, not in {words}" in warning


def right_unit_of_metres(points, factor):
    """A model in metres of which another unit was said."""
    surface = TrueSurface((ROOM + (5, 2, 0)) / factor, ROOM_SIDES)
    return surface.error(points, model_unit_m=1 / factor)


@pytest.mark.parametrize(("factor", "is_named"), [(300, False), (350, True)])
def test_a_model_of_more_than_a_kilometre_may_be_in_millimetres_like_its_reconstruction(
    factor, is_named
):
    surface = TrueSurface(factor * ROOM, ROOM_SIDES)
    warnings = surface.error(factor * (in_the_room(np.random.default_rng(1)) - (5, 2, 0))).warnings
    assert is_named == any("set {unit} and {model_unit} to mm" in text for text in warnings)


@pytest.mark.parametrize(
    ("given_m", "given", "true_m", "true", "setting"),
    [(0.001, "millimetres", 1.0, "metres", "m"), (0.01, "centimetres", 0.001, "millimetres", "mm")],
)
def test_the_advised_unit_is_that_of_the_file_also_if_another_was_given(
    given_m, given, true_m, true, setting
):
    surface, points = (
        TrueSurface(ROOM + (5, 2, 0), ROOM_SIDES),
        in_the_room(np.random.default_rng(1)),
    )
    (warning,) = surface.error(points / true_m * given_m, unit_m=given_m).warnings
    assert f"seems to be in {true}, not in {given}" in warning and warning.endswith(
        f"set {{unit}} to {setting}"
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_reconstruction_is_named(axis):
    surface, points = (
        TrueSurface(ROOM, ROOM_SIDES),
        in_the_room(np.random.default_rng(2)) - (5, 2, 0),
    )
    flipped = points * np.where(np.arange(3) == axis, -1, 1)
    (warning,) = surface.error(flipped).warnings
    assert "is mirrored" in warning and "check the handedness" in warning
    assert surface.error(points).warnings == ()


def test_a_bad_but_honest_reconstruction_is_given_no_other_unit_and_no_reflection():
    rng = np.random.default_rng(3)
    surface, points = TrueSurface(ROOM, ROOM_SIDES), in_the_room(rng) - (5, 2, 0)
    assert surface.error(points + rng.normal(0, 0.1, points.shape)).warnings == ()
    (moved,) = surface.error(points + (0.3, 0.2, 0.1)).warnings
    assert "another world frame" in moved and "its centre moved by 0.374 m" in moved
    assert surface.error(points[points[:, 0] < -0.5] + (0.04, 0, 0)).warnings == ()


@pytest.mark.parametrize("seed", range(4))
def test_a_reconstruction_in_another_world_frame_is_not_called_mirrored(seed):
    rng = np.random.default_rng(seed)
    surface, points = TrueSurface(ROOM, ROOM_SIDES), in_the_room(rng) - (5, 2, 0)
    points = points[points @ rng.normal(size=3) > 0]
    look = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)  # x right, y down, z forward
    T_first_world = SE3(look.T, np.zeros(3)) @ SE3.exp(np.r_[0, 0, 0, rng.normal(0, 0.3, 3)])
    warnings = surface.error(T_first_world.apply(points - (0.3, -0.5, 0.6))).warnings
    assert "mirrored" not in "".join(warnings)


def test_a_reconstruction_far_off_is_advised_to_give_its_trajectory():
    surface, points = (
        TrueSurface(ROOM, ROOM_SIDES),
        in_the_room(np.random.default_rng(4)) - (5, 2, 0),
    )
    rotation = SE3.exp(np.array([0, 0, 0, 1.5, 0.9, 0.5]))
    (warning,) = surface.error(rotation.apply(points + (0.5, 2.0, 1.0))).warnings
    assert (
        "another world frame" in warning
        and "set {poses} to" in warning
        and "and {truth} to" in warning
    )


def test_a_picture_looks_into_the_room_from_outside():
    image = picture(BOX, SIDES, np.tile(np.uint8([200, 0, 0]), (8, 1)), 80, 60)
    assert image.shape == (60, 80, 3)
    shown = (image != 255).any(axis=-1)
    assert 0.2 < shown.mean() < 0.9
    assert (image[shown][:, 1] == 0).all()


@pytest.fixture
def sequence(tmp_path, camera, looking_at):
    """Ten views of the box from inside, as a TUM sequence; and the box as a PLY."""
    open3d = judge_module("open3d", "open3d-cpu")

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(BOX.astype(np.float32)), open3d.core.Tensor(SIDES.astype(np.uint32))
    )
    folder, poses = tmp_path / "box", []
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for i in range(10):
        angle = 0.25 * i
        poses.append(
            looking_at(
                np.array([-0.3 * np.cos(angle), -0.3 * np.sin(angle), 0.6]),
                (np.cos(angle), np.sin(angle), 0.2),
            )
        )
        rays = np.concatenate(
            [
                np.broadcast_to(poses[-1].translation, (120, 160, 3)),
                camera.rays() @ poses[-1].rotation.T,
            ],
            -1,
        )
        depth = scene.cast_rays(open3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
        write_png(folder / f"depth/{i:06}.png", (depth * 5000 + 0.5).astype(np.uint16))
        write_png(folder / f"rgb/{i:06}.png", np.full((120, 160, 3), (40, 80, 120), np.uint8))
    (folder / "camera.json").write_text(json.dumps(camera.to_dict()))
    write_trajectory(
        folder / "groundtruth.txt",
        Trajectory.at_rate(SE3.from_matrix(np.array([T.matrix for T in poses]))),
        "tum",
    )
    write_ply(tmp_path / "model.ply", BOX.astype(np.float32), SIDES.astype(np.int32))
    return folder


@pytest.fixture
def icl(tmp_path, monkeypatch, capsys):
    """`icl(*argv)` runs a command in this process, in the test's folder."""
    monkeypatch.chdir(tmp_path)

    def run(*argv):
        capsys.readouterr()
        code = cli.main([str(word) for word in argv])
        return subprocess.CompletedProcess(argv, code, *capsys.readouterr())

    return run


def test_a_sequence_is_fused_and_judged_by_the_commands(sequence, tmp_path, icl):
    fused = icl("fuse", sequence, "-o", "box.ply", "--plot", "box.png", "--json")
    assert fused.returncode == 0, fused.stderr
    figures = json.loads(fused.stdout)
    assert figures["frames"] == 10
    assert figures["memory_mb"] < 200
    assert (
        json.loads((tmp_path / "box.json").read_text())["settings"]["volume"]["truncation_m"]
        == 0.045
    )
    assert (tmp_path / "box.png").stat().st_size > 1000
    judged = icl(
        "evaluate", "surface", "box.ply", "--model", "model.ply", "--plot", "error.png", "--json"
    )
    assert judged.returncode == 0, judged.stderr
    assert json.loads(judged.stdout)["distance_m"]["mean"] < 0.001
    assert (tmp_path / "error.png").stat().st_size > 1000


def test_a_surface_in_the_first_cameras_frame_is_laid_on_the_model_by_the_first_poses(
    sequence, tmp_path, icl
):
    from iclnuim.trajectory_files.trajectories import read_trajectory

    truth = read_trajectory(sequence / "groundtruth.txt").trajectory
    own = Trajectory(truth.stamps_s, truth.T_world_camera[0].inverse() @ truth.T_world_camera)
    write_trajectory(tmp_path / "est.txt", own, "tum")
    assert icl("fuse", sequence, "--poses", "est.txt", "-o", "own.ply").returncode == 0
    laid = ("--poses", "est.txt", "--truth", sequence / "groundtruth.txt")
    errors, warnings = [], []
    for options in (laid, ()):
        judged = icl("evaluate", "surface", "own.ply", "--model", "model.ply", "--json", *options)
        errors.append(json.loads(judged.stdout)["distance_m"]["mean"])
        warnings.append(json.loads(judged.stdout)["warnings"])
    assert errors[0] < 0.001 < 0.05 < errors[1]
    assert (
        not warnings[0]
        and "set --poses to" in warnings[1][0]
        and "and --truth to its ground truth" in warnings[1][0]
    )


def test_the_command_takes_a_point_cloud_and_a_unit_and_warns(tmp_path, icl):
    points = in_the_room(np.random.default_rng(5)) - (5, 2, 0)
    write_ply(tmp_path / "model.ply", ROOM.astype(np.float32), ROOM_SIDES.astype(np.int32))
    write_ply(tmp_path / "cloud.ply", points.astype(np.float32))
    write_ply(tmp_path / "mm.ply", 1000 * points.astype(np.float32))
    write_ply(tmp_path / "mirrored.ply", points.astype(np.float32) * (-1, 1, 1))
    found = {}
    for name, *options in (
        ("cloud.ply", "--plot", "error.png"),
        ("mm.ply",),
        ("mm.ply", "--unit", "mm"),
        ("mirrored.ply",),
    ):
        done = icl("evaluate", "surface", name, "--model", "model.ply", "--json", *options)
        assert done.returncode == 0, done.stderr
        found[name, *options[:1]] = json.loads(done.stdout)
    assert (
        found["cloud.ply", "--plot"]["distance_m"]["mean"] < 0.001
        and (tmp_path / "error.png").stat().st_size > 1000
    )
    assert found["mm.ply",]["warnings"][0].endswith("set --unit to mm")
    assert (
        found["mm.ply", "--unit"]["distance_m"]["mean"] < 0.001
        and found["mm.ply", "--unit"]["warnings"] == []
    )
    assert "mirrored" in found["mirrored.ply",]["warnings"][0]
    assert (
        "warning: the reconstruction is mirrored"
        in icl("evaluate", "surface", "mirrored.ply", "--model", "model.ply").stdout
    )


@pytest.mark.parametrize("unit", ["mm", "0.001", "inch", "foot"])
def test_the_unit_of_the_model_is_set_or_advised(tmp_path, icl, unit):
    factor = {"inch": 1 / 0.0254, "foot": 1 / 0.3048}.get(unit, 1000)
    write_ply(tmp_path / "mesh.ply", BOX.astype(np.float32), SIDES.astype(np.int32))
    write_ply(tmp_path / "model.ply", (factor * BOX).astype(np.float32), SIDES.astype(np.int32))
    words = ("evaluate", "surface", "mesh.ply", "--model", "model.ply", "--samples", "2000")
    found = json.loads(icl(*words, "--json").stdout)
    short = {"inch": "in", "foot": "ft"}.get(unit, "mm")
    assert found["warnings"][0].endswith(f"set --model-unit to {short}")
    found = json.loads(icl(*words, "--model-unit", unit, "--json").stdout)
    assert found["distance_m"]["mean"] < 1e-6 and found["warnings"] == []


@pytest.mark.parametrize(
    ("model", "unit", "words"),
    [
        ("mesh.ply", "furlong", "a unit"),
        ("mesh.ply", "0", "--model-unit: expected 1e-06"),
        ("mesh.ply", "nan", "--model-unit: expected 1e-06"),
        ("living_room", "mm", "a mesh file .* with --model-unit, found living_room"),
    ],
)
def test_a_unit_that_no_model_has_is_refused(tmp_path, icl, model, unit, words):
    write_ply(tmp_path / "mesh.ply", BOX.astype(np.float32), SIDES.astype(np.int32))
    done = icl("evaluate", "surface", "mesh.ply", "--model", model, "--model-unit", unit)
    assert done.returncode == 2 and re.search(words, done.stderr)


def test_a_mesh_has_the_same_vertices_in_every_format(tmp_path):
    corners = BOX[SIDES]
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t)
        + "endloop\nendfacet\n"
        for t in corners.tolist()
    )
    (tmp_path / "box.stl").write_text(f"solid box\n{facets}endsolid box\n")
    points, triangles, _ = read_mesh(tmp_path / "box.stl")
    assert len(points) == len(BOX) and np.allclose(points[triangles], corners)


@pytest.mark.parametrize(
    ("points", "match"),
    [([], "with points, found none"), ([[0, 0, float("nan")]], "NaN or infinity in 1 of 1")],
)
def test_empty_clouds_and_nan_points_are_refused_in_one_line(tmp_path, points, match, icl):
    write_ply(tmp_path / "cloud.ply", np.array(points, np.float32).reshape(-1, 3))
    write_ply(tmp_path / "model.ply", BOX.astype(np.float32), SIDES.astype(np.int32))
    done = icl("evaluate", "surface", "cloud.ply", "--model", "model.ply")
    assert (
        done.returncode == 2 and match in done.stderr and len(done.stderr.strip().splitlines()) == 1
    )


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (("-o", "m.obj"), "ply"),
        (("-o", "m.ply", "--plot", "m.jpg"), "png"),
        (("-o", "nowhere/m.ply"), "folder to write into"),
        (("-o", "m.ply", "--preset", "other"), "a preset"),
        (("-o", "m.ply", "--poses", "far.txt"), "images that have a pose"),
        (("-o", "m.ply", "--voxel", "-1"), "--voxel"),
        (("-o", "m.ply", "--max-blocks", "99999999999"), "--max-blocks"),
    ],
)
def test_fuse_says_in_one_line_what_it_cannot_use(sequence, tmp_path, options, match, icl):
    (tmp_path / "far.txt").write_text("1000 0 0 0 0 0 0 1\n1001 0 0 0 0 0 0 1\n")
    done = icl("fuse", sequence, "--quiet", *options)
    assert done.returncode == 2
    assert match in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_bad_image_in_a_folder_called_blocks_is_left_out(sequence, tmp_path, icl):
    folder = sequence.rename(tmp_path / "blocks")
    (folder / "rgb/000003.png").write_bytes(b"no picture")
    fused = icl("fuse", folder, "-o", "box.ply", "--json")
    assert fused.returncode == 0, fused.stderr
    figures = json.loads(fused.stdout)
    assert figures["frames"] == 9 and figures["left_out"] == 1
    assert "left out" in fused.stderr and "000003.png" in fused.stderr


def test_too_little_memory_ends_the_work(sequence, icl):
    fused = icl("fuse", sequence, "-o", "box.ply", "--max-blocks", "3")
    assert fused.returncode == 2
    assert "expected a frame within 3 blocks" in fused.stderr


def test_an_assumed_camera_is_named_before_the_work(sequence, icl):
    (sequence / "camera.json").unlink()
    for kind, channels in (("rgb", (3,)), ("depth", ())):
        for i in range(10):
            write_png(
                sequence / f"{kind}/{i:06}.png",
                np.full((480, 640, *channels), 9000, np.uint16).astype(
                    np.uint8 if channels else np.uint16
                ),
            )
    fused = icl("fuse", sequence, "-o", "box.ply", "--frames", ":2")
    assert fused.returncode == 0, fused.stderr
    assert fused.stderr.index("the benchmark's camera is assumed") < fused.stderr.index("fuse:")


def test_vertices_that_no_face_uses_do_not_count(tmp_path):
    write_ply(tmp_path / "crop.ply", np.vstack([BOX, [[1e9, 0, 0]]]), SIDES)
    found = read_reconstruction(tmp_path / "crop.ply")
    assert len(found.points) == len(BOX) and "1 vertices that no face uses" in found.notes[0]
    assert np.array_equal(found.triangles, SIDES)


Z_UP_FROM_Y_UP = SE3.exp(np.array([0, 0, 0, np.pi / 2, 0, 0]))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda points: Z_UP_FROM_Y_UP.inverse().apply(points), "turned by 90 degrees"),
        (lambda points: 1.5 * points, "multiplied by 0.66"),
        (lambda points: points / 3 + (1, 2, 0), "multiplied by "),
        (lambda points: SE3.exp(np.array([3, 0.2, 1, 0.3, 0.5, 2.1])).apply(points), "turned by"),
    ],
)
def test_another_world_is_named_with_the_distance_that_fits(changed, words):
    surface, points = (
        TrueSurface(ROOM, ROOM_SIDES),
        in_the_room(np.random.default_rng(3)) - (5, 2, 0),
    )
    (warning,) = surface.error(changed(points)).warnings
    assert words in warning and re.search(r"distance is (0\.\d+|[1-4]\.\d+) mm instead", warning)


def test_an_inverted_motion_is_named():
    surface, points = (
        TrueSurface(ROOM, ROOM_SIDES),
        in_the_room(np.random.default_rng(3)) - (5, 2, 0),
    )
    T = SE3.exp(np.array([1, -0.5, 0.3, 0.2, 0.3, 1.2]))
    (warning,) = surface.error(T.inverse().apply(points), T.inverse()).warnings
    assert "with the inverse of the given motion" in warning


def test_picked_pairs_that_do_not_belong_together_are_named():
    model = np.random.default_rng(1).uniform(-2, 2, (5, 3))
    mesh = SE3.exp(np.array([1, 0, 2, 0.1, 0.4, 0])).apply(model)
    assert doubtful_pairs(mesh, model) == ""
    assert "lines 2, 1, 3, 4, 5" in doubtful_pairs(mesh, model[[1, 0, 2, 3, 4]])
    assert "multiplied by 0.5" in doubtful_pairs(2 * mesh, model)
    other = np.random.default_rng(2).uniform(-2, 2, (5, 3))
    assert "check their order" in doubtful_pairs(other, model)
