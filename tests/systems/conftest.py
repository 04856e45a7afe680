"""A sequence of 60 tiny frames with ground truth, and fake systems to run on it."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.sequences.associations import Associations, ImageList, write_associations
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

FRAMES = 60


@pytest.fixture(scope="session")
def make_sequence(repository):
    """make_sequence(folder, first_s=1): associations, camera.json and groundtruth.txt along the
    shipped kt2.
    """
    poses = read_trajectory(
        repository / "trajectories/living_room/kt2.txt"
    ).trajectory.T_world_camera[: 2 * FRAMES : 2]

    def make(folder, first_s=1.0):
        folder.mkdir(parents=True)
        write_png(folder / "rgb.png", np.zeros((6, 8, 3), np.uint8))
        write_png(folder / "depth.png", np.full((6, 8), 1000, np.uint16))
        stamps = [f"{first_s + i / 30:.6f}" for i in range(FRAMES)]
        lists = (
            ImageList(tuple(map(float, stamps)), (f"{kind}.png",) * FRAMES, tuple(stamps))
            for kind in ("rgb", "depth")
        )
        write_associations(folder / "associations.txt", Associations(*lists))
        camera = PinholeCamera(8, 6, 7.5, 7.25, 3.5, 2.5).to_dict()
        (folder / "camera.json").write_text(json.dumps({**camera, "depth_units_per_metre": 1000.0}))
        write_trajectory(
            folder / "groundtruth.txt", Trajectory(np.array(stamps, float), poses), "tum"
        )
        return folder

    return make


@pytest.fixture(scope="session")
def sequence(make_sequence, tmp_path_factory):
    return make_sequence(tmp_path_factory.mktemp("systems") / "kt2/clean")


@pytest.fixture
def fake(tmp_path, sequence):
    """fake(mode, more lines of the file ...) -> the path of a system's file that runs
    fake_system.py in that mode.
    """

    def make(mode, *tables, arguments=(), truth=sequence / "groundtruth.txt"):
        script = Path(__file__).parent / "fake_system.py"
        command = [
            "{program}",
            "-IS",
            str(script),
            mode,
            "{stage}",
            "{out}",
            str(truth),
            "0",
            *arguments,
        ]
        lines = [
            'about = "a stand-in"',
            f"command = {json.dumps(command)}",
            f"program = {json.dumps(sys.executable)}",
        ]
        trajectories = '[trajectories.final]\nfile = "final.txt"\n[trajectories.live]\nfile = "live.txt"\nformat = "kitti"\ncounted = true'
        path = tmp_path / f"{mode.replace(' ', '_')}.toml"
        path.write_text("\n".join([*lines, *tables, trajectories]))
        return path

    return make


@pytest.fixture
def run(tmp_path, capsys, sequence):
    """run(system, options ...) -> rows by name, exit code, notes."""

    def call(system, *options, folder=sequence, code=0):
        arguments = [
            "run",
            str(system),
            str(folder),
            "-o",
            str(tmp_path / "out"),
            "--json",
            *map(str, options),
        ]
        assert cli.main(arguments) == code
        out, err = capsys.readouterr()
        rows = (
            json.loads(out)["results"][0]["runs"]
            if out.startswith("{") and "--stage-only" not in options
            else []
        )
        return {row["odometer"]: row for row in rows}, err or out

    return call
