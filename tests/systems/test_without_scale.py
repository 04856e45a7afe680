"""Systems without scale: aligned by Sim(3), which every row says, with the scale and its drift."""

import json
import subprocess
import sys

import pytest
from iclnuim.benchmark.systems.system import built_in, has_scale
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

NAME = "good (Sim(3))"


@pytest.fixture
def small(sequence, tmp_path):
    """The ground truth of a method that knows the scale up to 2.5."""
    truth = read_trajectory(sequence / "groundtruth.txt").trajectory
    poses = truth.T_world_camera
    path = tmp_path / "small.txt"
    scaled = SE3(poses.rotation, poses.translation / 2.5)
    write_trajectory(path, Trajectory(truth.stamps_s, scaled), "tum")
    return path


def test_its_rows_say_sim3_the_scale_and_its_drift(run, fake, small, capsys, sequence, tmp_path):
    system = fake("good", "has_scale = false", truth=small)
    rows, _ = run(system)
    row = rows[NAME]
    assert row["ate_rmse_m"] < 1e-4 and row["scale"] == pytest.approx(2.5, rel=1e-3)
    assert abs(row["scale_change"]) < 0.01 and row["each"][0]["scale"] == row["scale"]
    assert "errors after Sim(3), whose scale is 2.5" in row["notes"][0]
    assert "changes by" in row["notes"][0] and set(rows) == {NAME, "good live (Sim(3))"}
    words = ["bench", "odometry", str(tmp_path / "out/results.json")]
    done = subprocess.run([sys.executable, "-m", "iclnuim", *words], capture_output=True, text=True)
    assert done.returncode == 0 and NAME in done.stdout


def test_the_same_system_with_scale_has_its_error_after_se3(run, fake, small):
    rows, _ = run(fake("good", truth=small))
    assert rows["good"]["ate_rmse_m"] > 0.1 and rows["good"]["scale"] is None


def test_evaluate_knows_a_system_without_scale(command_here, fake, small, sequence):
    system = fake("good", "has_scale = false")
    words = ["evaluate", sequence, small, "--system", system]
    code, text, notes = command_here(*words)
    assert code == 0 and "aligned by sim3, scale 2.5" in text and "scale: changes by" in text
    assert "has no scale: not comparable" in notes
    code, text, _ = command_here(*words, "--json")
    values = json.loads(text)
    assert values["alignment"]["scale"] == pytest.approx(2.5, rel=1e-3)
    assert len(values["alignment"]["scales"]) == 10
    code, text, notes = command_here(*words, "--align", "se3")
    assert code == 0 and "which an alignment by se3 needs" in notes
    code, text, _ = command_here("evaluate", "rpe", *words[1:], "--delta", "0.5s")
    assert code == 0 and "scale 2.5" in text


def test_stress_refuses_a_system_without_scale(command_here, fake, sequence):
    system = fake("good", "has_scale = false")
    code, _, said = command_here("stress", sequence, "--system", system)
    assert code == 2 and "systems with a scale" in said


def test_every_built_in_system_is_metric():
    assert all(has_scale(name) for name in built_in())
