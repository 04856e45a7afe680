"""A constant time offset is found where it is, advised only where it makes the error far smaller,
and evo agrees with what is advised.
"""

import json

import numpy as np
import pytest
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.evaluation.time_offset import best_offset
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli


@pytest.fixture(scope="module")
def walk(repository):
    """400 poses of the shipped kt2."""
    return read_trajectory(repository / "trajectories/living_room/kt2.txt").trajectory[200:600]


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
    offset_s, rms_m = best_offset(walk, estimate_of(walk, shift_s, 0.001, every))
    assert offset_s == pytest.approx(-shift_s, abs=0.004 if every == 1 else 0.02) and rms_m < 0.01


@pytest.mark.parametrize("still", ["too short", "standing still"])
def test_without_a_motion_there_is_no_offset(walk, still):
    estimate = (
        walk[:9] if still == "too short" else Trajectory(walk.stamps_s, SE3.identity((len(walk),)))
    )
    assert best_offset(walk, estimate) is None


@pytest.fixture
def evaluate(tmp_path, walk, capsys):
    def call(estimate, *arguments):
        write_trajectory(tmp_path / "truth.txt", walk, "tum")
        write_trajectory(tmp_path / "estimate.txt", estimate, "tum")
        files = (str(tmp_path / name) for name in ("truth.txt", "estimate.txt"))
        assert cli.main(["evaluate", arguments[0], *files, "--json", *arguments[1:]]) == 0
        return json.loads(capsys.readouterr().out)

    return call


@pytest.mark.parametrize("error", [["ate"], ["rpe", "--delta", "1s"]], ids=["ate", "rpe"])
def test_a_shift_of_a_second_is_named_and_the_advice_helps(evaluate, walk, error):
    """Stamps that are off by whole frames pair perfectly, 0 ms apart."""
    values = evaluate(estimate_of(walk, 1.0), *error)
    assert (
        values["largest_difference_s"] < 1e-6 and "try an offset of -1 s" in values["warnings"][0]
    )
    followed = evaluate(estimate_of(walk, 1.0), *error, "--offset", "-1")
    told = values["time_offset"]["rmse_m"]
    assert (
        followed["translation_error_m"]["rmse"] == pytest.approx(told, rel=0.1)
        and not followed["warnings"]
    )
    assert told < 0.25 * values["translation_error_m"]["rmse"]


def test_evo_has_the_advised_error(evaluate, walk, tmp_path):
    tools = pytest.importorskip("evo.tools.file_interface", reason="evo is the judge")
    from evo.core import metrics, sync

    values = evaluate(estimate_of(walk, 1.0), "ate")["time_offset"]
    reference, estimate = (
        tools.read_tum_trajectory_file(tmp_path / f"{name}.txt") for name in ("truth", "estimate")
    )
    reference, estimate = sync.associate_trajectories(
        reference, estimate, offset_2=values["offset_s"]
    )
    estimate.align(reference)
    judge = metrics.APE(metrics.PoseRelation.translation_part)
    judge.process_data((reference, estimate))
    assert values["rmse_m"] == pytest.approx(judge.get_all_statistics()["rmse"], rel=0, abs=1e-9)


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("part", [slice(0, 400), slice(100, 160)])
def test_an_odometer_that_drifts_is_given_no_such_advice(evaluate, walk, noise, part):
    for seed in range(2):
        estimate = drifted(walk[part], noise, seed)
        values = evaluate(estimate, "ate")
        assert values["time_offset"] is None and "offset" not in "".join(values["warnings"])
        assert values["translation_error_m"]["rmse"] == pytest.approx(
            absolute_error(walk, estimate).translation_m.rmse, abs=1e-7
        )
