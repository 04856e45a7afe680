"""A part of kt2, and the command that compares an estimate with it."""

import json

import pytest
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory


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
