"""The tilt that is left by an alignment of yaw and position, and comparison without the first seconds."""

import json

import numpy as np
import pytest
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.cli import main
from iclnuim.trajectory_files.trajectories import write_trajectory

RNG = np.random.default_rng(0)
TRUTH = Trajectory.at_rate(SE3.exp(np.cumsum(RNG.normal(size=(300, 6)) * 0.02, axis=0)))


def turned(about, angle_rad, poses=TRUTH) -> Trajectory:
    """The trajectory in another world, turned about an axis of the first."""
    twist = np.concatenate([[0.3, -1.0, 0.5], angle_rad * np.asarray(about, float)])
    return Trajectory(poses.stamps_s, SE3.exp(twist) @ poses.T_world_camera)


def tilt_deg(estimate, up="z") -> np.ndarray:
    settings = AbsoluteErrorSettings(alignment=AlignmentSettings("yaw", up=up))
    return np.degrees(absolute_error(TRUTH, estimate, settings).tilt_error_rad(up))


@pytest.mark.parametrize(("up", "axis"), [("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])])
def test_a_world_that_is_turned_about_the_upward_axis_has_no_tilt(up, axis):
    assert tilt_deg(turned(axis, 2.0), up) == pytest.approx(np.zeros(300), abs=1e-6)


@pytest.mark.parametrize("degrees", [0.01, 3.0, 100.0])
def test_a_tilted_world_has_its_angle_as_tilt(degrees):
    axis = [np.cos(0.7), np.sin(0.7), 0.0]
    found = tilt_deg(turned(axis, np.radians(degrees)))
    assert found == pytest.approx(np.full(300, degrees), abs=1e-6)


def evaluated(capsys, folder, estimate, *options) -> dict:
    write_trajectory(folder / "truth.txt", TRUTH, "tum")
    write_trajectory(folder / "estimate.txt", estimate, "tum")
    words = ["evaluate", "ate", f"{folder}/truth.txt", f"{folder}/estimate.txt", "--json"]
    assert main([*words, *map(str, options)]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_command_has_the_tilt_of_the_alignment_yaw_alone(capsys, tmp_path):
    estimate = turned([1, 0, 0], np.radians(2.0))
    found = evaluated(capsys, tmp_path, estimate, "--align", "yaw")
    assert found["tilt_error_deg"]["rmse"] == pytest.approx(2.0, abs=1e-4)
    assert "tilt_error_deg" not in evaluated(capsys, tmp_path, estimate)


def test_the_first_seconds_are_left_out_of_both(capsys, tmp_path):
    """An estimate that is far off for three seconds, as before an IMU has found gravity."""
    positions = TRUTH.positions_m.copy()
    positions[:90] += 5.0
    wild = Trajectory(TRUTH.stamps_s, SE3(TRUTH.T_world_camera.rotation, positions))
    whole = evaluated(capsys, tmp_path, wild)
    rest = evaluated(capsys, tmp_path, wild, "--skip", 3)
    assert whole["translation_error_m"]["rmse"] > 0.5
    assert rest["translation_error_m"]["rmse"] < 1e-6
    assert rest["pairs"] == 210 and rest["coverage"] == 1.0
    assert evaluated(capsys, tmp_path, wild, "--skip", 0) == whole


@pytest.mark.parametrize(("seconds", "said"), [("11", "poses from 12 s on"), ("-1", "0 s or more")])
def test_a_time_that_leaves_nothing_is_refused(capsys, tmp_path, seconds, said):
    write_trajectory(tmp_path / "truth.txt", TRUTH, "tum")
    words = ["evaluate", "ate", f"{tmp_path}/truth.txt", f"{tmp_path}/truth.txt"]
    assert main([*words, f"--skip={seconds}"]) == 2
    assert said in capsys.readouterr().err
