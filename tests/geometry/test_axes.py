"""Changes of axes: each there and back, and each against what a camera sees."""

import numpy as np
import pytest
from iclnuim.geometry import axes
from iclnuim.geometry.se3 import SE3


@pytest.fixture
def poses(twists) -> SE3:
    return SE3.exp(twists)


@pytest.mark.parametrize(
    ("there", "back"),
    [
        (axes.world_cv_from_pov, axes.pov_from_world_cv),
        (axes.mirrored_y, axes.mirrored_y),
        (axes.world_blender_from_world_cv, axes.world_cv_from_world_blender),
    ],
)
def test_there_and_back_changes_nothing(poses, there, back):
    np.testing.assert_allclose(back(there(poses)).matrix, poses.matrix, atol=1e-15)
    np.testing.assert_allclose(there(back(poses)).matrix, poses.matrix, atol=1e-15)


@pytest.mark.parametrize(
    "change",
    [
        axes.world_cv_from_pov,
        axes.pov_from_world_cv,
        axes.mirrored_y,
        axes.world_blender_from_world_cv,
    ],
)
def test_a_change_of_axes_keeps_rotations_proper(poses, change):
    np.testing.assert_allclose(np.linalg.det(change(poses).rotation), 1, atol=1e-13)


def test_a_point_seen_by_the_pov_camera_is_seen_by_the_cv_camera(poses):
    points_pov_camera = np.random.default_rng(0).normal(size=(len(poses), 3))
    points_pov_world = (poses.rotation @ points_pov_camera[..., None])[..., 0] + poses.translation
    points_world = points_pov_world @ axes.WORLD_FROM_POV.T
    seen = axes.world_cv_from_pov(poses).inverse().apply(points_world[:, None])[:, 0]
    # the same pixel: x right and z forward alike, y down instead of up
    np.testing.assert_allclose(seen, points_pov_camera * (1, -1, 1), atol=1e-12)


def test_the_pov_world_is_mirrored_into_ours():
    np.testing.assert_array_equal(axes.WORLD_FROM_POV @ (1.0, 2.0, 3.0), (-1.0, -3.0, 2.0))
    assert np.linalg.det(axes.WORLD_FROM_POV) == pytest.approx(-1)


def test_the_pov_world_goes_through_the_obj_world():
    np.testing.assert_array_equal(axes.Z_UP_FROM_Y_UP @ np.diag([-1.0, 1, 1]), axes.WORLD_FROM_POV)


@pytest.mark.parametrize(
    "matrix", [axes.Z_UP_FROM_Y_UP, axes.Z_UP_FROM_Y_DOWN, axes.CV_FROM_BLENDER_CAMERA]
)
def test_changes_between_right_handed_frames_are_rotations(matrix):
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_mirroring_y_is_two_signs_of_the_quaternion_and_one_of_the_position(poses):
    mirrored, signs = axes.mirrored_y(poses), np.array([-1, 1, -1, 1])
    np.testing.assert_array_equal(mirrored.translation, poses.translation * (1, -1, 1))
    expected = SE3.from_quat_xyzw(poses.quat_xyzw * signs, mirrored.translation)
    np.testing.assert_allclose(mirrored.rotation, expected.rotation, atol=1e-14)


def test_mirroring_y_respects_composition(poses):
    np.testing.assert_allclose(
        axes.mirrored_y(poses[:-1] @ poses[1:]).matrix,
        (axes.mirrored_y(poses[:-1]) @ axes.mirrored_y(poses[1:])).matrix,
        atol=1e-13,
    )


def test_blenders_camera_looks_along_its_negative_z_with_y_up():
    blender = axes.world_blender_from_world_cv(SE3.identity())
    np.testing.assert_array_equal(blender.apply(np.array([0.0, 0, -1])), (0, 0, 1))
    np.testing.assert_array_equal(blender.apply(np.array([0.0, 1, 0])), (0, -1, 0))
