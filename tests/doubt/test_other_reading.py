"""An estimate with inverted poses or with the scalar first is recognised, the advice helps, and
other bad estimates are called neither.
"""

import json

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

NOISE_M = 0.003


@pytest.fixture(scope="module")
def walk(repository):
    """400 poses of the shipped kt2."""
    return read_trajectory(repository / "trajectories/living_room/kt2.txt").trajectory[200:600]


@pytest.fixture
def evaluate(tmp_path, walk, capsys):
    """Evaluate poses (400,) of an estimate, by default as ate."""
    write_trajectory(tmp_path / "truth.txt", walk, "tum")

    def call(poses, *arguments, metric="ate", scalar_first=False):
        write_trajectory(tmp_path / "estimate.txt", Trajectory(walk.stamps_s, poses), "tum")
        if scalar_first:
            rows = [
                line.split() for line in (tmp_path / "estimate.txt").read_text().splitlines()[1:]
            ]
            (tmp_path / "estimate.txt").write_text(
                "".join(" ".join(r[:4] + r[7:] + r[4:7]) + "\n" for r in rows)
            )
        files = (str(tmp_path / name) for name in ("truth.txt", "estimate.txt"))
        assert cli.main(["evaluate", metric, *files, "--json", *arguments]) == 0
        return json.loads(capsys.readouterr().out)

    return call


def estimated(walk, seed=5):
    """The walk with noise, in a world of its own."""
    rng = np.random.default_rng(seed)
    return (
        SE3.exp(rng.normal(size=6))
        @ walk.T_world_camera
        @ SE3.exp(rng.normal(0, NOISE_M, (len(walk), 6)))
    )


@pytest.mark.parametrize("metric", ["ate", "rpe"])
def test_inverted_poses_are_recognised_and_following_the_advice_helps(evaluate, walk, metric):
    told = evaluate(estimated(walk).inverse(), metric=metric)
    assert len(told["warnings"]) == 1 and "try reading it as tum-inverse" in told["warnings"][0]
    assert [one["kind"] for one in told["explanations"]] == ["inverse"]
    followed = evaluate(estimated(walk).inverse(), "--from", "tum-inverse", metric=metric)
    assert followed["translation_error_m"]["rmse"] == pytest.approx(
        told["explained_error"]["rmse_m"], rel=1e-4
    )
    assert (
        followed["translation_error_m"]["rmse"]
        < 3 * NOISE_M
        < told["translation_error_m"]["rmse"] / 3
    )
    assert followed["warnings"] == [] and followed["explanations"] == []


@pytest.mark.parametrize("metric", [("ate",), ("rpe", "--delta", "1s")])
def test_quaternions_with_the_scalar_first_are_recognised_and_following_the_advice_helps(
    evaluate, walk, metric
):
    # in the world of the truth, where the rotation of an estimate means something without an
    # alignment
    poses = walk.T_world_camera @ SE3.exp(
        np.random.default_rng(1).normal(0, NOISE_M, (len(walk), 6))
    )
    told = evaluate(poses, *metric[1:], metric=metric[0], scalar_first=True)
    assert len(told["warnings"]) == 1 and "try reading it as tum-wxyz" in told["warnings"][0]
    followed = evaluate(
        poses, *metric[1:], "--from", "tum-wxyz", metric=metric[0], scalar_first=True
    )
    assert followed["rotation_error_deg"]["rmse"] == pytest.approx(
        told["explained_error"]["rotation_rmse_deg"], rel=1e-4
    )
    assert followed["rotation_error_deg"]["rmse"] < 1 < told["rotation_error_deg"]["rmse"] / 4
    assert followed["warnings"] == []


@pytest.mark.parametrize("seed", range(5))
def test_other_estimates_are_called_neither(evaluate, walk, seed):
    rng = np.random.default_rng(seed)
    good = estimated(walk, seed)
    drift = SE3.exp(np.cumsum(rng.normal(0, 0.003, (len(walk), 6)), axis=0))
    still = SE3(good.rotation, good.translation * 0 + rng.normal(0, 0.01, (len(walk), 3)))
    for poses in (good, good @ drift, still):
        assert evaluate(poses)["explanations"] == []
