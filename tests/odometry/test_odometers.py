"""Odometers on frames made by formula: a textured corner of three planes seen by a camera that
moves as we tell it.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

numba = pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.protocol import Frame, Result, Status, failure  # noqa: E402
from iclnuim.benchmark.odometry.registry import ODOMETERS as OURS  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.solver import System  # noqa: E402
from iclnuim.benchmark.odometry.track import Reference, Tracker, track  # noqa: E402

DENSE = [
    name for name in OURS if name != "fovis"
]  # this corner is smooth: FOVIS, which needs corners, has a test of its own
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


@pytest.mark.parametrize("name", OURS)
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
        status[8] is Status.DEGENERATE
        and found[8].result.reason.startswith("track:")
        and status[9] is Status.OK
    )


def test_a_hundred_lost_frames_leave_the_pose_a_rigid_motion():
    """Each lost frame is a new reference; rounding errors of the rotation must not grow from one to
    the next.
    """

    class Lost:
        name, reference, turn = "lost", "frame", path(3)[2]

        def prepare(self, frame, camera):
            return frame.stamp_s

        def align(self, reference, current, guess):
            return failure("test: no motion found") if 2 < current < 110 else Result(self.turn)

    tracker, image = Tracker(Lost(), CAMERA, "restart"), seen(path(1)[0])
    for k in range(112):
        pose = tracker.add(
            float(k), Frame.of(image.grey + k % 2, image.depth_z_m, float(k))
        ).T_world_camera
        assert np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() < 1e-12


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
        f.result.status is Status.DEGENERATE and f.result.under_constrained == 3
        for f in tracked("icp", wall)[1:]
    )
    assert not any(
        f.result.status is Status.DEGENERATE or f.result.under_constrained for f in corner
    )
    assert np.abs(tracked("icp", wall)[-1].T_world_camera.translation[:2]).max() < 0.02


def test_colour_and_depth_of_different_size_are_refused():
    with pytest.raises(InputError, match="depth of the image's size"):
        Frame.of(np.zeros((4, 4)), np.zeros((4, 5)), 0)


def test_the_step_solves_the_equations_as_numpy_does():
    rng = np.random.default_rng(3)
    J, r, p = rng.normal(size=(50, 6)), rng.normal(size=50), rng.normal(size=(50, 3))
    centre = p.mean(axis=0)
    system = System(J.T @ J, J.T @ r, 1.0, 50, centre, 2.0)
    np.testing.assert_allclose(
        system.step(np.zeros(6))[0], np.linalg.lstsq(J, r, rcond=None)[0], rtol=1e-8
    )
    np.testing.assert_allclose(
        (SE3.exp(np.zeros(6)) @ SE3.identity()).matrix, np.eye(4), atol=1e-15
    )


def test_a_rotation_in_front_of_a_bare_wall_is_not_estimated_as_a_motion_along_it():
    rng = np.random.default_rng(6)
    wall = np.c_[rng.uniform(-1, 1, (200, 2)), np.full(200, 2.0)]
    J = (
        np.c_[np.tile([0.0, 0, 1], (200, 1)), np.cross(wall, [0.0, 0, 1])] * 1e3
    )  # certain to a millimetre
    rotation = np.r_[0, 0, 0.01, 0.02, -0.03, 0]
    for camera_m in (np.zeros(3), np.array([0.2, -0.1, 0.3])):
        about = (
            np.r_[np.cross(camera_m, rotation[3:]), np.zeros(3)] + rotation
        )  # the camera itself moves along z only
        system = System(
            J.T @ J, J.T @ (J @ about), 1.0, 200, wall.mean(axis=0), 0.8, is_information=True
        )
        twist, under_constrained = system.step(np.zeros(6), 0.03, camera_m)
        assert under_constrained == 3
        moved_m = twist[:3] + np.cross(twist[3:], camera_m)
        np.testing.assert_allclose(moved_m[:2], 0, atol=1e-5)
        np.testing.assert_allclose(twist[3:5], rotation[3:5], atol=1e-5)


def test_equations_with_a_further_error_have_the_sum_of_both_variances_and_the_same_optimum():
    rng = np.random.default_rng(4)
    J, r = rng.normal(size=(50, 6)), rng.normal(size=50)
    exact = System(J.T @ J, J.T @ r, 1.0, 50, np.zeros(3), 1.0)
    for columns in (rng.normal(size=(6, 1)), np.diag(rng.uniform(0, 1, 6))):
        found = exact.with_error(columns)
        np.testing.assert_allclose(
            np.linalg.inv(found.A), np.linalg.inv(exact.A) + columns @ columns.T, atol=1e-12
        )
        np.testing.assert_allclose(
            np.linalg.solve(found.A, found.b), np.linalg.solve(exact.A, exact.b), rtol=1e-9
        )
    # an unknown length of the motion: the joint problem, its factor solved for as well
    along = np.r_[0.3, -0.1, 0.2, 0, 0, 0]
    free = exact.with_error(1e6 * along[:, None])
    assert abs(along @ free.A @ along) < 1e-6 and abs(along @ free.b) < 1e-6
    joint = np.linalg.lstsq(np.c_[J, J @ along], r, rcond=None)[0]
    np.testing.assert_allclose(free.A @ joint[:6], free.b, atol=1e-6)
    np.testing.assert_allclose(exact.with_error(1e-9 * along[:, None]).A, J.T @ J, atol=1e-9)
    still = exact.with_error(np.zeros((6, 6)))
    np.testing.assert_allclose(still.A, exact.A, rtol=1e-12)


def test_the_rotation_step_is_the_least_squares_solution():
    rng = np.random.default_rng(5)
    J, r = rng.normal(size=(50, 6)), rng.normal(size=50)
    twist = System(J.T @ J, J.T @ r, 1.0, 50, np.zeros(3), 1.0).rotation_step()
    np.testing.assert_allclose(twist[3:], np.linalg.lstsq(J[:, 3:], r, rcond=None)[0], rtol=1e-8)
    assert not twist[:3].any()


@pytest.mark.parametrize("name", ["icp", "icp_rgbd"])
def test_a_first_guess_ten_degrees_off_ends_where_a_good_one_does(name):
    method, rotation = odometer(name), SE3.exp(np.array([0, 0, 0, 0.1, -0.12, 0.08]))
    one, other = (method.prepare(seen(T), CAMERA) for T in path(2))
    good, off = (method.align(one, other, guess) for guess in (SE3.identity(), rotation))
    assert off.status is Status.OK
    assert np.abs(off.T_reference_camera.matrix - good.T_reference_camera.matrix).max() < 1e-4


def test_an_unknown_odometer_names_the_known_ones():
    with pytest.raises(InputError, match="icp_rgbd"):
        odometer("orb")


def test_the_slip_of_2013_changes_the_path():
    frames = [seen(T) for T in path(3)]
    paper, slip = (
        tracked("icp_rgbd", frames, preset)[-1].T_world_camera.matrix
        for preset in ("paper", "kintinuous2013")
    )
    assert np.abs(paper - slip).max() > 1e-6
