"""Explanations of depth that does not agree with poses compete: the right one is named, and none
where the images cannot tell.
"""

import collections
from dataclasses import replace

import numpy as np
import pytest
from corrupted_sequence import KINDS, corrupted
from iclnuim.doubt import depth_against_poses
from iclnuim.doubt.depth_against_poses import agreement
from iclnuim.doubt.depth_pairs import DepthPairs, depth_residuals
from iclnuim.doubt.posed_depth import PosedDepth
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from moving_box import CAMERA, depth_z_m, hand_held, kinect

#: The residual as read of sequences that count, as a multiple of that of the right data.
COUNTED = 2


def named(found):
    """The kinds that were found, joined."""
    return " ".join(found.kinds)


def outcome(seed, kind=None):
    """The kind, the kind that was named, whether it was noticed, and the multiple of the residual
    with the right poses and depth.
    """
    case = corrupted(seed, kind)
    found = agreement(case.load, case.read, CAMERA)
    load = case.load
    if case.kind == "ray":
        rays = np.linalg.norm(CAMERA.rays(), axis=-1)

        def load(i):
            return case.load(i) / rays

    right = depth_residuals(load, [case.right], CAMERA)[0]
    return case.kind, named(found), found.doubtful, found.residual / right


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_what_is_read_wrongly_is_named(kind, seed):
    _, kinds, noticed, multiple = outcome(seed, kind)
    assert noticed or multiple < COUNTED
    assert kinds == kind or multiple < COUNTED


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_named_in_right_sequences(seed):
    _, kinds, noticed, _ = outcome(seed, "")
    assert not kinds and not noticed


@pytest.mark.slow
def test_a_thousand_corrupted_sequences_and_half_as_many_right_ones():
    counts = collections.Counter()
    for seed in range(1000):
        kind, kinds, noticed, multiple = outcome(seed)
        counted = "counted" if multiple >= COUNTED else "rest"
        counts[counted, "all"] += 1
        counts[counted, "noticed"] += noticed
        counts[counted, "right" if kinds == kind else "wrong"] += bool(kinds)
    assert counts["counted", "noticed"] >= 0.98 * counts["counted", "all"]
    assert counts["counted", "right"] >= 0.9 * counts["counted", "all"]
    assert counts["counted", "wrong"] <= 0.02 * counts["counted", "all"]
    assert not counts["rest", "wrong"]
    assert not any(outcome(seed, "")[2] for seed in range(500))


def test_the_unit_is_measured_to_half_a_percent():
    T = hand_held(30, seed=4)
    millimetres = SE3(T.rotation, 1000 * T.translation)
    found = agreement(lambda i: kinect(depth_z_m(T[i]), i), millimetres, CAMERA)
    assert named(found) == "unit"
    assert found.changes[0].parameters["factor"] == pytest.approx(0.001, rel=5e-3)


def test_a_smaller_unit_is_no_better_by_itself():
    """Depth and poses in other units of the same ratio have the same relative residual."""
    T = hand_held(12, seed=4)
    small = SE3(T.rotation, 0.1 * T.translation)
    depth_m = [kinect(depth_z_m(pose), seed=1) for pose in T]
    in_metres = agreement(depth_m.__getitem__, T, CAMERA)
    smaller = agreement(lambda i: 0.1 * depth_m[i], small, CAMERA)
    assert not smaller.doubtful
    assert smaller.residual == pytest.approx(in_metres.residual, rel=1e-3)


def test_a_camera_that_does_not_move_cannot_tell():
    T = hand_held(24, seed=1, extent=1e-4)
    larger = SE3(T.rotation, 1.5 * T.translation)
    for poses in (T, T.inverse(), larger):
        found = agreement(lambda i: kinect(depth_z_m(T[i]), i), poses, CAMERA)
        assert not found.told and not found.doubtful
    assert not agreement(lambda i: depth_z_m(T[i]), T[:2], CAMERA).told


def test_poses_of_another_sequence_do_not_match_and_are_not_explained():
    T = hand_held(40, seed=1)
    found = agreement(lambda i: depth_z_m(T[i]), hand_held(40, seed=2, extent=2), CAMERA)
    assert not found.matches and not named(found)


@pytest.mark.slow
def test_poses_that_move_while_the_camera_stands_do_not_match_and_are_not_explained():
    still = SE3.identity((40,))
    found = agreement(lambda i: depth_z_m(still[i]), hand_held(40, seed=2), CAMERA)
    assert not found.matches and not named(found)


def test_a_thing_that_moves_through_the_images_explains_nothing():
    T = hand_held(24, seed=3)

    def load(i):
        depth_m = depth_z_m(T[i])
        depth_m[:, 5 * i : 5 * i + 24] = 1.0
        return depth_m

    assert not agreement(load, T, CAMERA).doubtful


def test_errors_of_a_good_estimate_are_not_in_doubt():
    """Five millimetres and a quarter of a degree between frames."""
    T = hand_held(24, seed=3)
    noise = np.random.default_rng(1).normal(0, 1, (24, 6)) * ([0.003] * 3 + [0.002] * 3)
    found = agreement(lambda i: depth_z_m(T[i]), T @ SE3.exp(noise), CAMERA)
    assert not found.doubtful


@pytest.mark.parametrize(("extent", "kind"), [(0.06, ""), (0.08, "unit")])
def test_an_explanation_has_at_most_half_of_the_residual(extent, kind):
    """With three times the distances the residual is 1.9 and 2.3 times that of the right poses."""
    T = hand_held(30, seed=5, extent=extent)
    larger = SE3(T.rotation, 3 * T.translation)
    found = agreement(lambda i: kinect(depth_z_m(T[i]), i), larger, CAMERA)
    assert named(found) == kind


@pytest.mark.parametrize(("millimetres", "matches"), [(20, True), (40, False)])
def test_what_nothing_explains_is_a_mismatch_above_two_percent_of_depth(millimetres, matches):
    T = hand_held(24, seed=3)
    sizes = millimetres * np.array([1e-3] * 3 + [5e-4] * 3)
    noise = SE3.exp(np.random.default_rng(1).normal(0, sizes, (24, 6)))
    found = agreement(lambda i: depth_z_m(T[i]), T @ noise, CAMERA)
    assert found.matches == matches and not named(found)
    assert found.residual == pytest.approx(0.02, rel=0.6)


def test_an_error_of_the_camera_is_the_cameras():
    """Depth that is eight pixels beside where the camera says, without noise."""
    T = hand_held(40, seed=6)
    found = agreement(lambda i: np.roll(depth_z_m(T[i]), 8, axis=1), T, CAMERA)
    fx, fy, cx, cy = found.changes[0].parameters.values()
    assert named(found) == "camera" and (fx, fy) == pytest.approx((CAMERA.fx, CAMERA.fy), 1e-3)
    assert (cx, cy) == pytest.approx((CAMERA.cx + 8, CAMERA.cy), abs=0.5)


@pytest.mark.parametrize("factor", [0.95, 1.25])
def test_another_focal_length_is_measured_to_a_percent(factor):
    T = hand_held(40, seed=6)
    other = replace(CAMERA, fx=factor * CAMERA.fx, fy=factor * CAMERA.fy)
    found = agreement(lambda i: kinect(depth_z_m(T[i]), i), T, other)
    fx, fy, _, _ = found.changes[0].parameters.values()
    assert named(found) == "camera"
    assert (fx, fy) == pytest.approx((CAMERA.fx, CAMERA.fy), rel=0.01)


def test_a_lever_arm_is_measured_and_called_no_unit():
    T = hand_held(40, seed=6)
    arm = SE3(np.eye(3), np.array([0.0, -0.1, 0.02]))
    found = agreement(lambda i: depth_z_m(T[i]), T @ arm.inverse(), CAMERA)
    assert named(found) == "arm"
    assert found.changes[0].parameters["arm_m"] == pytest.approx(arm.translation, abs=5e-3)


def test_a_lever_arm_under_another_unit_is_measured_in_metres():
    T = hand_held(40, seed=6)
    arm = SE3(np.eye(3), np.array([0.0, -0.1, 0.02]))
    body = T @ arm.inverse()
    found = agreement(
        lambda i: depth_z_m(T[i]), SE3(body.rotation, 1000 * body.translation), CAMERA
    )
    assert named(found) == "unit arm"
    assert found.changes[0].parameters["factor"] == pytest.approx(0.001, rel=5e-3)
    assert found.changes[1].parameters["arm_m"] == pytest.approx(arm.translation, abs=5e-3)


@pytest.mark.parametrize("factor", [3.0, pytest.param(0.01, marks=pytest.mark.slow)])
def test_a_unit_and_a_camera_that_are_wrong_at_once_are_both_named(factor):
    """Depth without noise, twelve pixels beside where the camera says."""
    T = hand_held(40, seed=6)
    other = SE3(T.rotation, factor * T.translation)
    found = agreement(lambda i: np.roll(depth_z_m(T[i]), 12, axis=1), other, CAMERA)
    assert named(found) == "unit camera"
    unit, camera = (change.parameters for change in found.changes)
    assert unit["factor"] == pytest.approx(1 / factor, rel=0.01)
    assert camera["cx"] == pytest.approx(CAMERA.cx + 12, abs=1)


def test_what_is_below_the_noise_of_a_pixel_is_explained_if_many_pixels_tell():
    """Blocks of 8 x 8 pixels have an eighth of the noise: right poses leave a seventh of it, and
    distances of 1.7 times their size not even a half.
    """
    camera = PinholeCamera.parse("640x480")
    T = hand_held(12, seed=5)
    rng = np.random.default_rng(0)
    noise = 1 + rng.normal(0, 0.02, (12, 480, 640))
    depth_m = [depth_z_m(pose, camera) * each for pose, each in zip(T, noise, strict=True)]
    found = agreement(depth_m.__getitem__, SE3(T.rotation, 1.7 * T.translation), camera)
    assert found.residual < 0.5 * 0.674 * 0.02 and named(found) == "unit"
    assert found.changes[0].parameters["factor"] == pytest.approx(1 / 1.7, rel=0.01)


@pytest.mark.parametrize("size", ["160x120", "320x240"])
def test_right_poses_leave_the_noise_of_blocks_of_few_pixels(size):
    camera = PinholeCamera.parse(size)
    T = hand_held(12, seed=5)
    pairs = DepthPairs.of(lambda i: kinect(depth_z_m(T[i], camera), i), T, camera)
    assert PosedDepth.of(pairs, T).is_right


def test_two_mistakes_are_not_looked_for_below_the_noise_of_a_pixel(monkeypatch):
    T = hand_held(12, seed=5)
    camera = PinholeCamera.parse("640x480")
    searched = []
    chains = depth_against_poses.screened
    monkeypatch.setattr(
        depth_against_poses,
        "screened",
        lambda few, tried: chains(few, searched.append(max(map(len, tried))) or tried),
    )
    found = agreement(lambda i: kinect(depth_z_m(T[i], camera), i), T, camera)
    assert found.matches and not found.changes
    assert searched == [1]


def test_depth_with_holes_everywhere_is_not_a_mismatch():
    T = hand_held(24, seed=3)
    seen = np.random.default_rng(1).random((120, 160)) < 0.3
    seen[:40] = True
    seen[:, ::3] = False
    found = agreement(lambda i: np.where(seen, depth_z_m(T[i]), 0), T, CAMERA)
    assert not found.doubtful
