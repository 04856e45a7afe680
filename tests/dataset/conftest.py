"""A small synthetic run."""

import numpy as np
import pytest
from iclnuim.dataset.run_folder import open_run
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory


@pytest.fixture
def run(tmp_path):
    """Four frames of a sloping floor and a colour ramp, 64 x 48."""
    camera = {"width": 64, "height": 48, "fx": 48.0, "fy": 48.0, "cx": 31.5, "cy": 23.5}
    recipe = {"job": {"camera": camera, "samples": 1}, "trajectory_sha256": "a", "scene_sha256": "b", "blender": "none"}
    poses = SE3.exp(np.linspace(0, 0.1, 24).reshape(4, 6))
    run = open_run(tmp_path / "raw", recipe, Trajectory.at_rate(poses))
    v, u = np.mgrid[0:48, 0:64]
    for number in range(4):
        run.write_frame(number, np.stack([u / 64, v / 48, (u + v) / 112], -1), 1.0 + number / 10 + v / 30 + u / 100)
    return run
