"""Whatever a system does, its row says what it wrote; how it ended is told beside it."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from iclnuim.benchmark.experiments.recipes.system.recipe import runs_table
from iclnuim.formats.png import write_png
from iclnuim.trajectory_files.trajectories import read_trajectory
from judges import judge_module

#: mode: frames covered, whether there is an error below 0.1 mm, pieces of what is said
CASES = {
    "good": (60, True, []),
    "crashes at the end": (60, True, ["ended by SIGSEGV"]),
    "exit 3": (60, True, ["ended by exit 3"]),
    "twice": (59, True, ["1 repeated stamps left out"]),
    "nanoseconds": (60, True, []),
    "keyframes": (12, True, ["covers 20% of the frames"]),
    "a third": (20, True, ["covers 33% of the frames"]),
    "some NaN": (57, True, ["3 poses with NaN"]),
    "all NaN": (0, None, ["expected finite poses"]),
    "nothing": (0, None, ["wrote nothing"]),
    "says why": (0, None, ["wrote nothing; its last line: cannot open display"]),
    "words": (0, None, ["expected a trajectory"]),
    "a second late": (
        30,
        False,
        [
            "stamps are +1 s off: 0.000 mm with this offset corrected",
            "30 stamps that match no frame",
            "covers 50%",
        ],
    ),
    "between frames": (
        0,
        None,
        [
            "expected the stamps of the frames, 1.000000 to 2.966667 s, found 60 of 60 that match no frame",
            "they fit best +0.0123 s off",
        ],
    ),
    "cut": (29, True, ["ended by SIGKILL", "covers 48% of the frames"]),
    "90 Hz": (60, True, ["120 stamps that match no frame"]),
    "stops at zero": (60, True, []),
}


#: Cases of which others show the same by default.
SLOW = ("exit 3", "says why", "90 Hz", "twice", "nanoseconds", "stops at zero", "words")


def test_what_is_skipped_is_run_but_not_in_the_errors(run, fake):
    """The first 15 of 60 frames, from stamp 1 on, are a metre off."""
    system = fake("starts late")
    whole, _ = run(system)
    assert whole["starts_late"]["ate_rmse_m"] > 0.1
    rows, notes = run(system, "--skip", 0.5)
    row = rows["starts_late"]
    assert row["ate_rmse_m"] < 1e-4 and row["coverage"] == 1.0
    assert "errors without the first 0.5 s" in row["notes"] and "are not repeated" in notes
    rows, _ = run(system, "--skip", 0.46)  # the last of the 15 is at 0.467 s
    assert rows["starts_late"]["ate_rmse_m"] > 0.1


@pytest.mark.parametrize("skip", [-1, "nan", 2])
def test_a_skip_outside_the_sequence_is_one_line(run, fake, skip):
    _, text = run(fake("good"), "--skip", skip, code=2)
    assert "a time within the 1.96667 s of the sequence" in text and text.count("\n") == 1


@pytest.mark.parametrize(
    "mode", [pytest.param(m, marks=pytest.mark.slow) if m in SLOW else m for m in CASES]
)
def test_a_row_says_what_was_written(run, fake, mode):
    covered, right, pieces = CASES[mode]
    nothing = not covered and mode != "between frames"  # there the live trajectory is good
    rows, _ = run(fake(mode), code=3 if nothing else 0)
    row = rows[mode.replace(" ", "_")]
    assert row["frames"] - row["lost"] == covered and row["coverage"] == covered / 60
    assert right is None if row["ate_rmse_m"] is None else (row["ate_rmse_m"] < 1e-4) == right
    said = "; ".join(row["notes"])
    assert [piece for piece in pieces if piece not in said] == [] and bool(said) == bool(pieces), (
        said
    )


def test_live_and_final_trajectories_have_a_row_each(run, fake):
    rows, _ = run(fake("good"))
    assert list(rows) == ["good", "good live"]
    assert rows["good live"]["ate_rmse_m"] == pytest.approx(rows["good"]["ate_rmse_m"], abs=1e-6)


def alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_one_that_hangs_is_killed_with_its_children(run, fake, tmp_path):
    started = time.monotonic()
    rows, _ = run(fake("hangs"), "--time-limit", "0.4", code=3)
    assert time.monotonic() - started < 5
    assert (
        "wrote nothing" in rows["hangs"]["notes"][0]
        and "killed at the time limit" in rows["hangs"]["notes"][1]
    )
    assert rows["hangs"]["ate_rmse_m"] is None and 0.4 <= rows["hangs"]["wall_s"] < 2
    left = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True).stdout
    assert str(tmp_path) not in left


@pytest.mark.parametrize(("note", "shown"), [("killed at the time limit of 9 s", 1), ("cut", 0)])
def test_a_row_says_beside_the_number_of_runs_that_some_were_killed(note, shown):
    figures = dict.fromkeys(("ate_rmse_m", "rpe_1s_rmse_m", "ate_quartiles_m"))
    figures |= dict.fromkeys(("coverage", "wall_s", "cpu_s", "peak_bytes"), 1)
    row = {"odometer": "good", "runs": 2, "good_runs": 2, "notes": [f"run 2: {note}"], **figures}
    assert (
        runs_table({"sequence": "s", "runs": [row]}).rows[0][1] == "2/2" + ", some killed" * shown
    )


def test_medians_and_quartiles_are_of_the_runs_that_have_a_figure(run, fake, tmp_path):
    first, _ = run(fake("good"), "--runs", "2")
    assert first["good"]["runs"] == first["good"]["good_runs"] == 2
    trajectory = next(tmp_path.glob("out/cells/good/*/run_2/out/final.txt"))
    trajectory.write_text("")
    rows, _ = run(fake("good"), "--runs", "3")
    row = rows["good"]
    assert (row["runs"], row["good_runs"]) == (3, 2) and row["notes"] == ["run 2: wrote nothing"]
    each = [one["ate_rmse_m"] for one in row["each"]]
    assert each[1] is None and row["ate_rmse_m"] == (each[0] + each[2]) / 2
    # a process that ends between two samples may be seen only before it has loaded its program
    assert row["wall_s"] > 0 and row["cpu_s"] > 0 and 0 < row["peak_bytes"] < 1e9


def test_its_error_is_evos_on_the_same_file(run, fake, sequence, tmp_path):
    tools = judge_module("evo.tools.file_interface", "evo")
    from evo.core import metrics, sync

    rows, _ = run(fake("good"))
    for file in ("out/final.txt", "matched/final.txt"):
        reference = tools.read_tum_trajectory_file(sequence / "groundtruth.txt")
        estimate = tools.read_tum_trajectory_file(
            next(tmp_path.glob(f"out/cells/good/*/run_1/{file}"))
        )
        reference, estimate = sync.associate_trajectories(reference, estimate)
        estimate.align(reference)
        judge = metrics.APE(metrics.PoseRelation.translation_part)
        judge.process_data((reference, estimate))
        assert rows["good"]["ate_rmse_m"] == pytest.approx(
            judge.get_all_statistics()["rmse"], rel=0, abs=1e-9
        )


def test_runs_are_taken_up_again_and_other_settings_refused(run, fake, tmp_path):
    _, notes = run(fake("good"))
    assert "already" not in notes
    ended = next(tmp_path.glob("out/cells/good/*/run_1.cell.json"))
    before = ended.stat().st_mtime_ns
    reworded = fake("good", "deterministic = true")
    reworded.write_text(reworded.read_text().replace("a stand-in", "in other words"))
    _, notes = run(reworded, "--runs", "2")
    assert f"1 of 2 runs are in {tmp_path / 'out'} already" in notes
    assert ended.stat().st_mtime_ns == before and (ended.with_name("run_2.cell.json")).is_file()
    _, err = run(fake("good"), "--first", "30", code=2)
    assert "expected the experiment that was started there" in err and len(err.splitlines()) == 1


def test_older_results_are_refused_before_the_work(run, fake, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/results.json").write_text('{"races": []}')
    _, err = run(fake("good"), code=2)
    assert "run it again" in err and len(err.splitlines()) == 1
    assert not (tmp_path / "out/cells").exists()


def test_changed_images_are_refused_and_moved_ones_are_not(run, fake, make_sequence, tmp_path):
    data = make_sequence(tmp_path / "data/clean")
    run(fake("good"), folder=data)
    (tmp_path / "other/data").mkdir(parents=True)
    other = data.rename(tmp_path / "other/data/clean")
    rows, _ = run(
        fake("good"), "--runs", "2", folder=other
    )  # the links of the view lead to the new place
    assert rows["good"]["good_runs"] == 2
    assert {os.readlink(p) for p in tmp_path.glob("out/cells/good/*/stage/depth/*")} == {
        str(other / "depth.png")
    }
    write_png(other / "depth.png", np.full((6, 8), 1001, np.uint16))
    _, err = run(fake("good"), "--runs", "2", folder=other, code=2)
    assert "another sequence" in err and "expected the experiment that was started there" in err


@pytest.mark.parametrize("charts", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_rows_stand_beside_others_in_the_tables_and_charts_of_bench_odometry(
    run, fake, tmp_path, capsys, charts
):
    from iclnuim.headless import cli

    run(fake("good"))
    run(fake("nothing"), code=3)
    ours = {
        "odometer": "icp",
        "frames": 60,
        "lost": 0,
        "degenerate": 1,
        "ms_median": 9.0,
        "ms_95": 12.0,
    }
    ours |= {"frames_per_s": 100.0, "ate_rmse_m": 0.001, "rpe_1s_rmse_m": 0.002}
    race = {"sequence": "kt2/clean", "preset": "best", "runs": [ours]}
    (tmp_path / "ours.json").write_text(json.dumps({"results": [race]}))
    (tmp_path / "more.json").write_text(
        json.dumps({"results": [{**race, "runs": [{**ours, "odometer": "dvo"}]}]})
    )
    files = [str(tmp_path / name) for name in ("out/results.json", "ours.json", "more.json")]
    plot = ["--plot", str(tmp_path / "chart.png")] if charts else []
    assert cli.main(["bench", "odometry", *files, *plot]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "kt2/clean, our odometers with preset best"
    assert [line.split()[0] for line in lines[2:7]] == ["icp", "dvo", "good", "good", "nothing"]
    assert "wrote nothing" in lines[7] and (
        not charts or (tmp_path / "chart.png").stat().st_size > 5000
    )


def test_an_interrupted_run_leaves_no_process_and_no_half_run(fake, sequence, tmp_path):
    command = [
        sys.executable,
        "-m",
        "iclnuim",
        "run",
        str(fake("hangs")),
        str(sequence),
        "-o",
        str(tmp_path / "out"),
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        deadline = time.monotonic() + 20
        while (
            not list(tmp_path.glob("out/cells/hangs/*/.run_1.part/out/arguments.json"))
            and time.monotonic() < deadline
        ):
            time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 130
    folder = next(tmp_path.glob("out/cells/hangs/*"))
    assert sorted(path.name for path in folder.iterdir()) == ["stage"]
    assert (
        str(tmp_path)
        not in subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True).stdout
    )


def test_a_trajectory_that_was_matched_has_the_frames_own_stamps(
    run, fake, make_sequence, tmp_path
):
    """Of a sequence from 0 s on the view begins at 1 s, and a system that stops at a stamp of 0
    runs.
    """
    folder = make_sequence(tmp_path / "kt2/zero", 0.0)
    rows, _ = run(fake("stops at zero"), folder=folder)
    assert rows["stops_at_zero"]["ate_rmse_m"] < 1e-4
    place = next(tmp_path.glob("out/cells/stops_at_zero/*/run_1"))
    assert (place / "out/final.txt").read_text().startswith("1.000000 ")
    assert read_trajectory(place / "matched/final.txt").trajectory.stamps_s[0] == 0
