"""Arrays from Python that cannot be what they should be: a warning, or an error with its cause."""

import warnings

import iclnuim
import numpy as np
import pytest
from iclnuim.doubt.given_arrays import doubt_of_depth, doubt_of_rgb
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

FRAMES = 40
STAMPS_S = 1 + np.arange(FRAMES) / 30
TWISTS = np.sin(np.outer(STAMPS_S, 1 + np.arange(6)))
MATRICES = SE3.exp(TWISTS).matrix
RGB = np.full((12, 16, 3), 0.4)
DEPTH_Z_M = np.full((12, 16), 2.0)


@pytest.mark.parametrize(
    ("median_m", "is_doubtful"), [(0.01, True), (0.05, False), (3.0, False), (2400.0, True)]
)
def test_depth_that_is_hardly_in_metres_is_doubted(median_m, is_doubtful):
    depth_z_m = np.full((4, 4), median_m)
    assert bool(doubt_of_depth(depth_z_m)) == is_doubtful
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        iclnuim.noisy_depth(depth_z_m, "none")
    assert bool(said) == is_doubtful


@pytest.mark.parametrize(("scale", "is_doubtful"), [(1.0, False), (255.0, True)])
def test_white_images_are_doubted(scale, is_doubtful):
    rgb = scale * np.random.default_rng(1).uniform(0.05, 0.9, (8, 8, 3))
    assert bool(doubt_of_rgb(rgb)) == is_doubtful


@pytest.mark.parametrize("depth_z_m", [0 * DEPTH_Z_M, -DEPTH_Z_M, np.nan * DEPTH_Z_M])
def test_depth_of_which_nothing_is_in_front_is_doubted(depth_z_m):
    with pytest.warns(UserWarning, match="no depth is above 0 m"):
        iclnuim.noisy_depth(depth_z_m, "none")


@pytest.mark.parametrize(
    ("rgb", "match"), [(0 * RGB, "is black"), (-RGB, "is black"), (np.nan * RGB, "are NaN")]
)
def test_black_and_invalid_images_are_doubted(rgb, match):
    with pytest.warns(UserWarning, match=match):
        iclnuim.noisy_rgb(rgb, "none")


def test_a_batch_is_doubted_once_at_the_line_that_gave_it():
    batch = np.stack([1000 * DEPTH_Z_M] * 3)
    with pytest.warns(UserWarning, match="may not be in metres") as said:
        iclnuim.noisy_depth(batch, "none")
    assert [one.filename for one in said] == [__file__]


@pytest.mark.parametrize(
    ("rgb", "depth_z_m", "match"),
    [
        (RGB, DEPTH_Z_M / 1000, "kilometres"),
        (RGB, 1000 * DEPTH_Z_M, "millimetres"),
        (RGB, 0 * DEPTH_Z_M, "no depth is above 0 m"),
        (255 * RGB, DEPTH_Z_M, "white or brighter"),
    ],
)
def test_a_sequence_of_such_images_is_doubted(tmp_path, rgb, depth_z_m, match):
    frames = iclnuim.frames_from("16x12", MATRICES[:3], lambda i: (rgb, depth_z_m))
    with pytest.warns(UserWarning, match=match):
        iclnuim.make_sequence(frames, tmp_path / "out", workers=1)


def test_a_right_sequence_is_not_doubted(tmp_path):
    frames = iclnuim.frames_from("16x12", MATRICES[:3], lambda i: (RGB, DEPTH_Z_M))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        iclnuim.make_sequence(frames, tmp_path / "out", workers=1)


def changed(change, rows=slice(None)):
    matrices = MATRICES.copy()
    matrices[rows] = change(matrices[rows])
    return matrices


@pytest.mark.parametrize(
    ("poses", "cause"),
    [
        (changed(lambda T: np.nan * T, rows=5), "NaN or infinity in pose 5"),
        (changed(lambda T: T @ np.diag([2.0, 2, 2, 1])), "rotations multiplied by 2"),
        (changed(lambda T: T @ np.diag([2.0, 2, 2, 1]), rows=[7]), "rotations multiplied by 2"),
        (changed(lambda T: T @ np.diag([1.0, 1, -1, 1])), "a reflection"),
        (np.swapaxes(MATRICES, 1, 2), "transposed matrices"),
        (np.swapaxes(MATRICES[:, :3], 1, 2), "transposed matrices"),
        (MATRICES[:, :3, :3], "which have positions, too"),
        (MATRICES[:, :3].reshape(-1, 12), r"reshape\(-1, 3, 4\)"),
        (MATRICES[0], "a list of it"),
        ((STAMPS_S, TWISTS), "found tuple"),
    ],
)
@pytest.mark.parametrize("error", [iclnuim.absolute_trajectory_error, iclnuim.relative_pose_error])
def test_poses_that_are_none_are_refused_with_the_cause(error, poses, cause):
    with pytest.raises(InputError, match=cause):
        error(MATRICES, poses)


def test_poses_of_a_trajectory_are_refused_with_the_cause():
    T = SE3.exp(TWISTS)
    with pytest.raises(InputError, match="pose 0 without them: a reflection"):
        Trajectory(STAMPS_S, SE3(-T.rotation, T.translation))
    with pytest.raises(InputError, match="pose 0 without them: rotations multiplied by 3"):
        Trajectory(STAMPS_S, SE3(3 * T.rotation, T.translation))


def test_rows_with_the_scalar_first_are_named():
    T = SE3.exp(TWISTS)
    rows = np.column_stack([STAMPS_S, T.translation, np.roll(T.quat_xyzw, 1, axis=1)])
    found = iclnuim.relative_pose_error(Trajectory(STAMPS_S, T), rows)
    assert "quaternions qw qx qy qz" in found.warnings[0]


def test_positions_in_millimetres_are_explained_in_both_measures():
    for error in (iclnuim.absolute_trajectory_error, iclnuim.relative_pose_error):
        (warning,) = error(MATRICES, 1000 * MATRICES[:, :3, 3]).warnings
        found = float(warning.split("instead of")[0].split()[-2])
        assert "multiplied by 0.001" in warning and found < 1e-6
