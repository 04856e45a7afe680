"""Distances in double precision; accuracy, completion, F and Depth L1 of what a trajectory saw, and
the traps that they avoid.
"""

import numpy as np
import pytest
from iclnuim import shipped
from iclnuim.errors import InputError
from iclnuim.formats.ply import write_ply
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

pytest.importorskip("embreex")
pytest.importorskip("igl")
from iclnuim.benchmark.fusion.alignment import pairs_transform  # noqa: E402
from iclnuim.benchmark.fusion.quality import SeenBy, surface_quality, what_was_seen  # noqa: E402
from iclnuim.benchmark.fusion.reconstruction import read_reconstruction  # noqa: E402
from iclnuim.benchmark.fusion.samples import CELL_M, areas_m2, sampled, thinned  # noqa: E402
from iclnuim.benchmark.fusion.settings import QualitySettings  # noqa: E402
from iclnuim.benchmark.fusion.surface_error import TrueSurface  # noqa: E402
from iclnuim.blender.open.model_file import read_model  # noqa: E402
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.distance import TriangleDistance  # noqa: E402
from iclnuim.raycast.visibility import seen_points  # noqa: E402


def rectangle(corner, along, across, cells=1):
    """A rectangle in cells x cells squares of two triangles."""
    i, j = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    points = np.array(corner, float) + np.outer(i / cells, along) + np.outer(j / cells, across)
    at = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    step = cells + 1
    return points, np.vstack(
        [np.c_[at, at + step, at + 1], np.c_[at + 1, at + step, at + step + 1]]
    )


def joined(*meshes):
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    return np.vstack([p for p, _ in meshes]), np.vstack(
        [t + s for (_, t), s in zip(meshes, starts, strict=False)]
    )


def box(low, high, cells=1):
    low, size = np.array(low, float), np.subtract(high, low)
    x, y, z = np.diag(size)
    sides = [
        (low, x, y),
        (low, y, z),
        (low, z, x),
        (low + z, x, y),
        (low + x, y, z),
        (low + y, z, x),
    ]
    return joined(*(rectangle(*side, cells) for side in sides))


#: A room of 4 x 4 x 2.5 m with a chest and a board before a wall, in large triangles.
ROOM = joined(
    box((-2, -2, 0), (2, 2, 2.5)),
    box((0.8, -0.4, 0), (1.4, 0.5, 0.7)),
    box((1.95, 0.8, 1), (2, 1.6, 1.6)),
)
SMALL = QualitySettings(samples=20_000, every=1)
CAMERA = PinholeCamera.parse("160x120")


@pytest.fixture(scope="module")
def surface():
    return TrueSurface(*ROOM)


@pytest.fixture
def ahead(looking_at):
    """Five poses near the middle of the room that look at the side of +x."""
    poses = [looking_at(np.array([-0.5, 0.2 * k, 1.2]), (1, 0.5 * k, 1.1)) for k in range(-2, 3)]
    return SeenBy(CAMERA, SE3.from_matrix(np.array([T.matrix for T in poses])))


def brute_force(points, corners):
    """(n,) distances in double precision: to planes where the foot is inside, else to the three
    edges.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    best = []
    for p in points:
        inside = np.ones(len(a), bool)
        edges = []
        for start, end in ((a, b), (b, c), (c, a)):
            along = end - start
            inside &= (np.cross(along, p - start) * normal).sum(1) >= 0
            share = np.clip(((p - start) * along).sum(1) / (along**2).sum(1), 0, 1)[:, None]
            edges.append(np.linalg.norm(p - start - share * along, axis=1))
        plane = np.abs(((p - a) * normal).sum(1))
        best.append(min(np.min(edges), plane[inside].min(initial=np.inf)))
    return np.array(best)


@pytest.mark.parametrize("slab", [10**6, 50])
def test_distances_are_those_of_brute_force_also_in_slabs(slab):
    rng = np.random.default_rng(5)
    corners = rng.uniform(-1, 1, (400, 1, 3)) + rng.normal(0, 0.2, (400, 3, 3))
    points = np.vstack(
        [rng.uniform(-2, 2, (100, 3)), corners[::4].mean(1) + rng.normal(0, 1e-3, (100, 3))]
    )
    to = TriangleDistance(corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3), slab)
    found = to.nearest(points)
    np.testing.assert_allclose(found.distance_m, brute_force(points, corners), atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(points - found.point_m, axis=1), found.distance_m, atol=1e-12
    )
    chosen = TriangleDistance(
        corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)[found.triangle[:1]]
    )
    assert chosen.distance(points[:1]) == pytest.approx(found.distance_m[:1])


def test_a_perfect_reconstruction_has_no_error_and_all_of_what_was_seen(surface, ahead):
    found = surface_quality(surface, *ROOM, seen_by=ahead, settings=SMALL)
    assert found.accuracy_m < 1e-9 and found.completion_m < 1e-9 and found.depth_l1_m < 1e-6
    assert found.precision(0.01) == found.recall(0.01) == found.f_score(0.01) == 1
    assert found.to_dict()["recall"] == {"1cm": 1.0, "2cm": 1.0, "5cm": 1.0}
    assert abs(len(found.model_m) - SMALL.samples) < 0.1 * SMALL.samples


def test_what_lies_behind_the_camera_or_is_hidden_never_counts(surface, ahead):
    without = joined(rectangle((2, -2, 0), (0, 4, 0), (0, 0, 2.5)))  # the wall ahead alone
    found = surface_quality(surface, *without, seen_by=ahead, settings=SMALL)
    points = sampled(*ROOM, 20_000, 1)
    seen = points[seen_points(surface.caster, points, CAMERA, ahead.T_world_camera, 8.0, int)]
    assert seen[:, 0].min() > -0.5  # nothing behind
    hidden = (np.abs(seen - (1.975, 1.2, 1.3)) < (0.026, 0.39, 0.29)).all(1)
    assert (seen[hidden, 0] < 1.9501).all()  # the wall behind the board, 5 cm of it, is not seen
    assert 0.3 < found.recall(0.01) < 0.6 and found.precision(0.01) == 1


def test_rays_to_samples_and_rendered_depth_agree_on_what_was_seen(surface, ahead):
    """The judge is a depth image: a point is seen where the plane of the surface in its pixel has
    its depth.
    """
    camera = PinholeCamera.parse("640x480")
    points = sampled(*ROOM, 60_000, 2)
    by_rays = seen_points(surface.caster, points, camera, ahead.T_world_camera, 8.0, int)
    by_depth = np.zeros(len(points), bool)
    for k in range(len(ahead.T_world_camera)):
        T = ahead.T_world_camera[k]
        hits = surface.caster.cast(T.translation, camera.rays() @ T.rotation.T)
        own = T.inverse().apply(points)
        rows = np.flatnonzero(own[:, 2] > 0)
        pixel = np.rint(camera.project(own[rows])).astype(int)
        inside = ((pixel >= 0) & (pixel < (640, 480))).all(1)
        rows, (u, v) = rows[inside], pixel[inside].T
        normal = hits.normal[v, u] @ T.rotation
        at = camera.rays()[v, u] * hits.distance[v, u, None]
        by_depth[rows] |= np.abs(((own[rows] - at) * normal).sum(1)) < 1e-3
    assert 0.2 < by_rays.mean() < 0.6
    assert abs(by_rays.mean() - by_depth.mean()) < 0.001 and (by_rays != by_depth).mean() < 0.005


def area_in_depth_m2(caster, camera, pose, far_m):
    """What a depth image shows of the surface: each pixel z^2 / (fx fy |n . ray|), its ray with z =
    1. Without any tolerance of depth.
    """
    rays = camera.rays() @ pose.rotation.T
    hits = caster.cast(pose.translation, rays)
    towards = np.abs((hits.normal * rays).sum(-1))
    shown = (hits.triangle >= 0) & (hits.distance <= far_m) & (towards > 0)
    return float((hits.distance[shown].astype(float) ** 2 / towards[shown]).sum()) / (
        camera.fx * camera.fy
    )


@pytest.mark.slow
def test_rays_and_depth_images_of_the_living_room_see_the_same_area():
    points, triangles = read_model("living_room")
    caster, camera, count = RayCaster(points, triangles), PinholeCamera(), 6_000_000
    poses = read_trajectory(
        shipped.trajectory_file("living_room/window")
    ).trajectory.T_world_camera[40::75]
    spread, each_m2 = (
        sampled(points, triangles, count, 0),
        areas_m2(points, triangles).sum() / count,
    )
    views = [poses[k : k + 1] for k in range(len(poses))]
    by_rays = (
        sum(seen_points(caster, spread, camera, view, 8.0, int).sum() for view in views) * each_m2
    )
    by_depth = sum(area_in_depth_m2(caster, camera, view[0], 8.0) for view in views)
    assert by_rays == pytest.approx(by_depth, rel=0.001)


def test_half_a_reconstruction_scores_half_however_large_its_triangles_are(surface, ahead):
    wall, camera = (
        rectangle((2, -2, 0), (0, 4, 0), (0, 0, 2.5)),
        PinholeCamera.parse("160x120,60,60,79.5,59.5"),
    )
    seen_by = SeenBy(camera, ahead.T_world_camera[2:3])  # sees all of the wall
    half = rectangle((2, -2, 0), (0, 2, 0), (0, 0, 2.5))
    found = surface_quality(TrueSurface(*wall), *half, seen_by=seen_by, settings=SMALL)
    assert found.seen_m2 == pytest.approx(10, rel=1e-3)
    assert found.recall(0.01) == pytest.approx(0.5 + 0.01 / 4, abs=0.001)
    # 0 for one half, 0 to 2 m for the other
    assert found.completion_m == pytest.approx(0.5, rel=1e-3)
    assert found.precision(0.01) == 1


def waved(cells):
    """The room's walls, 8 mm too far out in waves, of squares of any size; and a chest of large
    triangles.
    """
    points, triangles = box((-2, -2, 0), (2, 2, 2.5), 40 * cells)
    return points + 0.008 * np.sin(7 * points[:, [1, 2, 0]]) ** 2, triangles


def test_floaters_raise_no_figure_and_finer_meshes_win_nothing(surface, ahead):
    plain = surface_quality(surface, *waved(1), seen_by=ahead, settings=SMALL)
    floater = rectangle((0.2, 0.2, 1.0), (0.3, 0, 0), (0, 0, 0.3))
    floating = surface_quality(surface, *joined(waved(1), floater), seen_by=ahead, settings=SMALL)
    assert floating.accuracy_m > plain.accuracy_m and floating.precision(0.05) < plain.precision(
        0.05
    )
    assert floating.depth_l1_m > plain.depth_l1_m
    finer = waved(2)
    half_finer = joined(box((-2, -2, 0), (2, 2, 2.5), 1), box((0.8, -0.4, 0), (1.4, 0.5, 0.7), 60))
    coarse = joined(box((-2, -2, 0), (2, 2, 2.5), 1), box((0.8, -0.4, 0), (1.4, 0.5, 0.7), 1))
    for one, two, rel in ((waved(1), finer, 0.01), (coarse, half_finer, 0.005)):
        a, b = (
            surface_quality(surface, p + (0, 0, 0.003), t, seen_by=ahead, settings=SMALL).to_dict()
            for p, t in (one, two)
        )
        for name in ("accuracy_m", "completion_m"):
            assert b[name] == pytest.approx(a[name], rel=rel)


def test_twice_the_samples_or_another_seed_move_no_figure_by_half_a_percent(surface, ahead):
    def figures(**changed):
        found = surface_quality(
            surface, *waved(1), seen_by=ahead, settings=SMALL.changed(**changed)
        ).to_dict()
        return [found[k] for k in ("accuracy_m", "completion_m", "seen_m2")] + [
            *found["precision"].values(),
            *found["recall"].values(),
        ]

    one = figures(samples=30_000)
    np.testing.assert_allclose(figures(samples=60_000), one, rtol=0.005)
    np.testing.assert_allclose(figures(samples=30_000, seed=7), one, rtol=0.005)


def test_distances_to_samples_are_those_of_the_published_scripts(surface):
    """Accuracy, completion and its ratio after their definition: means over the nearest of the
    other cloud, by open3d's tree.
    """
    import open3d

    points, triangles = waved(1)
    found = surface_quality(
        surface, points, triangles, whole=True, settings=SMALL.changed(nearest="sample")
    )
    clouds = (sampled(points, triangles, 20_000, 0), sampled(*ROOM, 20_000, 0))
    own, truth = (
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud)) for cloud in clouds
    )
    accuracy, completion = (
        np.array(a.compute_point_cloud_distance(b)) for a, b in ((own, truth), (truth, own))
    )
    assert found.accuracy_m == pytest.approx(
        accuracy.mean()
    ) and found.completion_m == pytest.approx(completion.mean())
    assert found.recall(0.05) == (completion <= 0.05).mean()


def test_samples_lie_on_their_triangles_by_area_and_cells_of_a_cloud_count_once():
    points, triangles = joined(
        rectangle((0, 0, 0), (3, 0, 0), (0, 1, 0), 1),
        rectangle((5, 0, 0), (1, 0, 0), (0, 1, 0), 30),
    )
    assert areas_m2(points, triangles).sum() == pytest.approx(4)
    spread = sampled(points, triangles, 10_000, 0)
    assert (spread[:, 2] == 0).all() and (spread[:, 0] < 4).mean() == pytest.approx(0.75, abs=2e-4)
    counts = np.histogram2d(spread[:, 0], spread[:, 1], [12, 4], [[0, 3], [0, 1]])[0]
    assert counts.min() > 140 and counts.max() < 175  # 156 each
    assert not np.array_equal(spread, sampled(points, triangles, 10_000, 1))
    grid = np.stack(np.meshgrid(*2 * [np.arange(50) * 1.5 * CELL_M], [0.0]), -1).reshape(-1, 3)
    assert len(thinned(np.vstack([grid, np.repeat(grid[:700], 9, 0)]), 10**6, 0)) == len(grid)
    assert len(thinned(grid, 1000, 0)) == 1000
    with pytest.raises(InputError, match="with an area"):
        sampled(np.zeros((3, 3)), np.array([[0, 1, 2]]), 10, 0)


def test_a_trajectory_that_sees_nothing_of_the_model_is_refused(surface, ahead):
    away = SeenBy(CAMERA, SE3(np.eye(3), np.array([100.0, 0, 0])) @ ahead.T_world_camera)
    for views in (
        away,
        SeenBy(CAMERA, SE3(np.eye(3), np.array([0, 0, 9.0])) @ ahead.T_world_camera),
    ):
        with pytest.raises(InputError, match="sees something of the model"):
            surface_quality(surface, *ROOM, seen_by=views, settings=SMALL)


def test_pairs_find_the_motion_and_pairs_on_a_line_are_refused():
    rng, T = np.random.default_rng(3), SE3.exp(np.array([1, -2, 0.5, 0.9, -0.4, 0.3]))
    picked = rng.uniform(-1, 1, (5, 3))
    found, rms_m = pairs_transform(picked, T.apply(picked))
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-12)
    assert rms_m < 1e-12
    for few in (picked[:2], np.outer(np.arange(4), picked[0])):
        with pytest.raises(InputError, match="not on a line"):
            pairs_transform(few, few)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The room, reconstructions of it in many states, and trajectories, as files."""
    folder = tmp_path_factory.mktemp("room")
    points, triangles = waved(1)
    bad = points.copy()
    bad[::100] = np.nan
    turned = SE3.exp(np.array([0.02, 0.01, -0.01, 0.004, 0, 0.006]))
    for name, (p, t) in {
        "model": ROOM,
        "mesh": (points, triangles),
        "nan": (bad, triangles),
        "cloud": (np.vstack([bad, points]), None),
        "flat": (points, np.zeros((4, 3), int)),
        "moved": (turned.apply(points), triangles),
        "lost": ((turned @ turned.exp(np.array([5, 1, 0, 1.0, 0, 2]))).apply(points), triangles),
    }.items():
        write_ply(folder / f"{name}.ply", p.astype(np.float32), t)
    lost = turned @ turned.exp(np.array([5, 1, 0, 1.0, 0, 2]))
    picked = points[[5, 3000, 7000, 9900]]
    rows = [
        "# mesh, model",
        *(" ".join(f"{x:.6f}" for x in row) for row in np.hstack([lost.apply(picked), picked])),
    ]
    (folder / "pairs.txt").write_text("\n".join(rows))
    (folder / "bad_pairs.txt").write_text("1 2 3 4 5\n")
    (folder / "reflection.txt").write_text("1 0 0 0  0 1 0 0  0 0 -1 0  0 0 0 1\n")
    return folder


@pytest.fixture(scope="module")
def looked(files, request):
    """gt.txt: poses that look around; est.txt: the same with a first pose that is off."""
    rng = np.random.default_rng(1)
    twists = np.column_stack(
        [np.cumsum(rng.normal(0, 0.05, (30, 3)), 0), np.cumsum(rng.normal(0, 0.1, (30, 3)), 0)]
    )
    poses = SE3(np.eye(3), np.array([0, 0, 1.2])) @ SE3.exp(twists)
    write_trajectory(files / "gt.txt", Trajectory.at_rate(poses), "tum")
    off = SE3.exp(np.array([0.03, 0, 0, 0, 0, 0.03]))
    matrices = np.array(
        [(poses[k] @ off if k == 0 else poses[k]).matrix for k in range(len(poses))]
    )
    write_trajectory(files / "est.txt", Trajectory.at_rate(SE3.from_matrix(matrices)), "tum")
    return files


@pytest.mark.parametrize(
    ("options", "said", "low_mm", "high_mm"),
    [
        (("mesh.ply",), "no completion", 1, 5),
        (("mesh.ply", "--seen-by", "gt.txt"), "", 1, 5),
        (("mesh.ply", "--seen-by", "all"), "", 1, 5),
        (("nan.ply",), "points with NaN or infinity are left out, and", 1, 5),
        (("cloud.ply", "--seen-by", "gt.txt"), "a point cloud", 1, 5),
        (("flat.ply",), "read as a point cloud", 1, 5),
        (("moved.ply", "--align", "icp"), "the fit moved it by", 1, 5),
        (("lost.ply", "--pairs", "pairs.txt"), "4 pairs, residual 0.0", 1, 5),
        (("mesh.ply", "--poses", "est.txt", "--truth", "gt.txt"), "", 8, 80),
        (
            ("mesh.ply", "--poses", "est.txt", "--truth", "gt.txt", "--fit-poses", "se3"),
            "the fit moved it by",
            1,
            8,
        ),
    ],
)
def test_every_kind_of_reconstruction_and_alignment_is_measured_and_said_in_words(
    looked, monkeypatch, command_here, options, said, low_mm, high_mm
):
    monkeypatch.chdir(looked)
    few = ("--model", "model.ply", "--samples", "5000")
    code, out, err = command_here("evaluate", "surface", *options, *few)
    assert code == 0, err
    assert said in out + err
    mean_mm = float(out.split("mean")[1].split()[0])
    assert f"  mean {mean_mm:>13.3f}  (" in out
    assert ("(the paper's figure)" in out) == ("icp" in options)
    assert low_mm < mean_mm < high_mm
    assert ("completion  " in out) == ("--seen-by" in options or "--truth" in options)
    if "as given" in out:
        assert float(out.split("without the fit: mean")[1].split(";")[0]) > mean_mm


@pytest.mark.parametrize(("left", "is_said"), [(29, False), (20, True)])
def test_true_poses_that_the_estimate_lacks_are_said(
    looked, monkeypatch, command_here, left, is_said
):
    """As after an interrupted render, whose ground truth has the poses of all frames."""
    monkeypatch.chdir(looked)
    write_trajectory("part.txt", read_trajectory("est.txt").trajectory[:left], "tum")
    paths = ("mesh.ply", "--model", "model.ply", "--poses", "part.txt", "--truth", "gt.txt")
    code, _, err = command_here("evaluate", "surface", *paths, "--samples", "5000")
    assert code == 0, err
    assert ("part.txt has no pose at 10 of the 30 poses of gt.txt" in err) == is_said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("mesh.ply", "--pairs", "bad_pairs.txt"), "bad_pairs.txt"),
        (("mesh.ply", "--fit-poses", "se3"), "--fit-poses with --poses"),
        (("mesh.ply", "--nearest", "vertex"), "--nearest"),
        (("mesh.ply", "--samples", "3"), "--samples"),
        (("mesh.ply", "--seen-by", "nothing.txt"), "nothing.txt"),
        *(
            (("mesh.ply", f"--max-error={value}"), "--max-error: expected")
            for value in ("-5", "nan", "inf", "0")
        ),
        *(
            (("mesh.ply", f"--unit={value}"), "--unit: expected 1e-06 to 1e+06 m")
            for value in ("-1", "nan", "inf", "0")
        ),
        (
            ("mesh.ply", "--transform", "reflection.txt"),
            "reflection.txt: expected a rotation and a translation",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    looked, monkeypatch, command_here, options, said
):
    monkeypatch.chdir(looked)
    code, _, err = command_here("evaluate", "surface", *options, "--model", "model.ply", "--quiet")
    assert code == 2 and said in err and len(err.strip().splitlines()) == 1


def test_a_file_keeps_what_is_finite(files):
    found = read_reconstruction(files / "nan.ply", 0.001)
    assert np.isfinite(found.points).all() and found.triangles.max() == len(found.points) - 1
    assert found.points.max() < 0.003 and "left out" in found.notes[0]
    RayCaster(found.points, found.triangles)


def test_a_camera_that_turns_by_ten_degrees_in_two_frames_leaves_no_gap_between_the_poses_used():
    """135 degrees a second, faster than a hand: the sides of the room, of which every pose sees 67
    degrees, are seen but for two hundredths. No more than four poses of a second cost time.
    """
    angles = np.radians(4.5) * np.arange(61)
    level = so3.exp(np.array([-np.pi / 2, 0, 0]))
    turns = np.array([so3.exp(np.array([0, 0, angle])) @ level for angle in angles])
    path = SE3(turns, np.tile([0, 0, 1.2], (len(angles), 1)))
    surface = TrueSurface(*ROOM)
    used, whole = (
        what_was_seen(surface, SeenBy(CAMERA, path), settings)
        for settings in (QualitySettings(samples=20_000), SMALL)
    )
    assert used.area_m2 > 0.97 * whole.area_m2
    assert len(used.views.T_world_camera) < 4 * len(angles) / 30 + 1
