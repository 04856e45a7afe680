"""Real systems on the official frames; evo has the same error on the file that the system wrote."""

import importlib.util
import json

import numpy as np
import pytest
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory
from judges import judge_module

pytestmark = pytest.mark.slow


def results(capsys, system, folder, out, *options):
    assert cli.main(["run", system, str(folder), "-o", str(out), "--json", *map(str, options)]) == 0
    (race,) = json.loads(capsys.readouterr().out)["results"]
    return {row["odometer"]: row for row in race["runs"]}


@pytest.mark.parametrize("system", ["icp_rgbd", "fovis", "opencv-rgbd", "opencv-icp"])
def test_odometers_as_systems_have_the_errors_that_they_have_in_bench_odometry(
    samples, tmp_path, capsys, system
):
    row = results(capsys, system, samples / "or_kt0", tmp_path, "--first", 10)[system]
    options = ("--first", "10", "--only", system, "--json")
    assert cli.main(["bench", "odometry", str(samples / "or_kt0"), *options]) == 0
    (race,) = json.loads(capsys.readouterr().out)["results"]
    bench = next(one for one in race["runs"] if one["odometer"] == system)
    assert row["lost"] == bench["lost"] == 0 and row["notes"] == []
    assert row["ate_rmse_m"] == pytest.approx(bench["ate_rmse_m"], abs=1e-6)


def test_orb_slam3_from_pip_with_a_vocabulary(samples, tmp_path, capsys):
    vocabulary = samples.parent / "orb_vocabulary.txt.xz"
    if importlib.util.find_spec("pyorbslam3") is None or not vocabulary.is_file():
        pytest.skip("needs pyorbslam3 and a vocabulary beside the official samples")
    tools = judge_module("evo.tools.file_interface", "evo")
    from evo.core import metrics, sync

    rows = results(
        capsys, "orbslam3", samples / "or_kt0", tmp_path, "--runs", 3, "--vocabulary", vocabulary
    )
    assert list(rows) == ["ORB-SLAM3", "ORB-SLAM3 live"]
    assert all(
        row["good_runs"] == 3 and row["coverage"] > 0.95 and row["ate_rmse_m"] < 0.03
        for row in rows.values()
    )
    truth = tmp_path / "truth.txt"
    write_trajectory(
        truth, read_trajectory(next((samples / "or_kt0").glob("*.gt.freiburg"))).trajectory, "tum"
    )
    folder, each = next((tmp_path / "cells/orbslam3").iterdir()), []
    for number, one in enumerate(rows["ORB-SLAM3"]["each"], 1):
        pair = (
            tools.read_tum_trajectory_file(f)
            for f in (truth, folder / f"run_{number}/out/final.txt")
        )
        reference, estimate = sync.associate_trajectories(*pair)
        estimate.align(reference)
        judge = metrics.APE(metrics.PoseRelation.translation_part)
        judge.process_data((reference, estimate))
        each.append(one["ate_rmse_m"])
        if len(set(estimate.timestamps)) == len(
            estimate.timestamps
        ):  # a stamp written twice counts twice for evo
            assert each[-1] == pytest.approx(judge.get_all_statistics()["rmse"], rel=0, abs=1e-9)
    assert rows["ORB-SLAM3"]["ate_rmse_m"] == np.median(each)
