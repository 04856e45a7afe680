"""An offset and a scale of the stamps are found where they are, advised only where they make the
error far smaller, and evo agrees with what is advised.
"""

import re

import numpy as np
import pytest
from iclnuim.doubt.explained_error import measured
from iclnuim.doubt.time_axis import TimeAxis, best_offset, best_scales, rms_m
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.associate import AssociationSettings
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import read_trajectory
from judges import judge_module


def estimate_of(truth, shift_s, noise=0.003, every=1, seed=0):
    """Moved as a whole, noisy by pose, its stamps later by `shift_s`."""
    rng = np.random.default_rng(seed)
    poses = (
        SE3.exp(rng.normal(size=6))
        @ truth.T_world_camera
        @ SE3.exp(rng.normal(0, noise, (len(truth), 6)))
    )
    return Trajectory(truth.stamps_s + shift_s, poses)[::every]


def drifted(truth, noise, seed):
    """What an odometer makes of it: errors add up."""
    T = truth.T_world_camera
    steps = (
        T[:-1].inverse()
        @ T[1:]
        @ SE3.exp(np.random.default_rng(seed).normal(0, noise, (len(T) - 1, 6)))
    )
    poses = [np.eye(4)]
    for step in steps.matrix:
        poses.append(poses[-1] @ step)
    return Trajectory(truth.stamps_s, SE3.from_matrix(np.array(poses)))


@pytest.mark.parametrize("every", [1, 15])
@pytest.mark.parametrize("shift_s", [0.0, 1.0, -1.0, 0.5, -0.0125, 6.4, -1305031102.25])
def test_the_offset_is_found(walk, shift_s, every):
    estimate = estimate_of(walk, shift_s, 0.001, every)
    axis = best_offset(walk, estimate)
    assert axis.offset_s == pytest.approx(-shift_s, abs=0.004 if every == 1 else 0.02)
    assert rms_m(walk, estimate, axis) < 0.01


@pytest.mark.parametrize("still", ["too short", "standing still"])
def test_without_a_motion_there_is_no_offset(walk, still):
    estimate = (
        walk[:9] if still == "too short" else Trajectory(walk.stamps_s, SE3.identity((len(walk),)))
    )
    assert best_offset(walk, estimate) is None


@pytest.mark.parametrize("error", [["ate"], ["rpe", "--delta", "1s"]], ids=["ate", "rpe"])
def test_a_shift_of_a_second_is_named_and_the_advice_helps(evaluate, walk, error):
    """Stamps that are off by whole frames pair perfectly, 0 ms apart."""
    values = evaluate(estimate_of(walk, 1.0), *error)
    assert (
        values["largest_difference_s"] < 1e-6 and "try an offset of -1 s" in values["warnings"][0]
    )
    followed = evaluate(estimate_of(walk, 1.0), *error, "--offset", "-1")
    told = values["explained_error"]["rmse_m"]
    assert (
        followed["translation_error_m"]["rmse"] == pytest.approx(told, rel=0.1)
        and not followed["warnings"]
    )
    assert told < 0.25 * values["translation_error_m"]["rmse"]


def test_evo_has_the_advised_error(evaluate, walk, tmp_path):
    tools = judge_module("evo.tools.file_interface", "evo")
    from evo.core import metrics, sync

    values = evaluate(estimate_of(walk, 1.0), "ate")
    reference, estimate = (
        tools.read_tum_trajectory_file(tmp_path / f"{name}.txt") for name in ("truth", "estimate")
    )
    reference, estimate = sync.associate_trajectories(
        reference, estimate, offset_2=values["explanations"][0]["parameters"]["offset_s"]
    )
    estimate.align(reference)
    judge = metrics.APE(metrics.PoseRelation.translation_part)
    judge.process_data((reference, estimate))
    rmse_m = values["explained_error"]["rmse_m"]
    assert rmse_m == pytest.approx(judge.get_all_statistics()["rmse"], rel=0, abs=1e-9)


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("part", [slice(0, 400), slice(100, 160)])
def test_an_odometer_that_drifts_is_given_no_such_advice(evaluate, walk, noise, part):
    for seed in range(2):
        estimate = drifted(walk[part], noise, seed)
        values = evaluate(estimate, "ate")
        assert values["explanations"] == [] and "offset" not in "".join(values["warnings"])
        assert values["translation_error_m"]["rmse"] == pytest.approx(
            absolute_error(walk, estimate).translation_m.rmse, abs=1e-7
        )


def retimed(walk, kind):
    """An estimate with another time axis, and the kind that may be named."""
    estimate = estimate_of(walk, 0.0, 0.001)
    count = np.arange(len(walk))
    stamps_s = {
        "25 instead of 30 a second": 7 + count / 25,
        "numbers of frames": count,
        "another clock": np.cumsum(np.random.default_rng(3).uniform(0.003, 0.1, len(walk))),
    }
    every = 5 if kind == "every fifth, renumbered" else 1
    given_s = stamps_s.get(kind, 7 + count / 30)[: len(count[::every])]
    return Trajectory(given_s, estimate.T_world_camera[::every])


@pytest.mark.parametrize("error", [["ate"], ["rpe", "--delta", "10"]], ids=["ate", "rpe"])
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (
            "25 instead of 30 a second",
            "0.8333 times as far apart (30 poses a second instead of 25)",
        ),
        ("every fifth, renumbered", "5 times as far apart (6 poses a second instead of 30)"),
        ("numbers of frames", "0.03333 times as far apart"),
        ("another clock", "stamps of the ground truth, row by row"),
    ],
)
def test_a_wrong_time_axis_is_named_and_the_advice_helps(evaluate, walk, error, kind, words):
    estimate = retimed(walk, kind)
    values = evaluate(estimate, *error)
    (warning,) = values["warnings"]
    (told,) = values["explanations"]
    assert words in warning and told["kind"] in ("rate", "rows")
    stamps_s = walk.stamps_s
    if found := re.search(r"try (\S+) \+ (\S+) \(stamp - (\S+)\)", warning):
        first_s, scale, origin_s = map(float, found.groups())
        stamps_s = first_s + scale * (estimate.stamps_s - origin_s)
    followed = evaluate(Trajectory(stamps_s, estimate.T_world_camera), *error)
    rmse_m = followed["translation_error_m"]["rmse"]
    explained = values["explained_error"]
    assert not followed["warnings"] and rmse_m == pytest.approx(explained["rmse_m"], rel=0.02)
    assert explained["rmse_m"] < 0.02 < explained["as_read_rmse_m"]


@pytest.mark.parametrize("start_s", [1.5e9, 5e4])
def test_stamps_that_do_not_overlap_are_refused_with_the_scale_that_fits(walk, start_s):
    estimate = estimate_of(walk, 0.0, 0.001)
    given = Trajectory(start_s + np.arange(len(walk)) / 25, estimate.T_world_camera)
    with pytest.raises(InputError, match=r"\+ 0\.8333333 \(stamp - "):
        measured(walk, given, AbsoluteErrorSettings())
    part = Trajectory(1000 * walk.stamps_s, estimate.T_world_camera)[100:200]
    with pytest.raises(InputError, match=r"\+ 0\.001 \(stamp - "):
        measured(walk, part, AbsoluteErrorSettings())


def swaying(stamps_s, at_s, period_s, seed=0):
    """Poses of stamps (n,), as at the times at_s (n,) of a motion of five periods from period_s to
    1.7 times as long.
    """
    rng = np.random.default_rng(seed)
    rates = 2 * np.pi / (period_s * np.array([1.0, 1.17, 1.31, 1.53, 1.7]))
    phases = rng.uniform(0, 2 * np.pi, (5, 3))
    sizes_m = rng.uniform(0.5, 1, (5, 3))
    positions_m = (sizes_m * np.sin(np.multiply.outer(at_s, rates)[..., None] + phases)).sum(1)
    return Trajectory(stamps_s, SE3(np.broadcast_to(np.eye(3), (len(at_s), 3, 3)), positions_m))


def test_any_scale_is_found_of_a_motion_that_256_frames_resolve():
    """Forty seconds in which the camera sways 33 times: seven and a half of 256 frames. An estimate
    of every third frame or so, whatever its distance from the next scale that is tried.
    """
    stamps_s = np.arange(1200) / 30
    truth = swaying(stamps_s, stamps_s, 1.2)
    for scale in 3 * np.geomspace(1.0, 1.04, 9):
        count = int(1199 / scale)
        given = swaying(stamps_s[:count], scale * stamps_s[:count], 1.2)
        _, found = best_scales(truth, given)[0]
        right_m = rms_m(truth, given, TimeAxis(0.0, scale))
        assert rms_m(truth, given, found) <= 1.002 * right_m + 1e-6, scale


@pytest.mark.parametrize(("ratio", "is_usual"), [(1.2, True), (0.8, True), (1.33, False)])
def test_a_usual_scale_is_tried_near_the_fitted_one(walk, ratio, is_usual):
    estimate = estimate_of(walk, 0.0, 0.001)
    since_s = (walk.stamps_s - walk.stamps_s[0]) * 1.03 / ratio
    found = best_scales(walk, Trajectory(since_s, estimate.T_world_camera))
    usual = [axis.scale for parameters, axis in found if parameters == 1]
    assert (pytest.approx(ratio) in usual) == is_usual


@pytest.mark.parametrize(("every", "is_named"), [(11, True), (20, False)])
def test_frames_left_out_between_are_at_most_ten(repository, every, is_named):
    whole = read_trajectory(repository / "trajectories/living_room/kt2.txt").trajectory
    poses = estimate_of(whole, 0.0, 0.001).T_world_camera[::every]
    found = best_scales(whole, Trajectory(1 + np.arange(len(poses)) / 30, poses))
    scales = [axis.scale for _, axis in found]
    assert (pytest.approx(every, rel=1e-3) in scales) == is_named


@pytest.mark.parametrize(("drift", "is_named"), [(0.015, False), (0.03, True)])
def test_a_small_error_is_not_searched_for_another_rate(evaluate, walk, drift, is_named):
    estimate = estimate_of(walk, 0.0, 1e-5)
    since_s = (1 + drift) * (walk.stamps_s - walk.stamps_s[200])
    values = evaluate(Trajectory(walk.stamps_s[200] + since_s, estimate.T_world_camera), "ate")
    assert bool(values["explanations"]) == is_named


def test_keyframes_that_are_counted_are_given_no_reading(evaluate, walk):
    """The poses of a minute with the stamps of two seconds: shrunk to a point they would fit."""
    kept = np.sort(np.random.default_rng(1).choice(400, 60, replace=False))
    poses = estimate_of(walk, 0.0).T_world_camera[kept]
    values = evaluate(Trajectory(walk.stamps_s[:60], poses), "ate")
    assert values["explanations"] == [] and values["explained_error"] is None


def test_poses_that_hardly_pair_are_said(evaluate, walk):
    lost = drifted(walk, 0.05, 1)
    between = Trajectory(
        walk.stamps_s + np.where(np.arange(len(walk)) % 4, 0.0167, 0.0), lost.T_world_camera
    )
    values = evaluate(between, "ate", "--max-difference", "0.005")
    assert "only 100 of the estimate's 400 poses have a ground-truth pose" in values["warnings"][0]
    assert not evaluate(walk[::4], "ate")["warnings"]


@pytest.mark.parametrize(("left", "advised"), [(0.3, "scale"), (0.8, "offset")])
def test_another_rate_is_advised_where_the_best_offset_leaves_twice_the_error(walk, left, advised):
    """Errors of positions of `left` times what the rate makes of right ones."""
    late_s = 1.5e9 + np.arange(len(walk)) / 25
    exact = Trajectory(late_s, walk.T_world_camera)
    error_m = rms_m(walk, exact, best_offset(walk, exact))
    errors = np.random.default_rng(1).normal(0, left * error_m / np.sqrt(3), (len(walk), 3))
    poses = SE3(walk.T_world_camera.rotation, walk.positions_m + errors)
    with pytest.raises(InputError, match="no overlap in time") as refused:
        measured(walk, Trajectory(late_s, poses), AbsoluteErrorSettings())
    scale = "+ 0.8333333 (stamp - " in str(refused.value)
    assert ("scale" if scale else "offset") == advised
    assert scale or "try an offset of -14999999" in str(refused.value)


def test_an_offset_between_the_frames_is_moved_onto_the_stamps_that_pair():
    rng = np.random.default_rng(4)
    stamps_s = np.arange(200) / 10
    walk = SE3.exp(np.cumsum(rng.normal(0, 0.05, (200, 6)), axis=0))
    late = Trajectory(
        stamps_s + 3.037, SE3(walk.rotation, walk.translation + rng.normal(0, 0.05, (200, 3)))
    )
    truth = Trajectory(stamps_s, walk)
    settings = AbsoluteErrorSettings(AssociationSettings(max_difference_s=0.001))
    with pytest.raises(InputError, match=r"a larger difference, or an offset of -3\.037 s"):
        measured(truth, late, settings)
