"""The benchmark of the noise models: its measure of likeness, and its report."""

import json

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.cli import main
from iclnuim.sensor.models import DEPTH_MODELS, depth_model, rgb_model
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.writer import write_sequence
from iclnuim.tools.noise_comparison import overlaps


def _run(folder, size, count):
    """A room's floor and wall under a textured light."""
    camera = PinholeCamera.parse(size)
    recipe = {
        "job": {"camera": camera.to_dict()},
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    run = open_run(folder, recipe, Trajectory.at_rate(SE3.exp(np.zeros((count, 6)))))
    rng = np.random.default_rng(1)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] / camera.height
    for number in range(count):
        light = np.clip(
            (0.3 + 0.2 * u)[..., None] * (1 + 0.05 * rng.standard_normal((*u.shape, 3))), 0, 1
        )
        run.write_frame(number, light, np.minimum(3.0 - 0.4 * u, 1.2 / np.maximum(v - 0.4, 1e-3)))
    return run.path


@pytest.fixture
def raw(tmp_path):
    return _run(tmp_path / "raw", "160x120", 3)


def test_a_model_is_most_like_its_own_frames(raw, tmp_path):
    from iclnuim.sequences.frame_source import run_frames

    clean, noisy = tmp_path / "clean", tmp_path / "noisy"
    write_sequence(run_frames(raw), clean)
    write_sequence(
        run_frames(raw), noisy, SequenceSettings(depth_model("paper"), rgb_model("paper"), seed=5)
    )
    found = overlaps(clean, noisy)
    for kind in ("depth", "rgb"):
        assert max(found[kind], key=found[kind].get) == "paper"
        assert found[kind]["paper"] > 0.95 > found[kind]["none"]
    assert overlaps(clean, clean)["depth"]["none"] == pytest.approx(1)


def test_the_command_reports_every_pair_and_model_and_draws(raw, tmp_path, capsys):
    chart = tmp_path / "chart.png"
    assert (
        main(
            [
                "bench",
                "noise",
                str(raw),
                "--rounds",
                "1",
                "--plot",
                str(chart),
                "--json",
                "--quiet",
            ]
        )
        == 0
    )
    found = json.loads(capsys.readouterr().out)
    assert {(p["depth"], p["rgb"]) for p in found["pairs"]} >= {
        ("paper", "paper"),
        ("released", "released"),
    }
    assert all(p["frames_per_s"] > 0 and p["cpu_ratio"] > 0 for p in found["pairs"])
    assert set(found["model_ms"]["depth"]) == set(DEPTH_MODELS)
    assert chart.read_bytes()[:4] == b"\x89PNG"
    assert main(["bench", "noise", str(raw), "--rounds", "0"]) == 2
