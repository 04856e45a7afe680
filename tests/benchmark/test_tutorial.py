"""The commands of docs/guide/benchmark.md from nothing to one row of each table; killed in the
middle, the same tables come out, to the byte.
"""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.tools import file_interface
from iclnuim.headless import cli

pytestmark = pytest.mark.slow
#: A quarter of the page's pixels, to spare the time.
SMALL = ["--camera", "320x240"]


@pytest.fixture(scope="module")
def made(repository, tmp_path_factory):
    """A folder in which the page's first commands were given."""
    folder = tmp_path_factory.mktemp("tutorial")
    page = (repository / "docs/guide/benchmark.md").read_text()
    block = re.search(r"## From an empty machine.*?```sh\n(.*?)```", page, re.S)[1]
    commands = [
        shlex.split(line, comments=True)[1:]
        for line in block.splitlines()
        if line.startswith("iclnuim")
    ]
    assert [words[0] for words in commands] == ["make", "make", "benchmark", "table"]
    before = os.getcwd()
    os.chdir(folder)
    try:
        for words in commands:
            assert run(words + (SMALL if words[0] == "make" else [])) == 0, words
    finally:
        os.chdir(before)
    return folder


def run(words):
    return subprocess.run([sys.executable, "-m", "iclnuim", *words], env=environment()).returncode


def environment():
    return {**os.environ, "PYTHONUNBUFFERED": "1"}


def rows(folder, name):
    """Of a table as CSV."""
    lines = (folder / f"out/benchmark/tables/{name}.csv").read_text().splitlines()
    return [line.split(",") for line in lines]


@pytest.mark.parametrize("number", range(2, 8))
def test_each_table_has_a_row_of_ours(made, number):
    table = rows(made, f"table_{number}")
    column = table[0].index("kt0")
    mine = next(row for row in table if row[0] in ("icp", "Mean"))
    assert float(mine[column]) > 0


def test_the_error_is_evos(made):
    """Of the estimate that the cell keeps, against the sequence's ground truth."""
    cell = made / "out/benchmark/cells/office/kt0/noisy/icp_best_model"
    truth = file_interface.read_tum_trajectory_file(made / "out/office/kt0/noisy/groundtruth.txt")
    estimate = file_interface.read_tum_trajectory_file(cell / "trajectory.txt")
    truth, estimate = sync.associate_trajectories(truth, estimate)
    estimate.align(truth)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((truth, estimate))
    shown = next(row for row in rows(made, "table_6") if row[0] == "icp")[
        rows(made, "table_6")[0].index("kt0")
    ]
    assert float(shown) == pytest.approx(
        1e3 * ape.get_statistic(metrics.StatisticsType.rmse), abs=0.0051
    )


def test_the_same_command_measures_nothing_again_and_another_is_refused(made, capfd):
    started, base = (
        time.monotonic(),
        ["benchmark", "--data", str(made / "out"), "--out", str(made / "out/benchmark")],
    )
    words = [*base, "--only", "kt0/icp/model", "--first"]
    assert cli.main([*words, "60"]) == 0
    assert (
        "4 of them already measured" in capfd.readouterr().err and time.monotonic() - started < 60
    )
    assert cli.main([*words, "50"]) == 2
    assert "first 60 there, 50 requested" in capfd.readouterr().err


def test_killed_at_any_moment_it_ends_in_the_same_tables(made, tmp_path):
    whole, killed, rng = tmp_path / "whole", tmp_path / "killed", np.random.default_rng(0)
    words = [
        "benchmark",
        "--data",
        str(made / "out"),
        "--first",
        "12",
        "--only",
        "kt0/icp/model/living_room",
    ]
    started = time.monotonic()
    assert run([*words, "--out", str(whole)]) == 0
    took_s = time.monotonic() - started
    for _ in range(20):
        work = subprocess.Popen(
            [sys.executable, "-m", "iclnuim", *words, "--out", str(killed)], env=environment()
        )
        time.sleep(rng.uniform(0.1, 0.9) * took_s)
        work.send_signal(signal.SIGKILL)
        work.wait()
    assert run([*words, "--out", str(killed)]) == 0
    for path in [
        *(whole / "tables").iterdir(),
        *whole.glob("cells/**/trajectory.txt"),
    ]:
        assert path.read_bytes() == (killed / path.relative_to(whole)).read_bytes(), path
    for path in whole.glob("cells/**/*.cell.json"):
        one, other = (
            json.loads((o / path.relative_to(whole)).read_text()) for o in (whole, killed)
        )
        times = {"times": None}
        assert {**one, "figures": one["figures"] | times} == {
            **other,
            "figures": other["figures"] | times,
        }
    assert not [
        path for path in killed.rglob("*") if path.name.endswith(".part") or ".tmp" in path.name
    ]


def test_a_dry_run_counts_the_cells_that_are_missing(made, tmp_path, capfd):
    words = ["benchmark", "--data", str(made / "out"), "--out", str(tmp_path / "none")]
    words += ["--frames", ":12", "--only", "kt0/icp/model/office", "--dry-run"]
    expected_s = {}
    for options in ((), ("--no-surfaces",)):
        assert cli.main([*words, "--workers", "1", "--json", *options]) == 0
        planned = json.loads(capfd.readouterr().out)
        assert planned["work"].startswith("2 of 2 cells to measure, 1 processes; best, model: 2")
        expected_s[options] = planned["seconds"]
    assert 0 < expected_s[("--no-surfaces",)] < expected_s[()] < 60
    assert not (tmp_path / "none").exists()


def test_a_surface_that_is_measured_later_is_the_same(made, tmp_path, capfd):
    only = ["--only", "kt0/icp/living_room/noisy", "--first", "12"]
    words = ["benchmark", "--data", str(made / "out"), *only, "--out"]
    assert run([*words, str(tmp_path / "once")]) == 0
    assert run([*words, str(tmp_path / "later"), "--no-surfaces"]) == 0
    capfd.readouterr()
    assert run([*words, str(tmp_path / "later")]) == 0
    assert "only the surface is missing" in capfd.readouterr().err
    cell = "cells/living_room/kt0/noisy/icp_best_model.cell.json"
    once, later = (json.loads((tmp_path / out / cell).read_text()) for out in ("once", "later"))
    assert once["identity"] == later["identity"]
    for name in ("ate_m", "surface"):
        assert once["figures"][name] == later["figures"][name]
    for name in ("surface.jpg", "heat.jpg", "trajectory.txt"):
        place = Path(cell.removesuffix(".cell.json"), name)
        assert (tmp_path / "once" / place).read_bytes() == (tmp_path / "later" / place).read_bytes()
