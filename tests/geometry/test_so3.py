"""Rotations: laws, and SciPy as the judge."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from scipy.spatial.transform import Rotation


def test_exp_agrees_with_scipy(rotation_vectors):
    np.testing.assert_allclose(
        so3.exp(rotation_vectors), Rotation.from_rotvec(rotation_vectors).as_matrix(), atol=1e-14
    )


def test_exp_gives_rotations(rotation_vectors):
    m = so3.exp(rotation_vectors)
    np.testing.assert_allclose(
        np.swapaxes(m, 1, 2) @ m, np.broadcast_to(np.eye(3), m.shape), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(m), 1, atol=1e-14)


def test_log_inverts_exp(rotation_vectors):
    np.testing.assert_allclose(
        so3.log(so3.exp(rotation_vectors)), rotation_vectors, rtol=1e-10, atol=3e-15
    )


def test_exp_inverts_log_at_exactly_half_a_turn():
    axes = np.random.default_rng(0).normal(size=(200, 3))
    m = so3.exp(
        np.pi
        * np.concatenate(
            [axes / np.linalg.norm(axes, axis=1, keepdims=True), np.eye(3), -np.eye(3)]
        )
    )
    np.testing.assert_allclose(so3.exp(so3.log(m)), m, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(so3.log(m), axis=1), np.pi, atol=1e-14)


def test_angle_is_the_length_of_the_rotation_vector(rotation_vectors):
    expected = np.linalg.norm(rotation_vectors, axis=1)
    np.testing.assert_allclose(
        so3.angle(so3.exp(rotation_vectors)), expected, rtol=1e-10, atol=3e-15
    )


def test_log_of_the_identity_is_exactly_zero():
    assert (so3.log(np.eye(3)) == 0).all()
    assert so3.angle(np.eye(3)) == 0


def test_quaternions_agree_with_scipy(rotation_vectors):
    judge = Rotation.from_rotvec(rotation_vectors)
    quat = so3.quat_xyzw_from_matrix(judge.as_matrix())
    expected = judge.as_quat()
    same_sign = np.sign((quat * expected).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(quat, same_sign * expected, atol=1e-14)
    np.testing.assert_allclose(so3.matrix_from_quat_xyzw(expected), judge.as_matrix(), atol=1e-14)


def test_quaternions_have_length_one_and_no_negative_scalar(rotation_vectors):
    quat = so3.quat_xyzw_from_matrix(so3.exp(rotation_vectors))
    assert (quat[:, 3] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(quat, axis=1), 1, atol=1e-15)


def test_a_quaternion_and_its_negative_are_one_rotation(rotation_vectors):
    quat = so3.quat_xyzw_from_matrix(so3.exp(rotation_vectors))
    np.testing.assert_array_equal(so3.matrix_from_quat_xyzw(quat), so3.matrix_from_quat_xyzw(-quat))


def test_hat_is_the_cross_product():
    a, b = np.random.default_rng(1).normal(size=(2, 50, 3))
    np.testing.assert_allclose((so3.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize(
    "share", [1 - 0.999 * so3.QUAT_NORM_TOLERANCE, 1 + 0.999 * so3.QUAT_NORM_TOLERANCE]
)
def test_a_quaternion_not_quite_of_length_one_is_normalised(rotation_vectors, share):
    quat = so3.quat_xyzw_from_matrix(so3.exp(rotation_vectors))
    np.testing.assert_allclose(
        so3.matrix_from_quat_xyzw(quat * share), so3.matrix_from_quat_xyzw(quat), atol=1e-14
    )


@pytest.mark.parametrize(
    "length",
    [0, 1 - 1.01 * so3.QUAT_NORM_TOLERANCE, 1 + 1.01 * so3.QUAT_NORM_TOLERANCE, 2, np.nan, np.inf],
)
def test_a_quaternion_further_from_length_one_is_refused(length):
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    quat[3, 3] = length
    with pytest.raises(InputError, match="quaternions of length 1"):
        so3.matrix_from_quat_xyzw(quat)


def test_float32_input_is_computed_in_double(rotation_vectors):
    single = rotation_vectors.astype(np.float32)
    m = so3.exp(single)
    assert m.dtype == np.float64
    np.testing.assert_array_equal(m, so3.exp(single.astype(float)))
    quat = so3.quat_xyzw_from_matrix(m).astype(np.float32)
    np.testing.assert_allclose(so3.matrix_from_quat_xyzw(quat), m, atol=1e-6)


def test_a_matrix_off_by_rounding_becomes_the_nearest_rotation(rotation_vectors):
    m = so3.exp(rotation_vectors)
    rounded = so3.nearest_rotation(m.astype(np.float32))
    np.testing.assert_allclose(
        np.swapaxes(rounded, 1, 2) @ rounded, np.broadcast_to(np.eye(3), m.shape), atol=1e-14
    )
    np.testing.assert_allclose(rounded, m, atol=2e-7)


def test_a_matrix_that_is_no_rotation_is_refused():
    for matrix in (
        np.eye(3) * 1.01,
        np.zeros((3, 3)),
        np.full((3, 3), np.nan),
        np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
    ):
        with pytest.raises(InputError, match="rotation matrices"):
            so3.nearest_rotation(np.stack([np.eye(3), matrix]))


def test_a_reflection_is_named():
    with pytest.raises(InputError, match="found a reflection"):
        so3.nearest_rotation(np.diag([1.0, -1.0, 1.0]))


def test_leading_shapes_are_kept():
    w = np.random.default_rng(4).normal(size=(2, 3, 4, 3)) * 0.5
    assert so3.exp(w).shape == (2, 3, 4, 3, 3)
    np.testing.assert_allclose(so3.log(so3.exp(w)), w, atol=1e-13)
    assert so3.exp(np.zeros((0, 3))).shape == (0, 3, 3)
    assert so3.log(np.zeros((0, 3, 3))).shape == (0, 3)
