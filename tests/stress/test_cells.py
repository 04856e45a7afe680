"""The figures of a cell, on poses made by hand: what counts as wrong, as noticed, as a false alarm."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from iclnuim.benchmark.experiments.outcome import Poses, diagnostics, outcome, track_all
from iclnuim.benchmark.odometry.protocol import OdometryResult, OdometryStatus
from iclnuim.benchmark.odometry.registry import odometer
from iclnuim.benchmark.odometry.track import Tracked
from iclnuim.benchmark.perturbations.plan import Bounds
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

BOUNDS = Bounds()


def poses(truth, jumps_m=(), bad=(), missing=()):
    """A method's word on every frame of `truth`: along it but for jumps (frame, metres), flagged in
    `bad`, lost in `missing`.
    """
    offset = np.zeros((len(truth), 3))
    for frame, metres in jumps_m:
        offset[frame:, 0] += metres
    moved = Trajectory(
        truth.stamps_s, SE3(truth.T_world_camera.rotation, truth.positions_m + offset)
    )
    kept = np.setdiff1d(np.arange(len(truth)), missing)
    alarms = truth.stamps_s[sorted({*bad, *missing} - {0})]
    return Poses(moved[kept], ~np.isin(kept, bad), alarms, len(truth))


@pytest.mark.parametrize(
    ("given", "clean", "expected"),
    [
        (
            {},
            True,
            {
                "wrong": 0,
                "false_successes": 0,
                "false_alarms": 0,
                "noticed_after": None,
                "success": True,
            },
        ),
        # a jump of 3 cm is wrong in its step alone; one of 6 cm also over the second before frames
        # 28 to 39
        (
            {"jumps_m": [(10, 0.03)]},
            False,
            {"wrong": 1, "false_successes": 1, "noticed_after": None},
        ),
        ({"jumps_m": [(10, 0.06)]}, False, {"wrong": 1 + 12, "false_successes": 1 + 12}),
        (
            {"jumps_m": [(10, 0.03)], "bad": [10]},
            False,
            {"wrong": 1, "false_successes": 0, "noticed_after": 0},
        ),
        (
            {"jumps_m": [(10, 0.06)], "bad": [10]},
            False,
            {"wrong": 13, "false_successes": 0, "alarms": 1},
        ),
        ({"jumps_m": [(10, 0.06)], "bad": [14]}, False, {"false_successes": 1, "noticed_after": 4}),
        ({"bad": range(48)}, True, {"false_alarms": 48, "false_successes": 0}),
        ({"missing": [20, 21]}, True, {"false_alarms": 2, "coverage": 46 / 48, "success": True}),
        ({"missing": [20, 21]}, False, {"false_alarms": 0}),
        ({"missing": range(16, 48)}, False, {"coverage": 1 / 3, "success": False}),
        ({"jumps_m": [(24, 0.5)]}, False, {"success": False}),
        ({"missing": range(48)}, False, {"ate_m": None, "success": False, "coverage": 0}),
    ],
)
def test_what_is_said_is_held_against_what_is_true(truth, given, clean, expected):
    found = asdict(outcome(poses(truth, **given), truth, BOUNDS, clean))
    assert {
        key: pytest.approx(found[key]) if key == "coverage" else found[key] for key in expected
    } == expected


def moved(truth, motions):
    """Poses along `truth` but for a twist (n, 6) in each camera's frame."""
    found = Trajectory(truth.stamps_s, truth.T_world_camera @ SE3.exp(motions))
    return Poses(found, np.ones(len(truth), bool), np.array([]), len(truth))


def ramp(truth, metres=0.0, degrees=0.0):
    """A drift by so much in a second."""
    rate = np.array([metres, 0, 0, 0, np.radians(degrees), 0])
    return (truth.stamps_s - truth.stamps_s[0])[:, None] * rate


def jump(truth, metres=0.0, degrees=0.0):
    """A jump at frame 24: less than a second later, no drift over a second can be measured."""
    motion = np.array([metres, 0, 0, 0, np.radians(degrees), 0])
    return np.where(np.arange(len(truth))[:, None] < 24, 0, motion)


def shake(truth, metres):
    """Every other pose is off to one side, so that alignment changes nothing."""
    side = np.where(np.arange(len(truth)) % 2, metres, -metres)
    return side[:, None] * np.array([1, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("motions", "figure", "small", "large"),
    [
        (lambda truth, by: jump(truth, metres=by), "wrong", 0.015, 0.03),
        (lambda truth, by: jump(truth, degrees=by), "wrong", 0.75, 1.5),
        (lambda truth, by: ramp(truth, metres=by), "wrong", 0.04, 0.07),
        (lambda truth, by: ramp(truth, degrees=by), "wrong", 1.5, 3.0),
        (lambda truth, by: -shake(truth, by), "success", 0.15, 0.07),
    ],
    ids=["step", "turn", "drift", "turn over a second", "ATE"],
)
def test_a_pose_is_wrong_and_a_run_fails_beyond_its_bound_alone(
    truth, motions, figure, small, large
):
    """By default 2 cm and 1 degree a step, 5 cm and 2 degrees over a second, an ATE of 10 cm."""
    found = [
        getattr(outcome(moved(truth, motions(truth, by)), truth, BOUNDS, True), figure)
        for by in (small, large)
    ]
    assert [bool(value) for value in found] == [False, True]


def test_an_alarm_at_the_first_frame_of_a_window_is_of_the_motion_before_it(truth):
    """The window is (a, b]: the drift over the second before frame 36 begins at frame 6."""
    drift = np.where(np.arange(len(truth))[:, None] < 36, 0, [[0.06, 0, 0, 0, 0, 0]])
    jumped = moved(truth, drift)
    for alarm in (6, 7, 36, 37):
        alarms_s = truth.stamps_s[[alarm]]
        good = np.arange(len(truth)) != 36  # the wrong step itself is reported
        found = outcome(replace(jumped, good=good, alarms_s=alarms_s), truth, BOUNDS, False)
        assert found.wrong == 12
        # of the windows that end at frames 37 to 47, those without the alarm
        assert found.false_successes == sum(not end - 30 < alarm <= end for end in range(37, 48))


def test_under_constrained_frames_are_the_cause_from_a_tenth_on(truth):
    def cause(count):
        made = []
        for k, stamp_s in enumerate(truth.stamps_s):
            status = OdometryStatus.DEGENERATE if 0 < k <= count else OdometryStatus.OK
            made.append(
                Tracked(stamp_s, SE3.identity(), OdometryResult(SE3.identity(), status=status))
            )
        return diagnostics(made, {}, truth, None)["cause"]

    assert cause(3) == "" and cause(6) == "13% under-constrained"  # of 47


def test_nees_of_errors_drawn_from_the_stated_covariance_is_one(truth):
    rng, sigma = np.random.default_rng(1), np.array([0.001, 0.002, 0.003, 0.0005, 0.001, 0.002])
    information = np.diag(1 / sigma**2)
    tracked, pairs = [], {}
    for i in np.tile(np.arange(1, len(truth)), 4):
        true = truth.T_world_camera[i - 1].inverse() @ truth.T_world_camera[i]
        said = SE3.exp(-sigma * rng.standard_normal(6)) @ true
        result = OdometryResult(
            said, information=information, largest_sigma_m=0.003, residual=1.0, inliers=0.9
        )
        tracked.append(Tracked(truth.stamps_s[i], truth.T_world_camera[i], result))
        pairs[truth.stamps_s[i]] = truth.stamps_s[i - 1]
    assert diagnostics(tracked, pairs, truth, None)["nees"] == pytest.approx(1, abs=0.15)


def test_the_cause_is_what_the_diagnostics_say(truth):
    def told(clean=None, **result):
        made = [
            Tracked(t, SE3.identity(), OdometryResult(SE3.identity(), **result))
            for t in truth.stamps_s
        ]
        return diagnostics(made, {}, truth, clean)["cause"]

    clean = outcome(poses(truth), truth, BOUNDS, True, {"inliers": 0.9, "residual": 1.0})
    assert told(clean, inliers=0.85, residual=1.1) == ""
    assert told(clean, inliers=0.45, residual=1.1) == "inliers 45% instead of 90%"
    assert told(clean, inliers=0.85, residual=3.0) == "residual 3.0 times as large"
    assert told(clean, status=OdometryStatus.DEGENERATE) == "100% under-constrained"
    assert told(
        status=OdometryStatus.FAILED, reason="depth: only 1.2% of the pixels have any"
    ).startswith("100% lost: depth:")


def test_a_fitness_that_is_too_small_is_a_flag_of_open3d_and_not_of_ours(truth):
    good = [
        Tracked(t, T, OdometryResult(T, inliers=0.9))
        for t, T in zip(truth.stamps_s, truth.T_world_camera, strict=True)
    ]
    low = [replace(f, result=replace(f.result, inliers=0.2)) for f in good]
    enough = [replace(f, result=replace(f.result, inliers=0.4)) for f in good]
    fitness = BOUNDS.min_fitness
    assert (
        Poses.of(good, fitness).good.all()
        and not Poses.of(low, fitness).good.any()
        and Poses.of(enough, fitness).good.all()
        and Poses.of(low).good.all()
    )


def test_a_method_that_crashes_loses_its_frames_and_the_others_go_on(segment):
    class Crashing:
        name, reference = "crashing", "frame"

        def prepare(self, frame, camera):
            return frame

        def align(self, reference, current, guess):
            raise np.linalg.LinAlgError("Singular matrix")

    (crashed, pairs), (tracked, _) = track_all([Crashing(), odometer("icp")], segment)
    assert all(f.lost and f.result.reason == "crashed: LinAlgError" for f in crashed[1:])
    assert not any(f.lost for f in tracked)
    assert "crashed: LinAlgError" in diagnostics(crashed, pairs, segment.truth, None)["cause"]


def test_the_cause_of_lost_frames_has_the_number_of_the_median_one(truth):
    made = []
    for k, stamp_s in enumerate(truth.stamps_s):
        reason = f"depth: only {0.1 * k:.1f}% of the pixels have depth"
        failed = OdometryResult(SE3.identity(), status=OdometryStatus.FAILED, reason=reason)
        made.append(Tracked(stamp_s, SE3.identity(), failed))
    middle = 0.1 * (1 + (len(made) - 1) // 2)
    cause = diagnostics(made, {}, truth, None)["cause"]
    assert cause == f"100% lost: depth: only {middle:.1f}% of the pixels have depth"
