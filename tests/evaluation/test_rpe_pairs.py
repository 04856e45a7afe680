"""RPE pairs: over seconds, frames and metres, judged by plain loops."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.relative_error import (
    RelativeErrorSettings,
    parse_delta,
    relative_error,
    rpe_pairs,
)
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from paired_poses import Pairs, relative_error_of_pairs


def seconds_by_loop(stamps_s, delta_s, tolerance, all_pairs):
    """Of each pose the later one nearest to delta from it, if within tolerance; or start where the
    last ended.
    """
    found, i = [], 0
    while i < len(stamps_s) - 1:
        off = [abs(stamps_s[j] - stamps_s[i] - delta_s) for j in range(i + 1, len(stamps_s))]
        end = i + 1 + int(np.argmin(off))
        good = min(off) <= tolerance * delta_s
        if good:
            found.append((i, end))
        i = end if good and not all_pairs else i + 1
    return found


def random_stamps(rng):
    """30 Hz with jitter, lost frames and a longer gap."""
    stamps_s = np.sort(np.arange(120) / 30 + rng.uniform(-0.012, 0.012, 120))
    kept = rng.random(120) > 0.1
    kept[40:55] = False
    return stamps_s[kept]


@pytest.mark.parametrize("all_pairs", [True, False])
def test_pairs_over_seconds_are_those_of_the_plain_loop(all_pairs):
    rng = np.random.default_rng(0)
    for _ in range(200):
        stamps_s, delta_s = random_stamps(rng), float(rng.uniform(0.05, 1.5))
        settings = RelativeErrorSettings(
            delta_s, "seconds", all_pairs, tolerance=float(rng.choice([0.02, 0.1, 0.5]))
        )
        by_loop = seconds_by_loop(stamps_s, delta_s, settings.tolerance, all_pairs)
        if not by_loop:
            with pytest.raises(InputError, match="seconds apart"):
                rpe_pairs(stamps_s, np.zeros((len(stamps_s), 3)), settings)
            continue
        start, end = rpe_pairs(stamps_s, np.zeros((len(stamps_s), 3)), settings)
        assert list(zip(start.tolist(), end.tolist(), strict=True)) == by_loop


def test_rpe_over_seconds_is_the_error_of_the_motions_between_those_poses(wander):
    for seed in range(20):
        pairs = wander(seed, rate_hz=10.0)
        ours = relative_error_of_pairs(pairs, RelativeErrorSettings(0.5, "seconds"))
        assert (
            ours.start.tolist() == list(range(len(pairs.reference) - 5))
            and (ours.end - ours.start == 5).all()
        )
        for k, metres, radians in zip(
            ours.start, ours.translation_error_m, ours.rotation_error_rad, strict=True
        ):
            Q = pairs.reference[k].inverse() @ pairs.reference[k + 5]
            P = pairs.estimate[k].inverse() @ pairs.estimate[k + 5]
            E = Q.inverse() @ P
            assert metres == pytest.approx(np.linalg.norm(E.translation), abs=1e-12)
            assert radians == pytest.approx(np.linalg.norm(E.log()[3:]), abs=1e-12)


def test_a_camera_that_rests_counts_its_first_pose_at_each_place():
    x = np.array([0, 0, 0.5, 0.5, 0.5, 1.0, 1.0, 1.5])
    positions_m = np.stack([x, 0 * x, 0 * x], axis=1)
    start, end = rpe_pairs(np.arange(8.0), positions_m, RelativeErrorSettings(0.5, "metres"))
    assert list(zip(start.tolist(), end.tolist(), strict=True)) == [
        (0, 2),
        (1, 2),
        (2, 5),
        (3, 5),
        (4, 5),
        (5, 7),
        (6, 7),
    ]


def test_of_two_poses_equally_far_from_delta_the_earlier_one_ends_the_pair():
    start, end = rpe_pairs(
        np.arange(4) / 4, np.zeros((4, 3)), RelativeErrorSettings(0.375, "seconds", tolerance=0.5)
    )
    assert list(zip(start.tolist(), end.tolist(), strict=True)) == [(0, 1), (1, 2), (2, 3)]


def test_relative_error_does_not_depend_on_where_the_estimate_stands(wander):
    for seed in range(20):
        pairs = wander(seed)
        moved = Pairs.of_poses(pairs.reference, SE3.exp([9, -5, 3, 1, 2, -1]) @ pairs.estimate)
        a, b = (relative_error_of_pairs(p, RelativeErrorSettings(2)) for p in (pairs, moved))
        assert np.allclose(a.translation_error_m, b.translation_error_m, rtol=0, atol=1e-12)
        assert np.allclose(a.rotation_error_rad, b.rotation_error_rad, rtol=0, atol=1e-12)


def test_metres_are_counted_along_the_truth_unless_told_otherwise(wander):
    pairs = wander(4, noise=0.0)
    doubled = Pairs.of_poses(
        pairs.reference, SE3(pairs.estimate.rotation, 2 * pairs.estimate.translation)
    )
    plain, same = (
        relative_error_of_pairs(p, RelativeErrorSettings(0.8, "metres")) for p in (pairs, doubled)
    )
    other = relative_error_of_pairs(
        doubled, RelativeErrorSettings(0.8, "metres", measured_on="estimate")
    )
    assert same.end.tolist() == plain.end.tolist() != other.end.tolist()
    corrected = relative_error_of_pairs(
        doubled, RelativeErrorSettings(0.8, "metres", measured_on="estimate", correct_scale=True)
    )
    assert corrected.scale == pytest.approx(0.5) and corrected.end.tolist() == plain.end.tolist()


def test_lost_frames_are_associated_by_time_before_rpe_pairs_are_formed(wander):
    pairs = wander(6, noise=0.0, n=40)
    truth, kept = Trajectory(pairs.stamps_s, pairs.reference), np.r_[0:10, 20:40]
    estimate = Trajectory(pairs.stamps_s + 0.004, pairs.estimate)[kept]
    result = relative_error(truth, estimate, RelativeErrorSettings(5 / 30, "seconds"))
    assert result.translation_m.max < 1e-12
    assert len(result.association) == 30 and len(result.start) == 20


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("10", (10, "frames")),
        ("0.5s", (0.5, "seconds")),
        ("1m", (1, "metres")),
        (".5 m", (0.5, "metres")),
    ],
)
def test_deltas_are_read_with_their_unit(text, value):
    assert parse_delta(text) == value


@pytest.mark.parametrize("text", ["", "m", "-1", "1km", "nan", "1e3s", "one"])
def test_deltas_without_sense_are_refused(text):
    with pytest.raises(InputError, match="a delta such as 10"):
        parse_delta(text)


@pytest.mark.parametrize(
    "settings",
    [
        {"delta": 0.0},
        {"delta": 1.5},
        {"unit": "miles"},
        {"tolerance": 1.0},
        {"measured_on": "both"},
        {"delta": float("nan")},
    ],
)
def test_relative_error_settings_out_of_range_are_refused(settings):
    with pytest.raises(InputError):
        RelativeErrorSettings(**settings)
