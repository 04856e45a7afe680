"""Rigid motions: the axioms of a group, exp and log, both quaternion orders; SciPy as the judge."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from scipy.linalg import expm
from scipy.spatial.transform import Rotation


def assert_same(a: SE3, b: SE3, atol: float = 1e-13) -> None:
    np.testing.assert_allclose(a.matrix, np.broadcast_to(b.matrix, a.matrix.shape), atol=atol)


@pytest.fixture
def poses(twists) -> SE3:
    return SE3.exp(twists)


def shuffled(poses: SE3, seed: int) -> SE3:
    return poses[np.random.default_rng(seed).permutation(len(poses))]


def test_composition_is_associative(poses):
    a, b, c = poses, shuffled(poses, 1), shuffled(poses, 2)
    assert_same((a @ b) @ c, a @ (b @ c))


def test_composition_is_the_matrix_product(poses):
    other = shuffled(poses, 1)
    np.testing.assert_allclose((poses @ other).matrix, poses.matrix @ other.matrix, atol=1e-14)


def test_the_identity_changes_nothing(poses):
    assert_same(SE3.identity() @ poses, poses, 0)
    assert_same(poses @ SE3.identity(poses.shape), poses, 0)


def test_the_inverse_undoes(poses):
    assert_same(poses @ poses.inverse(), SE3.identity())
    assert_same(poses.inverse() @ poses, SE3.identity())
    assert_same(poses.inverse().inverse(), poses)


def test_the_inverse_of_a_product_is_the_product_of_inverses_in_reverse(poses):
    other = shuffled(poses, 1)
    assert_same((poses @ other).inverse(), other.inverse() @ poses.inverse())


def test_apply_is_the_action_of_the_group(poses):
    points = np.random.default_rng(5).normal(size=(len(poses), 4, 3))
    other = shuffled(poses, 1)
    np.testing.assert_allclose(
        (poses @ other).apply(points), poses.apply(other.apply(points)), atol=1e-13
    )
    np.testing.assert_allclose(poses.inverse().apply(poses.apply(points)), points, atol=1e-13)


def test_apply_agrees_with_scipy(twists):
    poses, judge = SE3.exp(twists), Rotation.from_rotvec(twists[:, 3:])
    point = np.array([0.3, -2.0, 5.0])
    np.testing.assert_allclose(
        poses.apply(point), judge.apply(point) + poses.translation, atol=1e-13
    )


def test_one_pose_serves_points_of_any_shape():
    pose = SE3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3]))
    points = np.random.default_rng(0).normal(size=(4, 5, 3))
    np.testing.assert_allclose(pose.apply(points)[2, 3], pose.apply(points[2, 3]), atol=1e-15)


def test_log_inverts_exp(twists):
    np.testing.assert_allclose(SE3.exp(twists).log(), twists, rtol=1e-9, atol=1e-11)


def test_exp_agrees_with_the_matrix_exponential_of_scipy(twists):
    for twist in twists[::50]:
        generator = np.zeros((4, 4))
        v, w = twist[:3], twist[3:]
        generator[:3, :3] = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
        generator[:3, 3] = v
        np.testing.assert_allclose(SE3.exp(twist).matrix, expm(generator), atol=1e-13)


def test_exp_of_a_sum_along_one_axis_is_the_product(twists):
    assert_same(SE3.exp(0.3 * twists) @ SE3.exp(0.7 * twists), SE3.exp(twists))


def test_quaternions_are_scalar_last_and_come_back(poses):
    assert_same(SE3.from_quat_xyzw(poses.quat_xyzw, poses.translation), poses)
    np.testing.assert_allclose(
        Rotation.from_quat(poses.quat_xyzw).as_matrix(), poses.rotation, atol=1e-14
    )


def test_matrices_of_three_and_four_rows_are_taken(poses):
    assert_same(SE3.from_matrix(poses.matrix), poses)
    assert_same(SE3.from_matrix(poses.matrix[:, :3]), poses)


def test_float32_matrices_are_taken(poses):
    single = SE3.from_matrix(poses.matrix.astype(np.float32))
    assert single.rotation.dtype == single.translation.dtype == np.float64
    assert_same(single, poses, 2e-6)
    assert_same(single.inverse() @ single, SE3.identity())


def test_interpolation_meets_both_ends_and_moves_evenly(poses):
    a, b = poses, poses @ SE3.exp(np.random.default_rng(1).normal(size=(len(poses), 6)) * 0.5)
    assert_same(a.interpolate(b, 0.0), a)
    assert_same(a.interpolate(b, 1.0), b, 1e-12)
    quarter = a.interpolate(b, 0.25)
    assert_same(quarter, a.interpolate(a.interpolate(b, 0.5), 0.5), 1e-12)
    assert_same(a.interpolate(b, 0.75), b.interpolate(a, 0.25), 1e-12)


def test_arrays_are_read_only_and_no_alias_of_the_input():
    translation = np.zeros(3)
    pose = SE3(np.eye(3), translation)
    translation[0] = 7
    assert pose.translation[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1


def test_indexing_picks_poses():
    poses = SE3.exp(np.random.default_rng(0).normal(size=(4, 5, 6)) * 0.4)
    assert poses[1].shape == (5,)
    assert_same(poses[1, 2], SE3(poses.rotation[1, 2], poses.translation[1, 2]), 0)
    assert poses[:, ::2].shape == (4, 3)
    with pytest.raises(IndexError):
        poses[0, 0][0]


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(2), r"matrices \(\.\.\., 3, 4\)"),
        (np.diag([1.0, 1, 1, 2]), "last row of 0 0 0 1"),
        (np.full((4, 4), np.nan), "."),
        (np.diag([1.0, 1, -1, 1]), "reflection"),
        (np.diag([2.0, 1, 1, 1]), "rotation matrices"),
    ],
)
def test_matrices_that_are_no_poses_are_refused(matrix, message):
    with pytest.raises(InputError, match=message):
        SE3.from_matrix(matrix)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="rotation"):
        SE3(np.eye(3), np.zeros((2, 3)))
