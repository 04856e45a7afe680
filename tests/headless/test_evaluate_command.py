"""`iclnuim evaluate`: the same figures by both ways, files, exit codes, and errors in one line."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.evaluation import align, associate, stretches
from iclnuim.formats.trajectories import write_trajectory
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim_bench import quick_ate
from iclnuim_bench.commands import evaluate


def run(*arguments):
    command = [sys.executable, "-m", "iclnuim_bench", "evaluate", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluate")
    rng = np.random.default_rng(0)
    t = np.linspace(0, 6, 200)
    poses = SE3.exp(np.stack([np.sin(t), np.cos(2 * t), 0.3 * t, 0.2 * t, np.sin(t), 0 * t], -1))
    noisy = SE3.exp(rng.normal(size=6)) @ poses @ SE3.exp(rng.normal(size=(200, 6)) * 0.01)
    truth = Trajectory.at_rate(poses)
    write_trajectory(folder / "truth.txt", truth, "tum")
    write_trajectory(folder / "estimate.txt", Trajectory(truth.stamps_s + 0.003, noisy), "tum")
    write_trajectory(folder / "mirrored.txt", Trajectory(truth.stamps_s, SE3(poses.rotation, poses.translation * [1, -1, 1])), "tum")
    write_trajectory(folder / "later.txt", Trajectory(truth.stamps_s + 1000, noisy), "tum")
    return folder


def flat(values, prefix=""):
    if isinstance(values, dict):
        return {k: v for key, value in values.items() for k, v in flat(value, f"{prefix}.{key}").items()}
    if isinstance(values, list):
        return {k: v for number, value in enumerate(values) for k, v in flat(value, f"{prefix}.{number}").items()}
    return {prefix: values}


@pytest.mark.parametrize("method", ["se3", "sim3"])
def test_the_quick_way_and_the_library_give_the_same_figures(files, method):
    quick = quick_ate.quick_ate(str(files / "truth.txt"), str(files / "estimate.txt"), method)
    assert quick is not None
    done = run("ate", files / "truth.txt", files / "estimate.txt", "--align", method, "--csv", files / "by_library.csv", "--json")
    slow, quick = flat(json.loads(done.stdout)), flat(quick)
    assert slow.keys() == quick.keys()
    for key, value in slow.items():
        assert quick[key] == (pytest.approx(value, rel=1e-9, abs=1e-9) if isinstance(value, float) else value), key


def test_the_usual_question_imports_neither_numpy_nor_more(files):
    program = (
        "import sys; from iclnuim_bench.cli import main; "
        f"main(['evaluate', 'ate', {str(files / 'truth.txt')!r}, {str(files / 'estimate.txt')!r}, '--quiet']); "
        "sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'matplotlib', 'bpy')))"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True).returncode == 0


def test_words_of_the_options_are_those_of_the_library():
    assert evaluate.ALIGNMENTS == align.METHODS
    assert associate.METHODS == ("greedy", "nearest")
    assert stretches.MEASURED_ON == ("reference", "estimate")
    assert tuple(align.AXES) == ("x", "y", "z")


def test_table_csv_and_picture(files, tmp_path):
    done = run("ate", files / "truth.txt", files / "estimate.txt", "--csv", tmp_path / "e.csv", "--plot", tmp_path / "e.png")
    assert done.returncode == 0, done.stderr
    assert "rmse" in done.stdout and "within 5cm" in done.stdout
    with open(tmp_path / "e.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 200
    assert float(rows[0]["translation_error_m"]) > 0
    assert (tmp_path / "e.png").read_bytes()[:4] == b"\x89PNG"


def test_rpe_over_frames_seconds_and_metres(files):
    for delta in ("1", "1s", "0.5m"):
        done = run("rpe", files / "truth.txt", files / "estimate.txt", "--delta", delta, "--json")
        assert done.returncode == 0, done.stderr
        assert 0.001 < json.loads(done.stdout)["translation_error_m"]["rmse"] < 0.1


def test_a_mirrored_estimate_is_named_with_what_to_do(files):
    done = run("ate", files / "truth.txt", files / "mirrored.txt")
    assert "mirror" in (done.stdout + done.stderr).lower()
    assert "--from gt.freiburg" in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("ate", "truth.txt", "later.txt"), "later.txt"),
        (("ate", "truth.txt", "absent.txt"), "absent.txt"),
        (("rpe", "truth.txt", "estimate.txt", "--delta", "soon"), "delta"),
        (("ate", "truth.txt", "estimate.txt", "--align-first", "1"), "1 pose"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(files, arguments, words):
    done = run(*[str(files / a) if a.endswith(".txt") else a for a in arguments], "--quiet")
    assert done.returncode == 2
    assert words in done.stderr and "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
