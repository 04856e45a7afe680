"""Stamps paired by the TUM rule: closest first, ties by the first stamp, then by the second, each
used once.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation import associate as module
from iclnuim.evaluation.associate import AssociationSettings, associate, pair_up
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory


def sorted_loop(first, second, window):
    """The rule as it is written: all pairs in the window, sorted, each stamp used once."""
    low, candidates = np.searchsorted(second, first - 2 * window), []
    high = np.searchsorted(second, first + 2 * window)
    second = second.tolist()
    for i, (a, lo, hi) in enumerate(zip(first.tolist(), low.tolist(), high.tolist(), strict=True)):
        candidates += [
            (abs(a - second[j]), i, j) for j in range(lo, hi) if abs(a - second[j]) < window
        ]
    taken_i, taken_j, pairs = set(), set(), []
    for _, i, j in sorted(candidates):
        if i not in taken_i and j not in taken_j:
            taken_i.add(i)
            taken_j.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def ours(first, second, window, **settings):
    found = associate(first, second, AssociationSettings(max_difference_s=window, **settings))
    return list(zip(found.first.tolist(), found.second.tolist(), strict=True))


def drifting(n, seed):
    """30 Hz with jitter of 4 ms against the same on a clock that runs 20 parts in a million fast."""
    rng = np.random.default_rng(seed)
    first = np.arange(n) / 30 + rng.normal(0, 0.004, n)
    second = np.arange(n) / 30 * (1 + 2e-5) + 0.003 + rng.normal(0, 0.004, n)
    return np.sort(first), np.sort(second)


def test_greedy_pairs_are_those_of_the_plain_sorted_loop():
    rng = np.random.default_rng(0)
    for _ in range(500):
        first, second = (np.unique(rng.uniform(0, 2, int(rng.integers(1, 60)))) for _ in range(2))
        window = float(rng.choice([0.005, 0.02, 0.1, 0.5, 10.0]))
        assert ours(first, second, window) == sorted_loop(first, second, window)


def test_ties_go_to_the_first_stamp_and_then_to_the_second():
    rng = np.random.default_rng(1)
    for _ in range(500):
        first, second = (
            np.unique(rng.integers(0, 60, int(rng.integers(1, 40)))) / 8.0 for _ in range(2)
        )
        window = float(rng.choice([0.2, 0.26, 0.6, 1.1]))
        assert ours(first, second, window) == sorted_loop(first, second, window)


@pytest.mark.parametrize("window", [0.02, 0.05, 0.3])
def test_long_chains_of_equal_or_growing_gaps_pair_as_the_sorted_loop_does(window):
    half_a_step_off = np.arange(3000) / 32
    growing = np.cumsum(0.01 + 1e-7 * np.arange(6000))
    for first, second in (
        (half_a_step_off, half_a_step_off + 1 / 64),
        (growing[::2], growing[1::2]),
    ):
        assert ours(first, second, window) == sorted_loop(first, second, window)


def test_the_heap_alone_gives_the_same_pairs():
    rng = np.random.default_rng(2)
    for _ in range(200):
        first, second = (
            np.unique(rng.integers(0, 200, int(rng.integers(1, 60)))) / 16.0 for _ in range(2)
        )
        i, j = module._greedy_by_heap(first, second, 0.7)
        assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == sorted_loop(first, second, 0.7)


def test_many_stamps_far_from_their_partners_are_looked_at_a_constant_number_of_times(monkeypatch):
    rng, pushed = np.random.default_rng(3), []
    heappush = module.heapq.heappush
    monkeypatch.setattr(
        module.heapq, "heappush", lambda heap, item: (pushed.append(1), heappush(heap, item))
    )
    first, second = np.unique(rng.uniform(0, 1, 50_000)), np.unique(rng.uniform(0, 10_000, 50_000))
    assert len(ours(first, second, 1e9)) == min(len(first), len(second))
    assert 0 < len(pushed) < 2 * (len(first) + len(second))


def test_the_offset_is_added_to_the_second_stamps():
    first, second = drifting(500, 4)
    assert ours(first, second - 100, 0.02, offset_s=100.0) == sorted_loop(
        first, second - 100 + 100.0, 0.02
    )
    assert ours(first, second - 100, 0.02) == []


def test_stamps_with_jitter_and_drift_are_searched_a_few_times_and_never_in_the_heap(monkeypatch):
    searched, nearest = [], module.nearest
    monkeypatch.setattr(module, "nearest", lambda x, y: (searched.append(len(x)), nearest(x, y))[1])
    monkeypatch.setattr(module, "_greedy_by_heap", None)
    first, second = drifting(1_000_000, 5)
    assert len(associate(first, second)) > 900_000
    assert sum(searched) < 3 * (len(first) + len(second))


@pytest.mark.slow
def test_a_million_stamps_pair_as_the_sorted_loop_does():
    first, second = drifting(1_000_000, 6)
    assert ours(first, second, 0.02) == sorted_loop(first, second, 0.02)


def test_long_lists_with_jitter_and_drift_pair_as_the_sorted_loop_does():
    first, second = drifting(30_000, 7)
    assert ours(first, second, 0.02) == sorted_loop(first, second, 0.02)


def test_nearest_gives_each_estimate_its_nearest_truth():
    rng = np.random.default_rng(8)
    for _ in range(200):
        first, second = (np.unique(rng.uniform(0, 2, int(rng.integers(1, 40)))) for _ in range(2))
        found = associate(first, second, AssociationSettings("nearest", 0.1))
        gaps = np.abs(first[:, None] - second[None])
        inside = np.flatnonzero(gaps.min(axis=0) < 0.1)
        assert found.second.tolist() == inside.tolist()
        assert found.first.tolist() == gaps.argmin(axis=0)[inside].tolist()
        assert found.coverage == len(set(found.first.tolist())) / len(first)


def test_of_several_pairs_of_one_truth_the_closest_in_time_counts():
    found = associate(
        np.array([0.0, 1.0]), np.array([-0.3, 0.1, 0.4, 1.2]), AssociationSettings("nearest", 0.5)
    )
    assert found.first.tolist() == [0, 0, 0, 1]
    assert found.closest_per_first().tolist() == [1, 3]


@pytest.mark.parametrize(
    "settings",
    [
        {"method": "best"},
        {"max_difference_s": 0.0},
        {"max_difference_s": float("nan")},
        {"offset_s": float("inf")},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(InputError):
        AssociationSettings(**settings)


@pytest.mark.parametrize("stamps", [[0.0, 0.0], [1.0, 0.5], [0.0, float("nan")], [[0.0, 1.0]]])
def test_stamps_that_repeat_or_run_backwards_are_refused(stamps):
    with pytest.raises(InputError, match="strictly increasing"):
        associate(np.array(stamps), np.array([0.0]))


def test_no_overlap_in_time_is_named_with_the_offset_that_would_mend_it():
    first, second = (
        Trajectory(start + np.arange(20) / 30, SE3.identity((20,))) for start in (5.0, 1305.0)
    )
    with pytest.raises(
        InputError, match=r"no overlap in time: 1305.000..1305.633 s; try an offset of -1300 s "
    ):
        pair_up(first, second)
    assert len(pair_up(first, second, AssociationSettings(offset_s=-1300.0))) == 20


def test_an_overlap_without_a_pair_in_the_window_is_named():
    first, second = (
        Trajectory(start + np.arange(20.0), SE3.identity((20,))) for start in (0.0, 0.5)
    )
    with pytest.raises(InputError, match="within 0.02 s .* try a larger difference"):
        pair_up(first, second)


@pytest.mark.parametrize("power", [1, 2, 3])
@pytest.mark.parametrize("of", ["its stamps", "the ground truth's stamps"])
def test_stamps_in_another_unit_of_time_are_named(power, of):
    units = {1: "milliseconds", 2: "microseconds", 3: "nanoseconds"}
    seconds = Trajectory(np.arange(1, 41) / 10, SE3.identity((40,)))
    late = Trajectory(seconds.stamps_s[10:] * 1000.0**power, SE3.identity((30,)))
    pair = (seconds, late) if of == "its stamps" else (late, seconds)
    with pytest.raises(InputError, match=f"try {of} divided by 10+, if they are {units[power]}"):
        pair_up(*pair)


@pytest.mark.parametrize(
    ("times_as_long", "is_named"), [(0.3, False), (0.4, True), (2.5, True), (3.5, False)]
)
def test_stamps_are_in_another_unit_if_the_two_last_nearly_as_long(times_as_long, is_named):
    """A part of a sequence, or one that goes on after it, but at most three times as long."""
    seconds = Trajectory(np.arange(200) / 10, SE3.identity((200,)))
    other_s = 1000 * times_as_long * seconds.stamps_s + 1e6
    with pytest.raises(InputError) as refused:
        pair_up(seconds, Trajectory(other_s, SE3.identity((200,))))
    assert ("divided by 1000, if they are milliseconds" in str(refused.value)) == is_named


def test_a_short_part_of_a_long_ground_truth_is_in_no_other_unit():
    truth = Trajectory(np.arange(40_000) / 10, SE3.identity((40_000,)))
    assert len(pair_up(truth, truth[500:540])) == 40
    with pytest.raises(InputError, match="offset"):
        pair_up(truth, Trajectory(4100 + np.arange(200) / 10, SE3.identity((200,))))
