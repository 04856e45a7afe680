"""A wandering path and an estimate of it, for the tests of errors; a part of kt2, and the command
that compares an estimate with it.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

sys.path.insert(0, str(Path(__file__).parent))
from paired_poses import Pairs  # noqa: E402


@pytest.fixture(scope="session")
def wander():
    """wander(seed, noise, n): paired poses of a random walk; the estimate is moved as a whole and
    noisy by pose.
    """

    def make(seed, noise=0.05, n=None, rate_hz=30.0):
        rng = np.random.default_rng(seed)
        n = n or int(rng.integers(12, 40))
        truth = SE3.exp(np.cumsum(rng.normal(0, 0.1, (n, 6)), axis=0))
        estimate = SE3.exp(rng.normal(size=6)) @ truth @ SE3.exp(rng.normal(0, noise, (n, 6)))
        return Pairs.of_poses(truth, estimate, rate_hz)

    return make


@pytest.fixture(scope="module")
def walk(repository):
    """400 poses of the shipped kt2."""
    return read_trajectory(repository / "trajectories/living_room/kt2.txt").trajectory[200:600]


@pytest.fixture
def evaluate(tmp_path, walk, capsys):
    """evaluate(estimate, "ate" or "rpe", options): what the command says of an estimate of walk."""

    def call(estimate, *arguments):
        write_trajectory(tmp_path / "truth.txt", walk, "tum")
        write_trajectory(tmp_path / "estimate.txt", estimate, "tum")
        files = (str(tmp_path / name) for name in ("truth.txt", "estimate.txt"))
        assert cli.main(["evaluate", arguments[0], *files, "--json", *arguments[1:]]) == 0
        return json.loads(capsys.readouterr().out)

    return call
