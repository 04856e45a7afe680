"""Tracking against the model: what an odometer is shown, and that it drifts less than from frame to
frame.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.depth_units import UNITS_PER_METRE
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sequences.stored_sequence import read_depth_m

pytest.importorskip("numba")
pytest.importorskip("cv2")
from dataclasses import replace  # noqa: E402

from iclnuim.benchmark.fusion import reference as module  # noqa: E402
from iclnuim.benchmark.fusion.reference import PRESETS, ModelReference, make_reference  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.track import Tracker  # noqa: E402

#: A corner of a room, three planes (normal, point) and a ball.
PLANES = (((0, 0, 1), (0, 0, -0.8)), ((-1, 0, 0), (1.6, 0, 0)), ((0, 1, 0), (0, -1.4, 0)))


@pytest.fixture
def small(monkeypatch):
    """The presets with less memory, so that tests stay light."""
    presets = {
        n: replace(p, volume=replace(p.volume, max_blocks=20_000)) for n, p in PRESETS.items()
    }
    monkeypatch.setattr(module, "PRESETS", presets)


@pytest.fixture
def room(camera, plane_depth, sphere_depth, looking_at):
    """(poses, frames): a slow arc, depth with 1 mm of noise, grey with a pattern on all surfaces."""
    rng, poses, frames = np.random.default_rng(11), [], []
    for i in range(40):
        angle = 0.012 * i
        T = looking_at(
            np.array([-0.2 * np.cos(angle), 0.5 * np.sin(angle), 0.3 * np.sin(2 * angle)]),
            (1.2, -0.5, -0.3),
        )
        layers = [plane_depth(*plane, T) for plane in PLANES] + [
            sphere_depth((1.1, -0.6, -0.4), 0.3, T)
        ]
        depth = np.min([np.where(layer > 0, layer, np.inf) for layer in layers], axis=0)
        points = camera.unproject(depth) @ T.rotation.T + T.translation
        x, y, z = np.moveaxis(points, -1, 0)
        grey = 120 + 50 * np.sin(9 * x + 7 * z) * np.cos(8 * y - 3 * z)
        noisy = depth + rng.normal(0, 0.001, depth.shape)
        poses.append(T)
        frames.append(Frame.of(grey, noisy.astype(np.float32), i / 30))
    return poses, frames


def tracked(name, kind, camera, frames, preset="best"):
    one = odometer(name, preset)
    tracker = Tracker(one, camera, against=make_reference(kind, one, camera, preset))
    found = [tracker.add(frame.stamp_s, frame) for frame in frames]
    assert not any(f.lost for f in found)
    return np.array([f.T_world_camera.matrix for f in found])


def error_m(estimate, poses):
    truth = np.array([(poses[0].inverse() @ T).matrix for T in poses])
    return np.sqrt(((estimate[:, :3, 3] - truth[:, :3, 3]) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize(
    ("sigma_m", "turn_deg", "renewed"),
    [
        (1e-4, 0.1, [0, 6]),
        (1.4e-4, 0.1, [0, 6]),
        (1e-4, 1.9, [0, 5]),  # the first turn beyond 8 degrees
        (1e-4, 3.0, [0, 3, 6]),
        (float("nan"), 0.1, [0, 3, 6]),
    ],
)
def test_a_view_is_kept_while_it_tells_the_motion_and_shows_the_same(
    small, camera, room, sigma_m, turn_deg, renewed
):
    _, frames = room
    one = odometer("icp")
    model, prepared = ModelReference(one, camera), one.prepare(frames[0], camera)
    result, views = OdometryResult(SE3.identity(), largest_sigma_m=sigma_m), []
    for i in range(8):
        T = SE3.exp([0, 0, 0, 0, np.radians(i * turn_deg), 0])
        view, _ = model.renew(frames[0], prepared, T, result)
        views.append(view)
    assert [i for i in range(8) if i == 0 or views[i] is not views[i - 1]] == renewed


@pytest.mark.parametrize("sigma_m", [2.8e-4, 1e-2, np.inf])
def test_after_an_uncertain_motion_the_view_is_a_keyframe_until_the_next_one(
    small, camera, room, sigma_m
):
    _, frames = room
    one = odometer("icp")
    model, prepared = ModelReference(one, camera), one.prepare(frames[0], camera)
    certain = OdometryResult(SE3.identity(), largest_sigma_m=1e-4)
    model.renew(frames[0], prepared, SE3.identity())
    uncertain = replace(certain, largest_sigma_m=sigma_m)
    view, _ = model.renew(frames[0], one.prepare(frames[0], camera), SE3.identity(), uncertain)
    assert view is prepared
    fused = model.volume.frames
    moved_m = [0.05, 0.1, 0.15, 0.21, 0.26, 0.31]
    views = []
    for x in moved_m:
        T = SE3(np.eye(3), np.array([x, 0, 0]))
        views.append(model.renew(frames[0], one.prepare(frames[0], camera), T, certain)[0])
    assert all(view is prepared for view in views[:3]) and views[-1] is not prepared
    assert model.volume.frames > fused
    assert all(levels[-1].rendered for levels in views[-2:])


def test_an_odometer_that_does_not_know_its_error_keeps_the_model(small, camera, room):
    _, frames = room
    one = odometer("icp", "paper")
    model, prepared = ModelReference(one, camera, "paper"), one.prepare(frames[0], camera)
    unknown = OdometryResult(SE3.identity(), largest_sigma_m=np.nan)
    views = [model.renew(frames[0], prepared, SE3.identity(), unknown)[0] for _ in range(3)]
    assert all(view is not prepared for view in views)


def test_the_model_of_the_paper_is_fused_and_seen_anew_in_every_frame(small, camera, room):
    """However certain the motion is (KinectFusion)."""
    _, frames = room
    one = odometer("icp")
    model, prepared = ModelReference(one, camera, "paper"), one.prepare(frames[0], camera)
    result = OdometryResult(SE3.identity(), largest_sigma_m=1e-5)
    views = [model.renew(frames[0], prepared, SE3.identity(), result)[0] for _ in range(3)]
    assert views[0] is not views[1] is not views[2]


def test_icp_drifts_less_against_the_model(small, camera, room):
    poses, frames = room
    errors = {
        kind: error_m(tracked("icp", kind, camera, frames), poses) for kind in ("frame", "model")
    }
    assert errors["model"] < 0.5 * errors["frame"]


@pytest.mark.parametrize("name", ["dvo", "rgbd", "icp_rgbd", "opencv-icp"])
def test_every_odometer_can_be_shown_the_model(small, name, camera, room):
    if name.startswith("opencv") and not hasattr(pytest.importorskip("cv2"), "rgbd"):
        pytest.skip("this OpenCV has no rgbd module (opencv-contrib-python-headless)")
    poses, frames = room
    assert error_m(tracked(name, "model", camera, frames[:13]), poses[:13]) < 0.01


def seen_share(depth_z_m, camera, ahead):
    """The share of a frame that the paper's model shows after it alone was fused."""
    one = odometer("icp", "paper")
    frame = Frame(np.zeros(depth_z_m.shape, np.float32), depth_z_m, 0.0)
    view, _ = ModelReference(one, camera, "paper", ahead).renew(
        frame, one.prepare(frame, camera), SE3.identity()
    )
    return (view[0].depth_z_m > 0).mean()


def test_a_window_before_the_camera_holds_what_is_out_of_reach_of_one_around_it(small, camera):
    wall = np.full((camera.height, camera.width), 3.5, np.float32)
    assert seen_share(wall, camera, ahead=False) == 0
    assert seen_share(wall, camera, ahead=True) > 0.9


def test_of_the_official_office_the_window_around_the_camera_holds_nearly_nothing(samples):
    depth_z_m = read_depth_m(samples / "or_kt0/depth/705.png", UNITS_PER_METRE)
    assert seen_share(depth_z_m, PinholeCamera(), ahead=False) < 0.05
    assert seen_share(depth_z_m, PinholeCamera(), ahead=True) > 0.5


def test_the_papers_window_follows_too(small, camera, room):
    poses, frames = room
    assert error_m(tracked("icp", "model", camera, frames[:8], "paper"), poses[:8]) < 0.01


def test_the_path_does_not_depend_on_the_number_of_threads(small, camera, room):
    import numba

    paths, threads = [], numba.get_num_threads()
    for count in (1, threads):
        numba.set_num_threads(count)
        paths.append(tracked("icp", "model", camera, room[1][:8]))
    numba.set_num_threads(threads)
    np.testing.assert_array_equal(*paths)


def test_a_view_of_the_model_is_the_surface_of_the_frame_that_was_fused(small, camera, room):
    poses, frames = room
    one = odometer("icp", "best")
    model = ModelReference(one, camera)
    view, T = model.renew(frames[0], one.prepare(frames[0], camera), poses[0])
    finest = one.prepare(frames[0], camera)[1]
    seen = (view[1].depth_z_m > 0) & (finest.depth_z_m > 0)
    assert seen.mean() > 0.9
    assert np.median(np.abs(view[1].depth_z_m - finest.depth_z_m)[seen]) < 0.001
    turned = (view[1].normals * finest.normals).sum(-1)[
        (view[1].normals[..., 2] != 0) & (finest.normals[..., 2] != 0)
    ]
    assert np.median(turned) > 0.9
    np.testing.assert_array_equal(T.matrix, poses[0].matrix)


def test_levels_of_the_model_say_that_they_are_rendered(small, camera, room):
    one, frames = odometer("icp_rgbd"), room[1]
    prepared = one.prepare(frames[0], camera)
    levels, _ = ModelReference(one, camera).renew(frames[0], prepared, room[0][0])
    finest = min(one.finest, len(prepared) - 1)
    assert [level.rendered for level in levels] == [n >= finest for n in range(len(levels))]


def test_a_frame_that_was_lost_does_not_spoil_the_model(small, camera, room):
    poses, frames = room
    one = odometer("icp")
    model = ModelReference(one, camera)
    tracker = Tracker(one, camera, against=model)
    empty = Frame.of(np.zeros((120, 160)), np.zeros((120, 160)), 1.0)
    tracker.add(0.0, frames[0])
    fused = model.volume.frames
    assert all(tracker.add(1.0, empty).lost for _ in range(7))
    assert model.volume.frames == fused
    assert not tracker.add(2.0, frames[1]).lost


def test_an_unknown_preset_is_refused(camera):
    with pytest.raises(InputError, match="preset of the model"):
        ModelReference(odometer("icp"), camera, "fast")
