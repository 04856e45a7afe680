"""Odometers on frames made by formula: a textured corner of three planes seen by a camera that
moves as we tell it.
"""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

numba = pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.protocol import Frame, OdometryStatus  # noqa: E402
from iclnuim.benchmark.odometry.references import Reference  # noqa: E402
from iclnuim.benchmark.odometry.registry import ODOMETERS, odometer  # noqa: E402
from iclnuim.benchmark.odometry.track import track  # noqa: E402
from odometry_scenes import ROOM, celled, error_m, run, view  # noqa: E402

# this corner is smooth: FOVIS, which needs corners, has a test of its own
DENSE = [name for name in ODOMETERS if name != "fovis"]
CAMERA = PinholeCamera.parse("160x120")
CORNER = np.array([[0.8, 0.0, 0.6], [-0.8, 0.0, 0.6], [0.0, 0.8, 0.6]])
TWIST = np.array([0.006, -0.004, 0.005, 0.004, -0.003, 0.005])


def seen(T_world_camera, planes=CORNER, stamp_s=0.0, bare=False):
    """n . x = 2 for each plane; the nearest hit counts; texture by position in space."""
    rays = CAMERA.rays() @ T_world_camera.rotation.T
    origin, nearest = T_world_camera.translation, np.full(rays.shape[:2], np.inf)
    for n in planes / np.linalg.norm(planes, axis=1)[:, None]:
        slope = rays @ n
        z = np.where(slope > 1e-6, (2 - n @ origin) / np.maximum(slope, 1e-6), np.inf)
        nearest = np.minimum(nearest, z)
    x, y, z = np.moveaxis(origin + rays * nearest[..., None], -1, 0)
    grey = (
        128 + 40 * np.sin(9 * x + 2 * z) + 40 * np.sin(11 * y - 3 * z) + 20 * np.sin(7 * z + 4 * x)
    )
    return Frame.of(grey * 0 if bare else grey, nearest, stamp_s)


def path(count):
    pose, poses = SE3.identity(), []
    for _ in range(count):
        poses.append(pose)
        pose = pose @ SE3.exp(TWIST)
    return poses


def tracked(name, frames, preset="best", policy="hold"):
    return list(track(odometer(name, preset), CAMERA, enumerate(frames), policy))


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("name", DENSE)
def test_a_known_motion_is_found(name, preset):
    poses = path(4)
    found = tracked(name, [seen(T) for T in poses], preset)
    assert not any(f.lost for f in found)
    error = np.linalg.norm(found[-1].T_world_camera.translation - poses[-1].translation)
    # the bilateral filter of `paper` rounds the corner's edges, the more the fewer pixels there are
    assert error < (0.2 if preset == "paper" else 0.1) * np.linalg.norm(poses[-1].translation)


@pytest.mark.parametrize("name", ODOMETERS)
def test_the_same_frames_give_the_same_path_whatever_the_number_of_threads(name):
    frames = [seen(T) for T in path(3)]
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = tracked(name, frames)[-1].T_world_camera.matrix
    finally:
        numba.set_num_threads(before)
    assert np.abs(tracked(name, frames)[-1].T_world_camera.matrix - one).max() < 1e-9


@pytest.mark.parametrize("name", DENSE)
@pytest.mark.parametrize("fault", ["empty depth", "NaN depth", "other size", "unreadable"])
def test_a_bad_frame_is_reported_and_the_frames_around_it_are_tracked(name, fault):
    poses = path(4)
    frames = [seen(T) for T in poses]
    nothing = np.zeros((120, 160))
    frames[2] = {
        "empty depth": Frame.of(nothing, nothing, 0),
        "NaN depth": Frame.of(frames[2].grey, nothing * np.nan, 0),
        "other size": Frame.of(np.ones((60, 80)), np.ones((60, 80)), 0),
        "unreadable": "image: missing",
    }[fault]
    found = tracked(name, frames)
    assert [f.lost for f in found] == [False, False, True, False]
    assert found[2].result.reason and not found[2].result.converged
    error = np.linalg.norm(found[3].T_world_camera.translation - poses[3].translation)
    assert error < 0.15 * np.linalg.norm(poses[3].translation)


@pytest.mark.parametrize("name", ["dvo", "rgbd"])
def test_a_black_image_is_lost_to_photometric_odometers_and_the_next_is_found(name):
    frames = [seen(T) for T in path(4)]
    frames[2] = Frame.of(frames[2].grey * 0, frames[2].depth_z_m, 0)
    found = tracked(name, frames)
    assert not found[1].lost and not found[3].lost
    assert found[2].lost and "contrast" in found[2].result.reason


def test_the_first_pose_after_many_lost_frames_is_reported_as_none_knows_where_the_camera_went():
    frames = [seen(T) for T in path(10)]
    black = Frame.of(frames[2].grey * 0, frames[2].depth_z_m, 0)
    found = tracked("dvo", [*frames[:2], *[black] * 5, *frames[7:]])
    assert [f.lost for f in found] == [False] * 2 + [True] * 6 + [False] * 2
    status = [f.result.status for f in found]
    assert (
        status[8] is OdometryStatus.DEGENERATE
        and found[8].result.reason.startswith("track:")
        and status[9] is OdometryStatus.OK
    )


def test_a_black_image_leaves_the_joint_odometer_its_geometry():
    poses = path(4)
    frames = [seen(T, bare=i == 2) for i, T in enumerate(poses)]
    found = tracked("icp_rgbd", frames)
    assert not any(f.lost for f in found)
    assert np.linalg.norm(
        found[-1].T_world_camera.translation - poses[-1].translation
    ) < 0.15 * np.linalg.norm(poses[-1].translation)


@pytest.mark.parametrize(("shift_px", "columns"), [(9, slice(30, 130)), (14, slice(60, 150))])
def test_a_mirror_over_half_of_the_view_leaves_the_joint_odometer_its_geometry(shift_px, columns):
    """Contrast that moves in another way than the surfaces: the images do not fit at any
    prediction.
    """
    poses, frames = path(4), []
    for i, pose in enumerate(poses):
        frame = seen(pose)
        u = np.arange(160) + shift_px * i
        frame.grey[:, columns] = (128 + 70 * np.sin(0.2 * u) + 40 * np.sin(0.13 * u + 1))[columns]
        frames.append(frame)
    found = tracked("icp_rgbd", frames)[-1].T_world_camera.translation
    true = poses[-1].translation
    assert np.linalg.norm(found - true) < 0.01 * np.linalg.norm(true)


@pytest.mark.parametrize("name", DENSE)
def test_the_error_of_a_camera_that_sways_does_not_grow_with_the_number_of_frames(name):
    """Noisy frames within the range of one keyframe; frame to frame, the errors of all steps add
    up.
    """
    rng = np.random.default_rng(4)
    poses = [SE3.exp(4 * np.sin(0.35 * i) * TWIST) for i in range(80)]
    frames = []
    for i, pose in enumerate(poses):
        frame = seen(pose, stamp_s=i / 30)
        z = frame.depth_z_m + rng.normal(0, 0.004, frame.depth_z_m.shape)
        frames.append(Frame.of(frame.grey + rng.normal(0, 3, z.shape), z, i / 30))
    errors = []
    for against in (None, Reference()):
        found = track(odometer(name, "best"), CAMERA, enumerate(frames), against=against)
        apart = [
            f.T_world_camera.translation - pose.translation
            for f, pose in zip(found, poses, strict=True)
        ]
        errors.append(np.sqrt(np.mean(np.square(apart))))
    assert errors[0] < 0.75 * errors[1]


def test_a_single_frame_is_a_path_of_one_pose():
    found = tracked("dvo", [seen(SE3.identity())])
    assert (
        len(found) == 1
        and not found[0].lost
        and np.array_equal(found[0].T_world_camera.matrix, np.eye(4))
    )


def test_a_bare_wall_is_degenerate_and_held_and_a_corner_is_not():
    wall = [seen(T, np.array([[0.0, 0.0, 1.0]])) for T in path(3)]
    corner = tracked("icp", [seen(T) for T in path(3)])
    assert all(
        f.result.status is OdometryStatus.DEGENERATE and f.result.under_constrained == 3
        for f in tracked("icp", wall)[1:]
    )
    assert not any(
        f.result.status is OdometryStatus.DEGENERATE or f.result.under_constrained for f in corner
    )
    assert np.abs(tracked("icp", wall)[-1].T_world_camera.translation[:2]).max() < 0.02


def test_colour_and_depth_of_different_size_are_refused():
    with pytest.raises(InputError, match="depth of the image's size"):
        Frame.of(np.zeros((4, 4)), np.zeros((4, 5)), 0)


def test_an_unknown_odometer_names_the_known_ones():
    with pytest.raises(InputError, match="icp_rgbd"):
        odometer("orb")


@pytest.fixture(scope="module")
def unusable():
    """What is wrong -> three frames, the first of them included."""
    frames, rng = [celled(i) for i in range(3)], np.random.default_rng(11)

    return {
        "constant depth": [Frame.of(f.grey, np.full_like(f.grey, 2), f.stamp_s) for f in frames],
        "black": [Frame.of(f.grey * 0, f.depth_z_m, f.stamp_s) for f in frames],
        "grain": [
            Frame.of(rng.integers(0, 256, f.grey.shape), f.depth_z_m, f.stamp_s) for f in frames
        ],
        "shuffled": [replace(celled(i), stamp_s=n / 30) for n, i in enumerate((60, 0, 120))],
    }


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("name", ODOMETERS)
def test_frames_that_no_motion_can_be_told_from_are_lost_or_flagged(name, preset, unusable):
    for wrong, frames in unusable.items():
        found = list(track(odometer(name, preset), CAMERA, [(f.stamp_s, f) for f in frames]))
        # geometry alone decides, and is right
        unheeded = name.startswith("icp") and wrong in (
            "black",
            "grain",
        )
        if unheeded:
            assert error_m(found) < 0.003, wrong
        else:
            assert all(f.result.status is not OdometryStatus.OK for f in found[1:]), wrong


def test_depth_of_one_value_is_noticed_and_a_wall_a_little_aslant_is_none():
    two = np.full((6, 8), 2.0)
    holes, aslant = np.where(np.eye(6, 8) > 0, 0, two), two + 2e-4 * np.arange(8)
    assert [Frame.of(two, z, 0).flat() for z in (two, holes, aslant)] == [True, True, False]
    noise = np.random.default_rng(0).standard_normal((480, 640))
    assert [Frame.of(noise, 2 + deviation_m * noise, 0).flat() for deviation_m in (1e-4, 2e-4)] == [
        True,
        False,
    ]


@pytest.mark.parametrize("name", ["icp", "icp_rgbd", "rgbd", "dvo"])
def test_a_wrong_camera_is_no_crash_and_shows_in_residual_or_inliers_or_as_lost(name):
    frames = [view(i, ROOM) for i in range(4)]
    wrong = PinholeCamera(160, 120, CAMERA.fx * 1.5, CAMERA.fy * 0.7, 40.0, 20.0)
    right, bent = run(name, frames), run(name, frames, wrong)
    assert len(bent) == 4
    for a, b in zip(right[1:], bent[1:], strict=True):
        worse = (
            b.result.residual > 1.5 * a.result.residual or b.result.inliers < 0.6 * a.result.inliers
        )
        assert b.lost or worse
