"""`iclnuim evaluate`: figures, files, exit codes, and errors in one line."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.geometry import axes
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.report.trajectory_report import significant
from iclnuim.trajectory_files.trajectories import write_trajectory
from patience import patience


def run(*arguments):
    command = [sys.executable, "-m", "iclnuim", "evaluate", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=patience(120))


def call(capsys, *arguments):
    """The command in this process: exit code, standard output, standard error."""
    code = cli.main(["evaluate", *map(str, arguments)])
    return code, *capsys.readouterr()


def write_pair(folder, seed, n=200):
    """truth.txt and estimate.txt with jitter, lost frames, drift, and a frame of its own."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 6, n)
    poses = SE3.exp(np.stack([np.sin(t), np.cos(2 * t), 0.3 * t, 0.2 * t, np.sin(t), 0 * t], -1))
    noisy = SE3.exp(rng.normal(size=6)) @ poses @ SE3.exp(rng.normal(size=(n, 6)) * 0.01)
    truth, kept = Trajectory.at_rate(poses), rng.random(n) > 0.1
    estimate = Trajectory(truth.stamps_s + rng.uniform(-0.016, 0.016, n), noisy)[kept]
    write_trajectory(folder / "truth.txt", truth, "tum")
    write_trajectory(folder / "estimate.txt", estimate, "tum")
    return truth, estimate


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluate")
    truth, estimate = write_pair(folder, 0)
    mirrored = Trajectory(truth.stamps_s, axes.mirrored_y(truth.T_world_camera))
    write_trajectory(folder / "mirrored.txt", mirrored, "tum")
    write_trajectory(folder / "mirrored_ids.txt", mirrored, "gt.freiburg")
    write_trajectory(
        folder / "later.txt", Trajectory(estimate.stamps_s + 1000, estimate.T_world_camera), "tum"
    )
    still = SE3(truth.T_world_camera.rotation, np.ones((len(truth), 3)))
    write_trajectory(folder / "still.txt", Trajectory(truth.stamps_s, still), "tum")
    (folder / "page.txt").write_text("<!DOCTYPE html><html></html>")
    (folder / "empty.txt").write_text("")
    (folder / "nan.txt").write_text(
        (folder / "truth.txt").read_text().replace("0.033333333 ", "0.033333333 nan ", 1)
    )
    return folder


@pytest.mark.parametrize("count", [50, pytest.param(1000, marks=pytest.mark.slow)])
def test_a_damaged_file_is_evaluated_or_refused_in_one_line(files, tmp_path, capsys, count):
    rng, answered = np.random.default_rng(0), 0
    whole = (files / "estimate.txt").read_text().splitlines()[:80]
    pieces = [
        "nan",
        "inf",
        "1_0",
        "",
        "#",
        "1e400",
        "-",
        "1,5",
        "\x0c",
        "\x85",
        " ",
        "\t",
        "+1",
        ".5",
        "\r",
        "0",
        "1e12",
    ]
    for _ in range(count):
        lines, row = list(whole), int(rng.integers(len(whole)))
        cut = int(rng.integers(len(lines[row]) + 1))
        lines[row] = lines[row][:cut] + pieces[rng.integers(len(pieces))] + lines[row][cut:]
        if rng.random() < 0.2:
            lines = lines[: row + 1]
        (tmp_path / "damaged.txt").write_bytes("\n".join(lines).encode())
        names = str(files / "truth.txt"), str(tmp_path / "damaged.txt")
        code, out, err = call(capsys, "ate", *names, "--json", "--quiet")
        assert code in (0, 2) and len(err.splitlines()) == (code == 2)
        answered += code == 0
    assert 0.1 * count < answered < 0.9 * count


@pytest.mark.parametrize("what", ["ate", "rpe"])
def test_of_heavy_packages_only_numpy_is_imported(files, what):
    program = (
        "import sys; from iclnuim.headless.cli import main; "
        f"main(['evaluate', {what!r}, {str(files / 'truth.txt')!r}, {str(files / 'estimate.txt')!r}, '--quiet']); "
        "sys.exit(any(m in sys.modules for m in ('scipy', 'matplotlib', 'bpy', 'cv2', 'open3d', 'numba', 'OpenEXR')))"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True).returncode == 0


def test_table_csv_and_picture(files, tmp_path, capsys):
    outputs = ("--csv", tmp_path / "e.csv", "--plot", tmp_path / "e.png")
    code, out, _ = call(capsys, "ate", files / "truth.txt", files / "estimate.txt", *outputs)
    assert code == 0 and "rmse" in out and "within 5 cm" in out
    with open(tmp_path / "e.csv") as file:
        rows = list(csv.DictReader(file))
    _, out, _ = call(capsys, "ate", files / "truth.txt", files / "estimate.txt", "--json")
    values, errors_m = json.loads(out), [float(row["translation_error_m"]) for row in rows]
    assert len(rows) == values["pairs"]
    assert max(errors_m) == pytest.approx(values["translation_error_m"]["max"], abs=1e-9)
    assert max(abs(float(row["time_difference_s"])) for row in rows) == pytest.approx(
        values["largest_difference_s"]
    )
    assert (tmp_path / "e.png").read_bytes()[:4] == b"\x89PNG"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["e.csv", "e.png"]


@pytest.mark.parametrize("delta", ["1", "1s", "0.5m"])
@pytest.mark.parametrize("pairs", ["all", "consecutive"])
def test_rpe_over_frames_seconds_and_metres(files, tmp_path, capsys, delta, pairs):
    drawn = delta == "1s"
    outputs = (
        "--csv",
        tmp_path / "e.csv",
        *(("--plot", tmp_path / "e.svg") if drawn else ()),
        "--json",
    )
    question = (
        "rpe",
        files / "truth.txt",
        files / "estimate.txt",
        "--delta",
        delta,
        "--pairs",
        pairs,
    )
    code, out, _ = call(capsys, *question, *outputs)
    values = json.loads(out)
    assert code == 0 and 0.001 < values["translation_error_m"]["rmse"] < 0.1
    rows = list(csv.DictReader((tmp_path / "e.csv").read_text().splitlines()))
    assert len(rows) == values["rpe_pairs"] > 0
    assert all(float(row["start_stamp_s"]) < float(row["end_stamp_s"]) for row in rows)
    assert not drawn or (tmp_path / "e.svg").read_text().startswith("<?xml")
    assert f"{values['rpe_pairs']} RPE pairs" in call(capsys, *question)[1]


def test_a_mirrored_estimate_is_named_with_what_to_do_and_that_helps(files, capsys):
    code, out, _ = call(capsys, "ate", files / "truth.txt", files / "mirrored.txt")
    assert (
        code == 0
        and "warning: " in out
        and "the estimate is mirrored" in out
        and "reading it as gt.freiburg" in out
    )
    _, out, _ = call(capsys, "ate", files / "truth.txt", files / "mirrored.txt", "--json")
    assert json.loads(out)["mirror"]["mirrored"] and "mirrored" in json.loads(out)["warnings"][0]
    # written as gt.freiburg from mirrored poses: left-handed twice over, so right-handed once taken
    # as plain TUM
    taken_left = call(
        capsys, "ate", files / "truth.txt", files / "mirrored_ids.txt", "--from", "gt.freiburg"
    )[1]
    assert "mirrored" in taken_left and "reading it as tum" in taken_left
    taken_right = call(
        capsys, "ate", files / "truth.txt", files / "mirrored_ids.txt", "--from", "tum-ids"
    )[1]
    (row,) = [line for line in taken_right.splitlines() if line.startswith("translation")]
    assert "warning" not in taken_right and float(row.split()[2]) < 1e-3


def test_a_mirrored_estimate_of_a_nearly_flat_trajectory_is_named(tmp_path, capsys):
    t, rng = np.linspace(0, 6, 100), np.random.default_rng(0)
    truth = SE3.exp(
        np.stack([np.sin(t), np.cos(2 * t), 0.03 * np.sin(5 * t), 0 * t, 0 * t, 0 * t], -1)
    )
    mirrored = SE3(truth.rotation, truth.translation * [1, 1, -1] + rng.normal(0, 0.001, (100, 3)))
    for name, poses in (("truth.txt", truth), ("estimate.txt", mirrored)):
        write_trajectory(tmp_path / name, Trajectory.at_rate(poses), "tum")
    assert (
        "is mirrored" in call(capsys, "ate", tmp_path / "truth.txt", tmp_path / "estimate.txt")[1]
    )


def test_the_time_difference_is_estimate_less_truth_with_the_offset(files, tmp_path, capsys):
    names = (files / "truth.txt", files / "truth.txt")
    call(capsys, "ate", *names, "--offset", "0.003", "--csv", tmp_path / "pairs.csv")
    rows = list(csv.DictReader((tmp_path / "pairs.csv").read_text().splitlines()))
    assert {round(float(row["time_difference_s"]), 6) for row in rows} == {0.003}


def test_the_official_office_path_against_itself_has_no_error_and_mirrored_is_named(
    samples, capsys
):
    path = samples / "or_kt0/traj0.gt.freiburg"
    code, out, _ = call(capsys, "ate", path, path, "--json")
    assert code == 0 and json.loads(out)["translation_error_m"]["max"] < 1e-9
    code, out, _ = call(capsys, "ate", path, path, "--from", "tum-ids", "--json")
    values = json.loads(out)
    assert values["mirror"]["mirrored"] and values["translation_error_m"]["rmse"] > 0.2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("ate", "truth.txt", "later.txt"), "later.txt: expected stamps that overlap"),
        (("rpe", "truth.txt", "later.txt"), "try an offset of -1000 s where they fit best"),
        (("ate", "truth.txt", "absent.txt"), "absent.txt"),
        (
            ("ate", "truth.txt", "page.txt"),
            "page.txt:1: expected a trajectory file, found a web page",
        ),
        (
            ("ate", "truth.txt", "still.txt"),
            "still.txt: expected an estimated trajectory that determines SE(3)",
        ),
        (("ate", "still.txt", "truth.txt", "--align", "sim3"), "one that does not move"),
        (("ate", "truth.txt", "estimate.txt", "--align-first", "1"), "1 pose where 3 are needed"),
        (
            ("ate", "truth.txt", "estimate.txt", "--align", "affine"),
            "--align: expected one of none, origin, yaw, se3, sim3, found affine",
        ),
        (
            ("ate", "truth.txt", "estimate.txt", "--up", "w"),
            "--up: expected one of x, y, z, found w",
        ),
        (
            ("ate", "truth.txt", "estimate.txt", "--association", "best"),
            "--association: expected one of greedy, nearest",
        ),
        (
            ("ate", "truth.txt", "estimate.txt", "--max-difference", "nan"),
            "--max-difference: expected a number of 1e-09 or more (s), found nan",
        ),
        (("ate", "truth.txt", "estimate.txt", "--file-rate", "0"), "rate"),
        (("ate", "truth.txt", "estimate.txt", "--from", "word"), "format"),
        (
            ("ate", "truth.txt", "estimate.txt", "--plot", "e.bmp"),
            "e.bmp: expected a picture's name",
        ),
        (("rpe", "truth.txt", "estimate.txt", "--delta", "soon"), "expected a delta such as 10"),
        (
            ("rpe", "truth.txt", "estimate.txt", "--delta", "90m"),
            "estimate.txt: expected poses 90 metres apart",
        ),
        (
            ("rpe", "truth.txt", "estimate.txt", "--measured-on", "both"),
            "--measured-on: expected one of reference, estimate",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(files, capsys, arguments, words):
    code, out, err = call(
        capsys, *[files / a if a.endswith(".txt") else a for a in arguments], "--quiet"
    )
    assert code == 2 and out == ""
    assert words in err and len(err.splitlines()) == 1


def test_in_a_process_of_its_own_an_error_is_one_line_too(files):
    done = run("ate", files / "truth.txt", files / "later.txt", "--quiet")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("iclnuim evaluate: ") and len(done.stderr.splitlines()) == 1


def test_two_files_without_an_action_are_ate(files, capsys):
    pair = (files / "truth.txt", files / "estimate.txt", "--quiet")
    assert call(capsys, *pair) == call(capsys, "ate", *pair)
    code, _, err = call(capsys, files / "nowhere.txt", files / "estimate.txt")
    assert code == 2 and "nowhere.txt: expected a trajectory file, found no such file" in err


def test_a_few_keyframes_by_frame_number_are_refused_with_their_format(files, tmp_path, capsys):
    truth = files / "truth.txt"
    lines = [line for line in truth.read_text().splitlines() if not line.startswith("#")]
    numbered = tmp_path / "numbered.txt"
    rows = [f"{i} {lines[i].split(maxsplit=1)[1]}\n" for i in range(7, len(lines), 25)]
    numbered.write_text("".join(rows))
    code, _, said = call(capsys, truth, numbered)
    assert code == 2 and "tum-ids" in said


def test_frame_numbers_that_were_read_as_seconds_are_named_and_following_the_advice_helps(
    files, tmp_path, capsys
):
    truth = files / "truth.txt"
    lines = [line for line in truth.read_text().splitlines() if not line.startswith("#")]
    numbered = tmp_path / "numbered.txt"
    numbered.write_text(
        "".join(f"{i} {line.split(maxsplit=1)[1]}\n" for i, line in enumerate(lines))
    )
    code, out, _ = call(capsys, truth, numbered, "--json")
    assert code == 0 and "or reading it as tum-ids" in json.loads(out)["warnings"][0]
    followed = json.loads(call(capsys, truth, numbered, "--from", "tum-ids", "--json")[1])
    assert followed["translation_error_m"]["rmse"] < 1e-6 and not followed["warnings"]


def test_columns_of_large_errors_stay_apart(files, tmp_path, capsys):
    truth = [
        line.split()
        for line in (files / "truth.txt").read_text().splitlines()
        if not line.startswith("#")
    ]
    far = [[row[0], *(str(3e4 * float(x)) for x in row[1:4]), *row[4:]] for row in truth]
    (tmp_path / "far.txt").write_text("".join(" ".join(row) + "\n" for row in far))
    _, out, _ = call(capsys, "ate", files / "truth.txt", tmp_path / "far.txt")
    row = next(line for line in out.splitlines() if line.startswith("translation"))
    figures = [float(figure) for figure in row.split()[2:]]
    assert len(figures) == 6 and figures[0] > 1e4 and len(row) == 16 + 6 * 11


def test_a_terminal_shows_millimetres_with_four_digits_and_json_metres(tmp_path, capsys):
    write_pair(tmp_path, 3)
    files = (tmp_path / "truth.txt", tmp_path / "estimate.txt")
    code, out, _ = call(capsys, "ate", *files)
    (row,) = [line for line in out.splitlines() if line.startswith("translation (mm) ")]
    rmse_m = json.loads(call(capsys, "ate", *files, "--json")[1])["translation_error_m"]["rmse"]
    assert row.split()[2] == f"{1000 * rmse_m:#.4g}"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (0.0123456, "0.01235"),
        (999.96, "1000"),
        (1234.5, "1234"),
        (3e8, "3.000e+08"),
    ],
)
def test_figures_have_four_significant_digits(value, text):
    assert significant(value) == text
