"""Stamps paired by the TUM rule: closest first, ties by the first stamp, then by the second, each used once."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.associate import AssociationSettings, associate


def sorted_loop(first, second, window):
    """The rule as it is written, over all pairs."""
    candidates = sorted((abs(a - b), a, b, i, j) for i, a in enumerate(first) for j, b in enumerate(second) if abs(a - b) < window)
    taken_i, taken_j, pairs = set(), set(), []
    for _, _, _, i, j in candidates:
        if i not in taken_i and j not in taken_j:
            taken_i.add(i)
            taken_j.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def windowed_loop(first, second, window):
    """The same for long lists, candidates found by bisection."""
    low, candidates = np.searchsorted(second, first - window), []
    high = np.searchsorted(second, first + window, side="right")
    for i, (a, lo, hi) in enumerate(zip(first.tolist(), low.tolist(), high.tolist(), strict=True)):
        candidates += [(abs(a - second[j]), i, j) for j in range(lo, hi) if abs(a - second[j]) < window]
    taken_i, taken_j, pairs = set(), set(), []
    for _, i, j in sorted(candidates):
        if i not in taken_i and j not in taken_j:
            taken_i.add(i)
            taken_j.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def ours(first, second, window):
    found = associate(np.array(first), np.array(second), AssociationSettings(max_difference_s=window))
    return list(zip(found.first.tolist(), found.second.tolist(), strict=True))


def test_greedy_pairs_are_those_of_the_plain_sorted_loop():
    rng = np.random.default_rng(0)
    for _ in range(300):
        first, second = (np.unique(rng.uniform(0, 2, int(rng.integers(1, 40)))) for _ in range(2))
        window = rng.choice([0.005, 0.02, 0.1, 0.5])
        assert ours(first, second, window) == sorted_loop(first, second, window)


def test_ties_go_to_the_first_stamp_and_then_to_the_second():
    rng = np.random.default_rng(1)
    for _ in range(300):
        first, second = (np.unique(rng.integers(0, 60, int(rng.integers(1, 30)))) / 8.0 for _ in range(2))
        window = float(rng.choice([0.2, 0.26, 0.6, 1.1]))
        assert ours(first, second, window) == sorted_loop(first, second, window)


def drifting(n, seed):
    rng = np.random.default_rng(seed)
    first = np.arange(n) / 30 + rng.uniform(-0.004, 0.004, n)
    second = np.arange(n) / 30 * (1 + 2e-6) + 0.003 + rng.uniform(-0.004, 0.004, n)
    return np.sort(first), np.sort(second)


def test_long_lists_with_jitter_and_drift_pair_as_the_sorted_loop_does():
    first, second = drifting(20_000, 2)
    assert ours(first, second, 0.02) == windowed_loop(first, second, 0.02)


@pytest.mark.slow
def test_a_million_stamps_pair_as_the_sorted_loop_does():
    first, second = drifting(1_000_000, 3)
    assert ours(first, second, 0.02) == windowed_loop(first, second, 0.02)


def test_nearest_gives_each_estimate_its_nearest_truth():
    rng = np.random.default_rng(4)
    for _ in range(100):
        first, second = (np.unique(rng.uniform(0, 2, int(rng.integers(1, 40)))) for _ in range(2))
        found = associate(first, second, AssociationSettings("nearest", 0.1))
        gaps = np.abs(first[:, None] - second[None])
        inside = np.flatnonzero(gaps.min(0) < 0.1)
        assert sorted(found.second.tolist()) == inside.tolist()
        assert np.allclose(np.abs(found.difference_s), gaps.min(0)[found.second])


def test_settings_out_of_range_are_refused():
    for settings in ({"method": "best"}, {"max_difference_s": 0.0}, {"max_difference_s": float("nan")}, {"offset_s": float("inf")}):
        with pytest.raises(InputError):
            AssociationSettings(**settings)
