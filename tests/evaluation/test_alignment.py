"""Alignment: the least squares it promises, what it refuses, and mirrored estimates."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.align import AlignmentSettings, align, check_mirror, umeyama
from iclnuim.geometry import axes, so3
from iclnuim.geometry.se3 import SE3
from paired_poses import Pairs, absolute_error_of_pairs


def turned(angle, up):
    axis = np.eye(3)["xyz".index(up)]
    return SE3(so3.exp(angle * axis), [0.5, -2.0, 1.5])


@pytest.mark.parametrize("method", ["se3", "sim3"])
def test_the_error_does_not_depend_on_where_the_estimate_stands_or_how_large_it_is(wander, method):
    for seed in range(30):
        pairs, rng = wander(seed), np.random.default_rng(seed + 99)
        scale = 3.7 if method == "sim3" else 1.0
        moved = SE3.exp(rng.normal(size=6) * [50, 50, 50, 2, 2, 2]) @ pairs.estimate
        moved = Pairs.of_poses(pairs.reference, SE3(moved.rotation, scale * moved.translation))
        before, after = (
            absolute_error_of_pairs(p, AlignmentSettings(method)) for p in (pairs, moved)
        )
        assert np.allclose(
            before.translation_error_m, after.translation_error_m, rtol=0, atol=1e-11
        )
        assert np.allclose(before.rotation_error_rad, after.rotation_error_rad, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", ["origin", "se3", "sim3"])
def test_a_moved_copy_has_no_error(wander, method):
    for seed in range(20):
        pairs = wander(seed, noise=0.0)
        result = absolute_error_of_pairs(pairs, AlignmentSettings(method))
        assert result.translation_m.max < 1e-12 and result.rotation_deg.max < 1e-10
        assert result.alignment.scale == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_yaw_undoes_a_turn_about_its_axis_and_no_other(wander, up):
    for seed, angle in enumerate(np.linspace(-np.pi, np.pi, 13)):
        truth = wander(seed).reference
        pairs = Pairs.of_poses(truth, turned(angle, up) @ truth)
        assert (
            absolute_error_of_pairs(pairs, AlignmentSettings("yaw", up=up)).translation_m.max
            < 1e-12
        )
        other = "xyz"["xyz".index(up) - 1]
        T = align(
            pairs.reference, pairs.estimate, AlignmentSettings("yaw", up=other)
        ).T_reference_estimate
        assert np.allclose(
            T.rotation["xyz".index(other)], np.eye(3)["xyz".index(other)], atol=1e-15
        )


@pytest.mark.parametrize("method", ["yaw", "se3", "sim3"])
def test_no_small_motion_makes_the_aligned_positions_fit_better(wander, method):
    rng = np.random.default_rng(0)
    for seed in range(20):
        pairs = wander(seed)
        found = align(pairs.reference, pairs.estimate, AlignmentSettings(method))
        moved = found.apply(pairs.estimate).translation
        for _ in range(20):
            twist = rng.normal(0, 1e-3, 6) * ([1, 1, 1, 0, 0, 1] if method == "yaw" else 1)
            scale = 1 + rng.normal(0, 1e-3) if method == "sim3" else 1.0
            residual = pairs.reference.translation - SE3.exp(twist).apply(scale * moved)
            assert np.sqrt(np.square(residual).sum(axis=1).mean()) >= found.residual_rms_m


def test_alignment_on_the_first_poses_ignores_the_rest(wander):
    pairs = wander(3, noise=0.0, n=40)
    spoilt = SE3(
        pairs.estimate.rotation, pairs.estimate.translation + (np.arange(40) >= 20)[:, None]
    )
    result = absolute_error_of_pairs(
        Pairs.of_poses(pairs.reference, spoilt), AlignmentSettings("se3", first=20)
    )
    assert result.alignment.poses_used == 20
    assert result.translation_error_m[:20].max() < 1e-12
    assert np.allclose(result.translation_error_m[20:], np.sqrt(3))


def test_a_path_in_a_plane_is_aligned(wander):
    for seed in range(20):
        truth = wander(seed).reference
        flat = SE3(truth.rotation, truth.translation * [1, 1, 0])
        result = absolute_error_of_pairs(Pairs.of_poses(flat, SE3.exp(np.full(6, 0.7)) @ flat))
        assert result.translation_m.max < 1e-12
        assert np.linalg.det(result.alignment.T_reference_estimate.rotation) == pytest.approx(1)
        assert not result.mirror.mirrored


# -- what is refused
# ---------------------------------------------------------------------------------------------------


def line(pairs, length_m, wobble_m):
    """The same rotations along a line of that length, with a wobble across it."""
    t = np.linspace(0, 1, len(pairs.reference))
    return np.stack([length_m * t, wobble_m * np.sin(9 * t), wobble_m * np.cos(7 * t)], axis=1)


@pytest.mark.parametrize("method", ["se3", "sim3"])
@pytest.mark.parametrize(
    ("length_m", "wobble_m", "words"),
    [
        (
            0.0,
            0.0,
            "one that does not move, so its rotation is undetermined .* try the alignment origin",
        ),
        (2.0, 1e-5, "a straight one, .* the alignment yaw"),
    ],
)
@pytest.mark.parametrize("which", ["reference", "estimated"])
def test_a_still_or_straight_path_is_refused_with_a_weaker_alignment(
    wander, method, length_m, wobble_m, words, which
):
    pairs = wander(1)
    poor, good = SE3(pairs.reference.rotation, line(pairs, length_m, wobble_m)), pairs.reference
    case = Pairs.of_poses(poor, good) if which == "reference" else Pairs.of_poses(good, poor)
    with pytest.raises(InputError, match=f"{which} trajectory that determines .*{words}"):
        absolute_error_of_pairs(case, AlignmentSettings(method))
    assert absolute_error_of_pairs(case, AlignmentSettings("origin")).translation_error_m[0] < 1e-12


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_poses_are_refused(wander, count):
    pairs = wander(1)
    few = Pairs.of_poses(pairs.reference[:count], pairs.estimate[:count])
    with pytest.raises(InputError, match=f"{count} pose.* where 3 are needed"):
        absolute_error_of_pairs(few)
    with pytest.raises(InputError, match=f"{count} pose.* where 3 are needed"):
        absolute_error_of_pairs(pairs, AlignmentSettings("se3", first=count))


def test_a_straight_level_path_still_fixes_yaw_and_an_upright_one_does_not(wander):
    pairs = wander(1)
    level = SE3(pairs.reference.rotation, line(pairs, 2.0, 0.0))
    turned_level = Pairs.of_poses(level, turned(1.0, "z") @ level)
    assert absolute_error_of_pairs(turned_level, AlignmentSettings("yaw")).translation_m.max < 1e-12
    upright = SE3(
        level.rotation, level.translation[:, ::-1] - level.translation[:1, ::-1] * [1, 1, 0]
    )
    with pytest.raises(InputError, match="across the z axis.*the alignment origin"):
        absolute_error_of_pairs(Pairs.of_poses(upright, upright), AlignmentSettings("yaw"))


def test_a_path_thinner_than_its_error_is_called_uncertain(wander):
    pairs, rng = wander(1, n=100), np.random.default_rng(0)
    for wobble_m, uncertain in ((0.02, True), (0.5, False)):
        truth = SE3(pairs.reference.rotation, line(pairs, 3.0, wobble_m))
        estimate = SE3(truth.rotation, truth.translation + rng.normal(0, 0.05, (100, 3)))
        assert (
            absolute_error_of_pairs(Pairs.of_poses(truth, estimate)).alignment.rotation_is_noise
            == uncertain
        )


@pytest.mark.parametrize("settings", [{"method": "best"}, {"up": "w"}, {"first": 0}])
def test_alignment_settings_out_of_range_are_refused(settings):
    with pytest.raises(InputError):
        AlignmentSettings(**settings)


# -- mirrored
# ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["none", "origin", "se3", "sim3"])
def test_a_mirrored_estimate_is_recognised_and_an_honest_one_is_not(wander, method):
    for seed in range(40):
        pairs = wander(seed, noise=0.01, n=60)
        mirrored = Pairs.of_poses(pairs.reference, axes.mirrored_y(pairs.estimate))
        assert absolute_error_of_pairs(mirrored, AlignmentSettings(method)).mirror.mirrored
        assert not absolute_error_of_pairs(pairs, AlignmentSettings(method)).mirror.mirrored


def test_a_nearly_flat_path_is_called_mirrored_only_where_its_height_stands_out_of_the_error(
    wander,
):
    height_m = 0.02
    for seed in range(60):
        truth, rng = wander(seed, n=60).reference.translation, np.random.default_rng(seed)
        flat_m = truth * [1, 1, 0] + rng.normal(0, height_m, (60, 1)) * [0, 0, 1]
        for error_m, named in ((0.002, True), (0.02, False)):
            upside_down_m = flat_m * [1, 1, -1] + rng.normal(0, error_m, (60, 3))
            assert check_mirror(flat_m, upside_down_m).mirrored == named
            assert not check_mirror(flat_m, flat_m + rng.normal(0, error_m, (60, 3))).mirrored


def test_estimates_that_have_nothing_to_do_with_the_truth_are_not_called_mirrored(wander):
    for seed in range(300):
        a, b = wander(seed, n=30).reference, wander(seed + 1000, n=30).reference
        assert not check_mirror(a.translation, b.translation).mirrored


def test_the_official_office_path_mirrored_is_recognised(samples):
    from iclnuim.trajectory_files.trajectories import read_trajectory

    right = read_trajectory(samples / "or_kt0/traj0.gt.freiburg").trajectory.T_world_camera
    left = read_trajectory(
        samples / "or_kt0/traj0.gt.freiburg", "tum-ids"
    ).trajectory.T_world_camera
    result = absolute_error_of_pairs(Pairs.of_poses(right, left))
    assert result.mirror.mirrored
    assert result.mirror.reflection_rms_m < 1e-9 < 0.2 < result.translation_m.rmse
    assert not absolute_error_of_pairs(Pairs.of_poses(right, right)).mirror.mirrored


def test_the_best_reflection_is_one_and_undoes_a_reflection(wander):
    x = wander(5).reference.translation
    y = x * [1, 1, -1] * 2.0 + 3.0
    T, scale = umeyama(x, y, with_scale=True, reflect=True)
    assert np.linalg.det(T.rotation) == pytest.approx(-1)
    assert scale == pytest.approx(2.0) and np.allclose(T.apply(scale * x), y, atol=1e-12)
