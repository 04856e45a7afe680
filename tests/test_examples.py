"""The scripts of examples/ run on a small sequence: the first one here, all in the slow tests."""

import os
import subprocess
import sys
from pathlib import Path

import iclnuim
import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "examples"
#: script -> its arguments in the empty folder of the test, and what its output has
RUNS = {
    "01_a_sequence.py": (["clean"], "the camera moves 0.200 m"),
    "02_noise_on_your_images.py": (["clean", "noisy"], "100% measured"),
    "03_ate_of_arrays.py": (["ate.png"], "AbsoluteError(RMSE"),
}


def look(number):
    return np.full((48, 64, 3), 0.3), np.full((48, 64), 2.0)


@pytest.fixture
def folder(tmp_path):
    twists = np.zeros((21, 6))
    twists[:, 0] = np.linspace(0, 0.2, 21)
    frames = iclnuim.frames_from("64x48", iclnuim.SE3.exp(twists), look)
    iclnuim.make_sequence(frames, tmp_path / "clean", workers=1)
    return tmp_path


def run(script, folder):
    words, said = RUNS[script]
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    command = [sys.executable, str(FOLDER / script), *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert said in done.stdout and done.stderr == ""


def test_the_first_example_runs(folder):
    run("01_a_sequence.py", folder)


@pytest.mark.slow
@pytest.mark.parametrize("script", list(RUNS))
def test_every_example_runs(folder, script):
    run(script, folder)
    made = {
        "02_noise_on_your_images.py": "noisy/depth/000019.png",
        "03_ate_of_arrays.py": "ate.png",
    }
    if script in made:
        assert (folder / made[script]).stat().st_size > 100


def test_every_example_is_run_and_listed():
    scripts = sorted(path.name for path in FOLDER.glob("*.py"))
    assert scripts == sorted(RUNS)
    text = (FOLDER / "README.md").read_text()
    assert all(f"]({script})" in text for script in scripts)
