"""Distances to the true surface, alignment, and the commands that fuse and judge."""

import json
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.formats.png import write_png
from iclnuim.formats.trajectories import write_trajectory
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

pytest.importorskip("numba")
pytest.importorskip("open3d")
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.formats.ply import write_ply  # noqa: E402
from iclnuim.fusion.models import read_mesh  # noqa: E402
from iclnuim.fusion.shading import picture  # noqa: E402
from iclnuim.fusion.surface_error import Judge  # noqa: E402

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
    judge, points = Judge(BOX, SIDES), on_the_box(rng)
    assert judge.error(points).distances_m.max() < 1e-6
    lifted = np.column_stack([rng.uniform(-0.4, 0.4, (1000, 2)), np.full(1000, 0.2)])
    np.testing.assert_allclose(judge.error(lifted).distances_m, 0.2, atol=1e-6)
    outside = np.array([[2.0, 2.0, 0.5]])
    assert judge.error(outside).distances_m[0] == pytest.approx(np.sqrt(2), abs=1e-6)


def test_the_fit_finds_the_motion_back():
    points, T = on_the_box(np.random.default_rng(4)), SE3.exp(np.array([0.02, -0.03, 0.01, 0.02, 0.01, -0.03])).matrix
    moved = points @ T[:3, :3].T + T[:3, 3]
    judge = Judge(BOX, SIDES)
    found = judge.refined(moved, np.eye(4))
    np.testing.assert_allclose(found @ T, np.eye(4), atol=1e-4)
    assert judge.error(moved, found).statistics.mean < 1e-4


def test_a_plane_alone_cannot_be_fitted():
    judge = Judge(BOX[:4], np.array([[0, 1, 3], [0, 3, 2]]))
    with pytest.raises(InputError, match="fix a motion"):
        judge.refined(np.random.default_rng(1).uniform(0, 1, (100, 3)) * (0, 1, 1) - (1, 0, 0), np.eye(4))


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("mesh.txt", "x", "a mesh"),
        ("mesh.ply", "ply\nnonsense", "triangles"),
        ("mesh.ply", None, "nothing of that name"),
    ],
)
def test_what_is_no_mesh_is_refused_in_words(tmp_path, name, text, match):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=match):
        read_mesh(tmp_path / name)


def test_a_picture_looks_into_the_room_from_outside():
    image = picture(BOX, SIDES, np.tile(np.uint8([200, 0, 0]), (8, 1)), 80, 60)
    assert image.shape == (60, 80, 3)
    shown = (image != 255).any(axis=-1)
    assert 0.2 < shown.mean() < 0.9
    assert (image[shown][:, 1] == 0).all()


@pytest.fixture
def sequence(tmp_path, camera, looking_at):
    """Ten views of the box from inside, as a TUM sequence; and the box as a PLY."""
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.core.Tensor(BOX.astype(np.float32)), open3d.core.Tensor(SIDES.astype(np.uint32)))
    folder, poses = tmp_path / "box", []
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for i in range(10):
        angle = 0.25 * i
        poses.append(
            looking_at(np.array([-0.3 * np.cos(angle), -0.3 * np.sin(angle), 0.6]), (np.cos(angle), np.sin(angle), 0.2))
        )
        rays = np.concatenate(
            [np.broadcast_to(poses[-1][:3, 3], (120, 160, 3)), camera.rays() @ poses[-1][:3, :3].T], -1
        )
        depth = scene.cast_rays(open3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
        write_png(folder / f"depth/{i:06}.png", (depth * 5000 + 0.5).astype(np.uint16))
        write_png(folder / f"rgb/{i:06}.png", np.full((120, 160, 3), (40, 80, 120), np.uint8))
    (folder / "camera.json").write_text(json.dumps(camera.to_dict()))
    write_trajectory(folder / "groundtruth.txt", Trajectory.at_rate(SE3.from_matrix(np.array(poses))), "tum")
    write_ply(tmp_path / "model.ply", BOX.astype(np.float32), SIDES.astype(np.int32))
    return folder


def icl(*args, cwd):
    command = [sys.executable, "-m", "iclnuim", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd)


def test_a_sequence_is_fused_and_judged_by_the_commands(sequence, tmp_path):
    fused = icl("fuse", sequence, "-o", "box.ply", "--plot", "box.png", "--json", cwd=tmp_path)
    assert fused.returncode == 0, fused.stderr
    figures = json.loads(fused.stdout)
    assert figures["frames"] == 10
    assert figures["memory_mb"] < 200
    assert json.loads((tmp_path / "box.json").read_text())["settings"]["volume"]["truncation_m"] == 0.045
    assert (tmp_path / "box.png").stat().st_size > 1000
    judged = icl(
        "evaluate", "surface", "box.ply", "--model", "model.ply", "--plot", "error.png", "--json", cwd=tmp_path
    )
    assert judged.returncode == 0, judged.stderr
    assert json.loads(judged.stdout)["distance_m"]["mean"] < 0.001
    assert (tmp_path / "error.png").stat().st_size > 1000


def test_a_surface_in_the_first_cameras_frame_is_laid_on_the_model_by_the_first_poses(sequence, tmp_path):
    from iclnuim.formats.trajectories import read_trajectory

    truth = read_trajectory(sequence / "groundtruth.txt").trajectory
    own = Trajectory(truth.stamps_s, truth.T_world_camera[0].inverse() @ truth.T_world_camera)
    write_trajectory(tmp_path / "est.txt", own, "tum")
    assert icl("fuse", sequence, "--poses", "est.txt", "-o", "own.ply", cwd=tmp_path).returncode == 0
    laid = ("--poses", "est.txt", "--truth", sequence / "groundtruth.txt")
    errors = []
    for options in (laid, ()):
        judged = icl("evaluate", "surface", "own.ply", "--model", "model.ply", "--json", *options, cwd=tmp_path)
        errors.append(json.loads(judged.stdout)["distance_m"]["mean"])
    assert errors[0] < 0.001 < 0.05 < errors[1]


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (("-o", "m.obj"), "ply"),
        (("-o", "nowhere/m.ply"), "folder to write into"),
        (("-o", "m.ply", "--preset", "other"), "a preset"),
        (("-o", "m.ply", "--poses", "far.txt"), "images that have a pose"),
        (("-o", "m.ply", "--voxel", "-1"), "voxels"),
    ],
)
def test_fuse_says_in_one_line_what_it_cannot_use(sequence, tmp_path, options, match):
    (tmp_path / "far.txt").write_text("1000 0 0 0 0 0 0 1\n1001 0 0 0 0 0 0 1\n")
    done = icl("fuse", sequence, "--quiet", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert match in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
