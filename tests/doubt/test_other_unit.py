"""An estimate in another unit of length is recognised, the advice helps, and a bad estimate in
metres is not called one in another unit.
"""

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from judges import judge_module


def scaled_estimate(truth, scale, noise=0.003, shift_s=0.0):
    rng = np.random.default_rng(5)
    T = (
        SE3.exp(rng.normal(size=6))
        @ truth.T_world_camera
        @ SE3.exp(rng.normal(0, noise, (len(truth), 6)))
    )
    return Trajectory(truth.stamps_s + shift_s, SE3(T.rotation, scale * T.translation))


UNITS = [
    (1e3, "millimetres"),
    (100, "centimetres"),
    (1 / 0.3048, "feet"),
    (7.7, "no unit of length; try correcting its scale"),
    (0.04, "no unit of length"),
    (1.3, "no unit of length"),
    (1e3 * 1.007, "millimetres"),
    (1e3 * 1.013, "no unit of length"),
    (1e-3, "in kilometres or the ground truth may be in mill"),
]


@pytest.mark.parametrize(("scale", "name"), UNITS)
def test_another_unit_is_named_and_following_the_advice_helps(evaluate, walk, scale, name):
    values = evaluate(scaled_estimate(walk, scale), "ate")
    told, given = values["explained_error"], values["translation_error_m"]["rmse"]
    (explanation,) = values["explanations"]
    assert len(values["warnings"]) == 1 and name in values["warnings"][0]
    assert explanation["kind"] == "scale" and told["as_read_rmse_m"] == given
    assert explanation["parameters"]["scale"] == pytest.approx(1 / scale, rel=0.01)
    followed = evaluate(scaled_estimate(walk, scale), "ate", "--align", "sim3")
    assert followed["translation_error_m"]["rmse"] == pytest.approx(told["rmse_m"], rel=1e-9)
    assert told["rmse_m"] < 0.02 < given
    assert followed["explanations"] == [] and not followed["warnings"]


def test_relative_errors_have_the_same_advice(evaluate, walk):
    values = evaluate(scaled_estimate(walk, 1e3), "rpe", "--delta", "1s")
    assert "millimetres" in values["warnings"][0] and values["explained_error"]["rmse_m"] < 0.02
    followed = evaluate(scaled_estimate(walk, 1e3), "rpe", "--delta", "1s", "--correct-scale")
    rmse_m = followed["translation_error_m"]["rmse"]
    assert rmse_m == pytest.approx(values["explained_error"]["rmse_m"], rel=1e-9)
    assert not followed["warnings"]


def test_evo_has_the_advised_error(evaluate, walk, tmp_path):
    tools = judge_module("evo.tools.file_interface", "evo")
    from evo.core import metrics, sync

    values = evaluate(scaled_estimate(walk, 1e3), "ate")
    reference, estimate = (
        tools.read_tum_trajectory_file(tmp_path / f"{name}.txt") for name in ("truth", "estimate")
    )
    reference, estimate = sync.associate_trajectories(reference, estimate)
    scale = estimate.align(reference, correct_scale=True)[2]
    judge = metrics.APE(metrics.PoseRelation.translation_part)
    judge.process_data((reference, estimate))
    assert values["explanations"][0]["parameters"]["scale"] == pytest.approx(scale, rel=1e-9)
    rmse_m = values["explained_error"]["rmse_m"]
    assert rmse_m == pytest.approx(judge.get_all_statistics()["rmse"], abs=1e-9)


@pytest.mark.parametrize("error", [["ate"], ["rpe", "--delta", "1s"]], ids=["ate", "rpe"])
@pytest.mark.parametrize("scale", [1.0, 0.95, 1.1])
def test_a_drift_of_scale_is_an_error_and_no_other_unit(evaluate, walk, scale, error):
    assert evaluate(scaled_estimate(walk, scale), *error)["explanations"] == []


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 100.0])
def test_a_failed_estimate_is_not_called_one_in_another_unit(evaluate, walk, size_m):
    steps_m = np.random.default_rng(0).normal(0, size_m / 20, (len(walk), 3))
    poses = SE3(walk.T_world_camera.rotation, np.cumsum(steps_m, axis=0))
    assert evaluate(Trajectory(walk.stamps_s, poses), "ate")["explanations"] == []
