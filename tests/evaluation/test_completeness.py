"""Statistics, the scores that count missing frames, and frozen results."""

import dataclasses

import numpy as np
import pytest
from iclnuim.evaluation.absolute_error import (
    RECALL_M,
    Completeness,
    ErrorStatistics,
    absolute_error,
)
from iclnuim.geometry.trajectory import Trajectory


def test_rmse_is_mean_and_standard_deviation_together():
    rng = np.random.default_rng(0)
    for _ in range(50):
        found = ErrorStatistics.of(rng.exponential(0.1, int(rng.integers(1, 30))))
        assert found.rmse**2 == pytest.approx(found.mean**2 + found.std**2)
        assert found.min <= found.median <= found.max


def test_the_area_under_the_curve_is_the_mean_recall_over_all_thresholds():
    rng = np.random.default_rng(1)
    for _ in range(20):
        errors_m, frames = rng.exponential(0.05, 50), 80
        found = Completeness.of(errors_m, frames)
        thresholds_m = (np.arange(20_000) + 0.5) / 20_000 * RECALL_M[-1]
        recalls = (errors_m[None] <= thresholds_m[:, None]).sum(axis=1) / frames
        assert found.area_under_curve == pytest.approx(recalls.mean(), abs=1e-4)
        assert found.recall == {bound: (errors_m <= bound).sum() / frames for bound in RECALL_M}
        assert found.coverage == 50 / 80


def test_an_estimator_that_gives_up_keeps_its_ate_and_loses_recall(wander):
    pairs = wander(2, noise=0.01, n=200)
    truth, estimate = (
        Trajectory(pairs.stamps_s, poses) for poses in (pairs.reference, pairs.estimate)
    )
    whole, half = absolute_error(truth, estimate), absolute_error(truth, estimate[:100])
    assert half.translation_m.rmse == pytest.approx(whole.translation_m.rmse, rel=0.2)
    assert half.completeness.coverage == 0.5 and whole.completeness.coverage == 1.0
    assert half.completeness.area_under_curve < 0.6 * whole.completeness.area_under_curve
    assert half.completeness.recall[0.10] <= 0.5


def test_results_cannot_be_changed(wander):
    pairs = wander(2)
    result = absolute_error(
        *(Trajectory(pairs.stamps_s, poses) for poses in (pairs.reference, pairs.estimate))
    )
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.alignment = None
    for array in (result.translation_error_m, result.association.first, result.alignment.extents_m):
        with pytest.raises(ValueError):
            array[0] = 0


def test_recall_is_the_share_of_frames_within_one_five_and_ten_centimetres():
    """One error below and one above each of the three thresholds."""
    errors_m = np.array([0.009, 0.011, 0.049, 0.051, 0.099, 0.101])
    values = Completeness.of(errors_m, 8).to_dict()
    shares = {"1cm": 1 / 8, "5cm": 3 / 8, "10cm": 5 / 8}
    assert values["recall"] == pytest.approx(shares)
