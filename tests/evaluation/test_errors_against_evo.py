"""ATE and RPE equal evo's, an independent judge, on a thousand random cases; errors do not depend on the estimate's frame."""

import copy

import numpy as np
import pytest
from iclnuim.evaluation.absolute_error import absolute_error_of_pairs
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.pairs import Pairs
from iclnuim.evaluation.relative_error import relative_error_of_pairs
from iclnuim.evaluation.stretches import StretchSettings
from iclnuim.geometry.se3 import SE3

trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is the judge")
from evo.core import metrics  # noqa: E402

CASES = 1000
STATISTICS = ("rmse", "mean", "median", "std", "min", "max")


def random_pair(seed):
    """A wandering path and an estimate of it that drifts, turned and moved as a whole."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 40))
    steps = SE3.exp(rng.normal(size=(n, 6)) * 0.2)
    poses = [SE3.identity()]
    for k in range(n):
        poses.append(poses[-1] @ steps[k])
    truth = SE3(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    noise = SE3.exp(rng.normal(size=(n + 1, 6)) * 0.05)
    return truth, SE3.exp(rng.normal(size=6)) @ truth @ noise


def evo_path(T):
    return trajectory.PosePath3D(poses_se3=list(T.matrix))


def equal(ours, theirs):
    mine = {name: getattr(ours, name) for name in STATISTICS}
    judge = theirs.get_all_statistics()
    for name in STATISTICS:
        assert mine[name] == pytest.approx(judge[name], rel=1e-9, abs=1e-9), name


def evo_ape(truth, estimate, method):
    reference, path = evo_path(truth), evo_path(copy.deepcopy(estimate))
    if method == "origin":
        path.align_origin(reference)
    elif method != "none":
        path.align(reference, correct_scale=method == "sim3")
    metric = metrics.APE(metrics.PoseRelation.translation_part)
    metric.process_data((reference, path))
    return metric


def test_all_six_ate_statistics_equal_evo_on_a_thousand_cases():
    for seed in range(CASES):
        truth, estimate = random_pair(seed)
        method = ("none", "origin", "se3", "sim3")[seed % 4]
        ours = absolute_error_of_pairs(Pairs.of_poses(truth, estimate), AlignmentSettings(method))
        equal(ours.translation_m, evo_ape(truth, estimate, method))


def test_rpe_over_frames_and_metres_equals_evo_on_a_thousand_cases():
    compared = 0
    for seed in range(CASES):
        truth, estimate = random_pair(seed)
        unit, delta = (("frames", 1 + seed % 3), ("metres", 0.5 + 0.1 * (seed % 4)))[seed % 2]
        all_pairs = seed % 4 < 2
        evo_unit = metrics.Unit.frames if unit == "frames" else metrics.Unit.meters
        judge = metrics.RPE(metrics.PoseRelation.translation_part, delta, evo_unit, all_pairs=all_pairs, rel_delta_tol=0.1)
        settings = StretchSettings(float(delta), unit, all_pairs, 0.1, "estimate")
        pairs = Pairs.of_poses(truth, estimate)
        try:
            judge.process_data((evo_path(truth), evo_path(estimate)))
        except metrics.filters.FilterException:
            continue
        if len(judge.error) == 0:
            continue
        equal(relative_error_of_pairs(pairs, settings).translation_m, judge)
        compared += 1
    assert compared > 0.9 * CASES


def test_rpe_over_seconds_takes_the_pose_nearest_in_time():
    truth, estimate = random_pair(3)
    n = len(truth)
    pairs = Pairs.of_poses(truth, estimate, rate_hz=10.0)
    ours = relative_error_of_pairs(pairs, StretchSettings(0.5, "seconds", True, 0.1))
    by_hand = []
    for k in range(n - 5):
        q, p = truth[k].inverse() @ truth[k + 5], estimate[k].inverse() @ estimate[k + 5]
        by_hand.append(np.linalg.norm((q.inverse() @ p).translation))
    assert np.allclose(ours.translation_error_m, by_hand, atol=1e-12)


@pytest.mark.parametrize("method", ["se3", "sim3"])
def test_the_error_does_not_depend_on_where_the_estimate_stands(method):
    for seed in range(20):
        truth, estimate = random_pair(seed)
        moved = SE3.exp(np.random.default_rng(seed + 99).normal(size=6)) @ estimate
        if method == "sim3":
            moved = SE3(moved.rotation, 3.7 * moved.translation)
        a, b = (absolute_error_of_pairs(Pairs.of_poses(truth, e), AlignmentSettings(method)) for e in (estimate, moved))
        assert np.allclose(a.translation_error_m, b.translation_error_m, atol=1e-10)
        assert np.allclose(a.rotation_error_rad, b.rotation_error_rad, atol=1e-7)


def test_a_mirrored_estimate_is_recognised_and_an_honest_one_is_not():
    for seed in range(20):
        truth, estimate = random_pair(seed)
        mirrored = SE3(estimate.rotation, estimate.translation * [1, -1, 1])
        exact = SE3(truth.rotation, truth.translation * [1, -1, 1])
        assert absolute_error_of_pairs(Pairs.of_poses(truth, exact)).mirror.mirrored
        assert not absolute_error_of_pairs(Pairs.of_poses(truth, estimate)).mirror.mirrored
        assert mirrored.translation.shape == truth.translation.shape


@pytest.mark.parametrize(("path", "words"), [("still", "one still"), ("straight", "one straight"), ("short", "2 poses where 3")])
def test_a_path_that_does_not_fix_the_alignment_is_refused(path, words):
    from iclnuim.errors import InputError

    truth, estimate = random_pair(1)
    if path == "short":
        truth, estimate = truth[:2], estimate[:2]
    else:
        line = np.zeros((len(truth), 3)) if path == "still" else np.arange(len(truth))[:, None] * [1.0, 0, 0]
        truth, estimate = SE3(truth.rotation, line), SE3(truth.rotation, line + 0.0)
    with pytest.raises(InputError, match=words):
        absolute_error_of_pairs(Pairs.of_poses(truth, estimate), AlignmentSettings("se3"))
    absolute_error_of_pairs(Pairs.of_poses(truth, estimate), AlignmentSettings("origin"))
