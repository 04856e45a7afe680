"""A small synthetic run."""

import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.dataset.frames import run_frames
from iclnuim.dataset.run_folder import open_run
from iclnuim.dataset.sequence import write_sequence
from iclnuim.dataset.sequence_formats import FORMATS
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory

sys.path.insert(0, str(Path(__file__).parents[1]))


def make_run(folder):
    """Four frames of a sloping floor and a colour ramp, 64 x 48."""
    camera = {"width": 64, "height": 48, "fx": 48.0, "fy": 48.0, "cx": 31.5, "cy": 23.5}
    recipe = {
        "job": {"camera": camera, "samples": 1},
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    poses = SE3.exp(np.linspace(0, 0.1, 24).reshape(4, 6))
    run = open_run(folder, recipe, Trajectory.at_rate(poses))
    v, u = np.mgrid[0:48, 0:64]
    for number in range(4):
        run.write_frame(
            number,
            np.stack([u / 64, v / 48, (u + v) / 112], -1),
            1.0 + number / 10 + v / 30 + u / 100,
        )
    return run


@pytest.fixture
def run(tmp_path):
    """Four frames, a test's own."""
    return make_run(tmp_path / "raw")


@pytest.fixture(scope="session")
def shared_run(tmp_path_factory):
    """The same for tests that only read it."""
    return make_run(tmp_path_factory.mktemp("run") / "raw")


@pytest.fixture(scope="session")
def all_formats(shared_run, tmp_path_factory):
    """That run as a sequence in every format, a folder each, to be read only."""
    out = tmp_path_factory.mktemp("formats") / "out"
    write_sequence(run_frames(shared_run.path), out, formats=tuple(FORMATS))
    return out
