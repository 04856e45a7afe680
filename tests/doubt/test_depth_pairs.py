"""Depth images agree with the right poses of their frames, and not with others."""

import numpy as np
import pytest
from iclnuim.doubt.depth_blocks import DepthBlocks
from iclnuim.doubt.depth_pairs import DepthPairs, depth_residuals
from iclnuim.geometry.se3 import SE3
from moving_box import CAMERA, depth_z_m, hand_held, kinect


def shifted(T, frames):
    return T[np.clip(np.arange(len(T)) + frames, 0, len(T) - 1)]


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("frames", [6, 12, 60])
def test_the_right_poses_have_the_smallest_residual(frames, noisy):
    T = hand_held(frames, seed=frames)

    def load(i):
        exact = depth_z_m(T[i])
        return kinect(exact, seed=i) if noisy else exact

    larger = SE3(T.rotation, 1.3 * T.translation)
    right, *others = depth_residuals(load, [T, shifted(T, 1), larger, T.inverse()], CAMERA)
    assert right < (4e-3 if noisy else 1e-3)
    assert min(others) > (1.3 if noisy else 5) * right


def test_images_that_cannot_be_read_are_left_out():
    T = hand_held(12, seed=1)
    depth = [depth_z_m(pose) for pose in T]
    depth[0] = None
    depth[3] = depth[3][:60]
    depth[5] = np.zeros_like(depth[5])
    pairs = DepthPairs.of(depth.__getitem__, T, CAMERA)
    assert {*pairs.first, *pairs.second} == set(range(12)) - {0, 3, 5}
    assert pairs.residuals(pairs.relative(T)).max() < 2e-3
    assert np.isnan(depth_residuals(lambda i: None, [T, T], CAMERA)).all()


def test_the_block_of_a_plane_has_the_inverse_depth_of_its_middle():
    inverse = 0.3 + CAMERA.rays() @ [0.05, 0.1, 0.0]
    blocks = DepthBlocks.of(1 / inverse, CAMERA)
    assert np.allclose(blocks.inverse_per_m[3, 5], inverse[6:8, 10:12].mean(), rtol=1e-6)
    plane = blocks.points_m @ [0.05, 0.1, 0.3]
    assert np.allclose(plane, 1, atol=1e-6)
    assert blocks.noise < 1e-6


def of_a_wall():
    """A pair of images of a wall 2 m away."""
    wall = DepthBlocks.of(np.full((120, 160), 2.0), CAMERA)
    return DepthPairs.between(np.array([0]), np.array([1]), {0: wall, 1: wall})


def moved(translation_m):
    return SE3(np.eye(3)[None], np.array([translation_m], float))


def test_the_residual_is_the_difference_relative_to_depth():
    pairs = of_a_wall()
    found = pairs.differences(moved([0, 0, 0.1]))
    assert np.allclose(found[np.isfinite(found)], 0.1 / 2.05, rtol=1e-3)
    assert np.isinf(pairs.differences(moved([0, 0, -3.0]))).all()


@pytest.mark.parametrize(("share", "counts"), [(0.5, False), (0.75, True)])
def test_points_that_leave_the_image_do_not_agree_if_they_are_most(share, counts):
    """A wall that the camera slides along: what is still seen agrees exactly. Of points that leave,
    those beyond 40 % count: a tenth against a half is not the median, a third against a quarter is.
    """
    aside_m = share * 2.0 * CAMERA.width / CAMERA.fx
    assert (of_a_wall().residuals(moved([aside_m, 0.0, 0.0]))[0] > 0.1) == counts


def test_pairs_are_chosen_where_the_motion_varies():
    """A camera that turns steadily, but for four slower frames in forty, tells there alone whether
    its poses are those of the next frames.
    """
    is_slow = np.arange(240) % 40 // 4 == 1
    turns = np.zeros((240, 6))
    turns[:, 4] = np.cumsum(np.where(is_slow, 0.01, 0.02))
    T = hand_held(1, seed=1)[0] @ SE3.exp(turns)
    right, late = depth_residuals(lambda i: depth_z_m(T[i]), [T, shifted(T, 1)], CAMERA)
    assert right < 1e-6 and late > 1e-3
