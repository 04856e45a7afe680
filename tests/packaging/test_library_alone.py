"""The library and its commands without the benchmark and without the packages that only the
benchmark and its judges need: data are made, converted, inspected and evaluated; what needs more
says so in one line.
"""

import json
import os
import shutil
import subprocess
import sys

import iclnuim
import pytest
from patience import patience

AWAY = ("numba", "cv2", "scipy", "igl", "embreex", "open3d", "evo")
#: Read by every Python of the test at its start: the packages cannot be found, nor can the
#: benchmark of this checkout.
TAKEN_AWAY = f"""
import sys
from importlib.machinery import PathFinder

class Without(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] not in {AWAY}:
            return super().find_spec(name, path, target)

kept = [finder for finder in sys.meta_path if "editable" not in repr(finder).lower()]
sys.meta_path[:] = [Without if finder is PathFinder else finder for finder in kept]
"""
#: Four frames of a wall that a camera moves along, as clean and noisy sequences.
SEQUENCES = """
import numpy as np
import iclnuim
from iclnuim.sequences.run_folder import open_run
camera = iclnuim.PinholeCamera.parse("64x48")
twists = np.zeros((4, 6))
twists[:, :3] = [[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0.02, 0.02, 0.01]]
trajectory = iclnuim.Trajectory.at_rate(iclnuim.SE3.exp(twists))
recipe = {"job": {"camera": camera.to_dict()}, "trajectory_sha256": "a"}
recipe |= {"scene_sha256": "b", "blender": "none"}
run = open_run("raw", recipe, trajectory)
for number in range(4):
    run.write_frame(number, np.full((48, 64, 3), 0.3), np.full((48, 64), 2.0))
iclnuim.make_sequence("raw", "clean")
iclnuim.make_sequence("raw", "noisy", depth_noise="released", rgb_noise="released")
assert not iclnuim.inspect_sequence("noisy").errors
iclnuim.make_sequence(iclnuim.open_sequence("clean"), "converted", formats=("replica",))
loaded = iclnuim.read_trajectory("clean/groundtruth.txt").trajectory
assert np.allclose(loaded.positions_m, trajectory.positions_m)
print(iclnuim.absolute_trajectory_error(loaded, loaded).translation_m.rmse)
print(iclnuim.relative_pose_error(loaded, loaded).translation_m.rmse)
"""


@pytest.fixture(scope="module")
def alone(repository, tmp_path_factory):
    """`alone(*words)` runs Python on a copy of the library and the commands, in an empty folder."""
    tree = tmp_path_factory.mktemp("tree")
    for folder in ("addon/iclnuim", "headless"):
        shutil.copytree(repository / folder, tree / folder)
    for folder in ("blend", "trajectories"):
        (tree / folder).symlink_to(repository / folder)
    (tree / "addon/sitecustomize.py").write_text(TAKEN_AWAY)
    away = tmp_path_factory.mktemp("away")
    paths = {"PYTHONPATH": str(tree / "addon"), "XDG_CACHE_HOME": str(away / "cache")}

    def run(*words):
        return subprocess.run(
            [sys.executable, *map(str, words)],
            cwd=away,
            env={**os.environ, **paths},
            capture_output=True,
            text=True,
            timeout=patience(300),
        )

    return run


@pytest.fixture(scope="module")
def command(alone):
    """`command(*words)`: exit code, standard output and standard error of a command of iclnuim."""

    def run(*words):
        done = alone("-m", "iclnuim", *words)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture(scope="module")
def sequences(alone):
    """The folders clean, noisy and converted, made from Python."""
    done = alone("-c", SEQUENCES)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_what_is_taken_away_cannot_be_imported(alone):
    names = (*AWAY, "iclnuim.benchmark")
    program = (
        "import importlib, iclnuim\n"
        f"for name in {names}:\n"
        "    try: importlib.import_module(name)\n"
        "    except ModuleNotFoundError as error: print(error.name)\n"
    )
    assert alone("-c", program).stdout.split() == list(names)


def test_sequences_are_made_inspected_converted_and_evaluated_from_python(sequences):
    ate_m, rpe_m = map(float, sequences)
    assert ate_m < 1e-12 and rpe_m < 1e-12


def test_every_public_name_is_there_or_is_one_line_of_an_import_error(alone):
    program = (
        "import iclnuim, json\n"
        "said = {}\n"
        "for name in iclnuim.__all__:\n"
        "    try: getattr(iclnuim, name)\n"
        "    except ImportError as error: said[name] = str(error)\n"
        "print(json.dumps(said))\n"
    )
    said = json.loads(alone("-c", program).stdout)
    of_benchmark = {
        name
        for name, (module, _) in iclnuim._PLACES.items()
        if module.startswith("benchmark.") and name in iclnuim.__all__
    }
    assert set(said) == of_benchmark and "fuse_sequence" in said
    for name, text in said.items():
        assert text.startswith(f"iclnuim.{name} needs iclnuim.benchmark") and "\n" not in text


def test_commands_inspect_convert_and_evaluate(sequences, command):
    code, out, _ = command("inspect", "noisy")
    assert code == 0 and "no errors found" in out
    code, out, _ = command("convert", "clean", "as_tum", "--format", "tum")
    assert code == 0 and command("inspect", "as_tum")[0] == 0
    truth = "clean/groundtruth.txt"
    for action in ("ate", "rpe"):
        code, out, _ = command("evaluate", action, truth, truth, "--json")
        assert code == 0 and json.loads(out)["translation_error_m"]["rmse"] < 1e-12


def test_make_renders_a_sequence(command):
    pytest.importorskip("bpy")
    size = ("--frames", "0:90:30", "--camera", "64x48")
    code, _, said = command("make", "living_room/kt2", *size, "-o", "out", "--keep-raw")
    assert code == 0 and "note: " not in said, said
    code, out, _ = command("inspect", "out/clean")
    assert code == 0 and "no errors found" in out
    code, _, said = command("check-depth", "out/raw", "--quiet")
    assert code == 3 and "embreex" in said and len(said.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [
        ("odometry", "icp", "clean"),
        ("fuse", "clean"),
        ("run", "fovis", "clean"),
        ("stress",),
        ("benchmark",),
        ("figure", "1"),
        ("table", "1"),
        ("bench", "odometry", "clean"),
        ("evaluate", "surface", "mesh.ply", "--model", "living_room"),
    ],
)
def test_a_command_that_needs_more_says_so_in_one_line(sequences, command, words):
    code, out, said = command(*words)
    assert code == 3 and out == ""
    assert "needs iclnuim.benchmark" in said and len(said.splitlines()) == 1


def test_a_film_needs_its_encoder(sequences, command):
    code, _, said = command("inspect", "clean", "--preview", "pictures")
    assert code == 3 and "film" in said and "cv2" in said and len(said.splitlines()) == 1
