"""`iclnuim stress` from folder to pages: cells are made once, made again where they differ, and the
same whenever they are made.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser

import iclnuim
import pytest
from box_scene import truth  # noqa: F401
from iclnuim.benchmark.experiments import code_version
from iclnuim.benchmark.experiments.inputs import Input
from iclnuim.benchmark.experiments.recipes.stress.recipe import work_s
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.benchmark.perturbations.plan import read_plan
from iclnuim.errors import InputError
from iclnuim.headless.commands.stress import _segment, _systems
from iclnuim.sequences.imu import SequenceImu, write_imu
from iclnuim.sequences.stored_sequence import StoredSequence
from patience import patience

SMALL = ("--frames", ":6", "--starts", "1", "--methods", "opencv", "--workers", "1")


def cells(out):
    found = {}
    for file in sorted((out / "cells").rglob("*.cell.json")):
        content = json.loads(file.read_text())
        content["figures"].pop("seconds")
        found[str(file.relative_to(out))] = content
    return found


def test_the_list_has_one_perturbation_a_line_with_its_severities(command_here):
    code, out, _ = command_here("stress", "--list")
    lines, plan = out.splitlines(), read_plan()
    assert code == 0 and [line.split()[0] for line in lines] == list(plan.perturbations)
    assert "  4      5      6      7      8  x" in next(
        line for line in lines if line.startswith("speed")
    )


def test_cells_are_made_once_and_pages_show_them(command_here, folder, tmp_path):
    out = tmp_path / "out"
    words = ("stress", folder, "-o", out, "--only", "holes", "--severities", "1,5", *SMALL)
    code, text, _ = command_here(*words)
    assert code == 0 and "opencv-rgbd" in text and "holes" in text
    first = cells(out)
    assert len(first) == 3 * 3  # unperturbed, and two severities
    stamps = {file: os.stat(out / file).st_mtime_ns for file in first}
    victim = next(file for file in first if "holes_5" in file)
    (out / victim).unlink()
    code, text_again, _ = command_here(*words, "--quiet")
    assert (code, text_again) == (0, text) and cells(out) == first
    assert [file for file in first if os.stat(out / file).st_mtime_ns != stamps[file]] == [victim]
    parser = HTMLParser()
    parser.feed((out / "stress.html").read_text())


def test_cells_of_another_version_of_a_package_are_made_again(
    command_here, folder, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    words = ("stress", folder, "-o", out, "--only", "holes", "--severities", "5", *SMALL, "--quiet")
    assert command_here(*words, "--methods", "icp")[0] == 0
    stamps = {file: os.stat(out / file).st_mtime_ns for file in cells(out)}
    monkeypatch.setattr(code_version, "package_version", lambda package: "0.0.1")
    assert command_here(*words, "--methods", "icp")[0] == 0
    again = {file for file in stamps if os.stat(out / file).st_mtime_ns != stamps[file]}
    assert again and again == {file for file in stamps if "/open" in file}


def test_cells_of_other_code_are_made_again(command_here, folder, tmp_path, monkeypatch):
    """Other code of our odometers: only their cells; other code that perturbs frames: all cells."""
    out = tmp_path / "out"
    words = ("stress", folder, "-o", out, "--only", "holes", "--severities", "5", *SMALL, "--quiet")
    words += ("--methods", "icp")
    assert command_here(*words)[0] == 0
    code_of = code_version.code_of
    for name, expected in (("Icp", "/icp"), ("Plan", "")):
        stamps = {file: os.stat(out / file).st_mtime_ns for file in cells(out)}

        def other(*entries, name=name):
            first = getattr(entries[0], "__name__", entries[0])
            return "other" if first.endswith(name) else code_of(*entries)

        for place in ("code_version", "recipes.stress.recipe"):
            monkeypatch.setattr(f"iclnuim.benchmark.experiments.{place}.code_of", other)
        assert command_here(*words)[0] == 0
        again = {file for file in stamps if os.stat(out / file).st_mtime_ns != stamps[file]}
        assert again and again == {file for file in stamps if expected in file}


def test_cells_of_a_file_are_reported_without_being_measured(
    command_here, folder, tmp_path, monkeypatch
):
    """The published cells give the same table in a folder without sequences, and next to other
    cells.
    """
    words = ("--only", "holes", "--severities", "1,5", *SMALL, "--quiet")
    assert command_here("stress", folder, "-o", tmp_path / "first", *words)[0] == 0
    code, table, _ = command_here(
        "stress", folder, "-o", tmp_path / "first", *words, "--report-only"
    )
    published = tmp_path / "first" / "stress.csv"
    monkeypatch.chdir(tmp_path)
    copied = ("stress", "--cells", published, "--report-only")
    assert (
        command_here(*copied, "-o", tmp_path / "second", *words)[:2] == (0, table) == (code, table)
    )
    assert (tmp_path / "second/stress.csv").read_bytes() == published.read_bytes()
    some = ("--only", "holes", "--severities", "5", "--methods", "opencv-icp", "--quiet")
    _, json_text, _ = command_here(*copied, "-o", tmp_path / "third", *some, "--json")
    assert {(c["method"], c["severity"]) for c in json.loads(json_text)["cells"]} == {
        ("opencv-icp", 0),
        ("opencv-icp", 5),
    }


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("method,", "", ":1: expected the columns sequence,start,"),
        (",True,", ",yes,", "expected figures of a cell, found"),
        (",6,1,", ",6,nan,", "expected figures of a cell, found"),
        (",6,1,", ",,1,", "expected figures of a cell, found"),
        (",holes,5,", ",holes,", "values, found"),
    ],
)
def test_a_damaged_file_of_cells_is_named_with_its_line(
    command_here, folder, tmp_path, old, new, message
):
    words = ("-o", tmp_path / "out", "--only", "holes", "--severities", "5", *SMALL, "--quiet")
    assert command_here("stress", folder, *words)[0] == 0
    text = (tmp_path / "out/stress.csv").read_text()
    assert old in text
    file = tmp_path / "damaged.csv"
    file.write_text(text.replace(old, new, 1))
    code, _, err = command_here("stress", "--cells", file, "--report-only", *words)
    assert code == 2 and f"{file}:" in err and message in err


def test_two_frames_are_no_segment():
    assert _segment(3) == 3
    with pytest.raises(InputError, match="expected at least 3 frames, found :2"):
        _segment(2)


def test_options_of_a_system_given_by_its_path(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        'about = "x"\nprogram = "true"\ncommand = ["{program}", "{mode}"]\n[options]\nmode = ""\n[trajectories.final]\nfile = "f.txt"\n'
    )
    (system,) = _systems(argparse.Namespace(system=[str(file)], set=[f"{file}.mode=1.5"]))
    assert system.options["mode"] == "1.5"


def test_without_an_image_the_other_frames_are_another_input(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    whole = Input.of(Sequence(copy), "kt2")
    next(copy.glob("depth/*3.png")).unlink()
    less = Input.of(Sequence(copy), "kt2")
    assert len(less.sequence) == len(whole.sequence) - 1 and less.sha256 != whole.sha256


@pytest.mark.slow
def test_heat_maps_are_drawn(command_here, folder, tmp_path):
    picture = tmp_path / "stress.png"
    assert (
        command_here(
            "stress", folder, "-o", tmp_path / "out", "--plot", picture, "--only", "holes", *SMALL
        )[0]
        == 0
    )
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--only", "xyz"), "--only: expected part of a name of bare_wall"),
        (("--methods", "xyz"), "--methods: expected part of a name of dvo"),
        (("--frames", ":400", "--methods", "opencv"), "expected at least 400 frames"),
        (("--system", "fovis", "--set", "x=1"), "--set: expected SYSTEM.NAME=VALUE"),
        (
            ("--report-only", "--methods", "opencv"),
            "no measured cells; try the same command without --report-only",
        ),
    ],
)
def test_what_cannot_be_is_said_in_one_line(command_here, folder, tmp_path, words, message):
    code, _, err = command_here("stress", folder, "-o", tmp_path / "out", *words)
    assert code in (2, 3) and message in err.splitlines()[-1]


def test_it_ends_though_opencv_has_threads_already(folder, tmp_path):
    """A fork does not have the threads that OpenCV started before; it would wait for them for ever."""
    program = "import cv2, numpy, sys; from iclnuim.headless.cli import main; "
    program += "cv2.setNumThreads(4); cv2.resize(numpy.zeros((2000, 2000), 'f'), (999, 999)); sys.exit(main())"
    words = [
        "stress",
        folder,
        "-o",
        tmp_path / "out",
        "--only",
        "holes",
        "--severities",
        "5",
        *SMALL,
        "--quiet",
    ]
    subprocess.run(
        [sys.executable, "-c", program, *words],
        check=True,
        capture_output=True,
        timeout=patience(60),
    )
    assert len(cells(tmp_path / "out")) == 2 * 3


@pytest.mark.slow
def test_killed_twenty_times_it_ends_with_the_same_table(folder, tmp_path):
    words = [
        sys.executable,
        "-m",
        "iclnuim",
        "stress",
        folder,
        "--only",
        "holes",
        "--only",
        "noise",
        "--only",
        "speed",
    ]
    words += [*SMALL[:-2], "--workers", "2", "--quiet"]
    begun = time.monotonic()
    whole = subprocess.run(
        [*words, "-o", tmp_path / "whole"], capture_output=True, text=True, check=True
    )
    took_s = time.monotonic() - begun
    kills, out = 0, tmp_path / "out"
    while kills < 20:
        process = subprocess.Popen([*words, "-o", out], stdout=subprocess.DEVNULL)
        time.sleep(took_s * (0.4 + 0.03 * kills))
        if process.poll() is not None:
            break
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        kills += 1
    last = subprocess.run([*words, "-o", out], capture_output=True, text=True, check=True)
    assert kills > 3 and last.stdout == whole.stdout and cells(out) == cells(tmp_path / "whole")


@pytest.mark.slow
def test_a_system_is_judged_by_what_it_writes_of_the_perturbed_frames(
    command_here, folder, tmp_path
):
    """The same odometer in this process and as a system has the same error."""
    words = (
        "stress",
        folder,
        "-o",
        tmp_path / "out",
        "--only",
        "holes",
        "--severities",
        "5",
        "--frames",
        ":8",
    )
    words = (*words, "--starts", "1", "--methods", "opencv-icp", "--workers", "1")
    code, _, err = command_here(*words, "--system", "opencv-rgbd-icp", "--runs", "2")
    assert code == 0, err
    both = ("--methods", "opencv-rgbd-icp")
    assert command_here(*words[:-4], *both, "-o", tmp_path / "again", "--workers", "1")[0] == 0
    place, name = "cells/box_clean/4/holes_5", "opencv-rgbd-icp.cell.json"
    files = tmp_path / "out" / place / f"run_{name}", tmp_path / "again" / place / name
    system, own = (json.loads(file.read_text()) for file in files)
    assert system["identity"]["runs"] == 1  # it is deterministic
    system, own = system["figures"], own["figures"]
    assert (
        system["ate_m"] == pytest.approx(own["ate_m"], rel=0.02)
        and system["coverage"] == own["coverage"]
    )
    assert not (tmp_path / "out/work").exists() or not any((tmp_path / "out/work").rglob("*.png"))


def test_what_is_written_for_systems_elsewhere_has_the_readings_of_the_imu(
    command_here,
    folder,
    truth,  # noqa: F811
    tmp_path,
):
    sequence = tmp_path / "sequence"
    shutil.copytree(folder, sequence)
    write_imu(sequence, SequenceImu(iclnuim.imu_of(truth)))
    words = ("stress", sequence, "-o", tmp_path / "out", "--only", "holes", "--severities", "5")
    words = (*words, "--frames", ":4", "--starts", "1", "--write", tmp_path / "there")
    assert command_here(*words)[0] == 0
    places = list((tmp_path / "there/sequences").rglob("imu.csv"))
    assert len(places) == 2  # as rendered, and perturbed
    source = StoredSequence(sequence).imu.stream
    for place in places:
        written = StoredSequence(place.parent)
        kept = source.around(*written.stamps_s[[0, -1]])
        assert (written.imu.stream.readings == kept.readings).all()


def test_the_announced_work_is_within_half_of_what_was_measured():
    """Five odometers on 78 segments of 120 noisy frames, at severity 5 and unperturbed."""
    measured_s = 3438
    assert 1 / 1.5 < work_s(120, 78, 390) / measured_s < 1.5
    assert work_s(120, 1, 5) < 5 * work_s(120, 1, 1)  # the frames are perturbed once


def test_a_dry_run_counts_the_cells_that_are_missing_and_measures_none(
    folder, tmp_path, command_here
):
    words = ("stress", folder, "--only", "holes", "--methods", "icp", "--starts", "1")
    out = tmp_path / "out"
    code, said, _ = command_here(*words, "--frames", ":6", "--dry-run", "--workers", 1, "-o", out)
    assert code == 0 and said.startswith(
        "6 of 6 cells to measure, noisy frames perturbed, 36 of them, "
    )
    assert not list(tmp_path.rglob("*.json"))
