"""`--dry-run` says what would run, how long and how large, and does nothing."""

import argparse
import json

import iclnuim
import numpy as np
import pytest
from iclnuim.console import Console
from iclnuim.headless.cli import main
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.headless.planned_work import PlannedWork, announce
from iclnuim.job import shipped_job


def planned(capfd, *words):
    assert main([*words, "--dry-run", "--json", "--quiet"]) == 0
    return json.loads(capfd.readouterr().out)


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def few_frames(tmp_path):
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = np.arange(4) / 10
    images = (np.full((48, 64, 3), 0.3), np.full((48, 64), 2.0))
    iclnuim.make_sequence(iclnuim.frames_from("64x48", poses, lambda k: images), "few", workers=1)
    return "few"


@pytest.mark.parametrize(
    "line",
    ["make kt2", "make all", "render kt2", "bake office --map-size 512", "make kt2 --quick"],
)
def test_nothing_is_made(line, tmp_path, capfd):
    found = planned(capfd, *line.split())
    assert found["seconds"] > 1
    assert list(tmp_path.iterdir()) == []


def test_more_frames_and_pixels_take_longer_and_more_room(capfd):
    few = planned(capfd, "make", "kt2", "--frames", ":100")
    many = planned(capfd, "make", "kt2", "--frames", ":800")
    small = planned(capfd, "make", "kt2", "--frames", ":800", "--camera", "160x120")
    assert few["work"].startswith("100 of 100 frames to render")
    assert 2 < many["seconds"] / few["seconds"] < 8
    assert many["gigabytes"] == pytest.approx(8 * few["gigabytes"])
    assert small["gigabytes"] == pytest.approx(many["gigabytes"] / 16)


def test_raw_frames_count_where_they_stay(capfd):
    removed = planned(capfd, "make", "kt2", "--frames", ":10")["gigabytes"]
    kept = planned(capfd, "make", "kt2", "--frames", ":10", "--keep-raw")["gigabytes"]
    raw = planned(capfd, "render", "kt2", "--frames", ":10")["gigabytes"]
    assert 0 < removed < kept
    assert kept == pytest.approx(removed + raw)
    of_all = planned(capfd, "make", "all", "--frames", ":10")["gigabytes"]
    assert of_all == pytest.approx(8 * removed)


def test_light_that_is_shipped_is_not_baked(capfd):
    assert main(["bake", "living_room", "--dry-run"]) == 0
    assert capfd.readouterr().out.endswith(": nothing to do\n")
    double = [planned(capfd, "bake", "office", "--map-size", size) for size in ("512", "1024")]
    assert double[1]["seconds"] == pytest.approx(4 * double[0]["seconds"])
    assert double[1]["gigabytes"] == pytest.approx(4 * double[0]["gigabytes"])


@pytest.mark.parametrize(
    ("seconds", "gigabytes", "text"),
    [
        (0, 0, "frames: nothing to do"),
        (61, 0.01, "frames: about 61 s"),
        (300, 1.06, "frames: about 5 minutes, 1.1 GB"),
        (9000, 20, "frames: about 2.5 hours, 20.0 GB"),
    ],
)
def test_time_and_room_are_said_in_units_that_fit(seconds, gigabytes, text):
    assert PlannedWork("frames", seconds, gigabytes).sentence() == text


@pytest.mark.parametrize(("seconds", "noted"), [(59, False), (61, True)])
def test_work_of_more_than_a_minute_is_announced(seconds, noted, capfd):
    args = argparse.Namespace(dry_run=False)
    assert not announce(PlannedWork("frames", seconds), args, Console())
    out, err = capfd.readouterr()
    assert out == "" and bool(err) == noted


def test_a_dry_run_for_slurm_shows_the_job_scripts(capfd):
    pytest.importorskip("submitit")
    assert main(["make", "kt2", "--engine", "slurm", "--dry-run"]) == 0
    assert "#SBATCH" in capfd.readouterr().out


def test_a_plan_without_sequences_lacks_all_frames(tmp_path):
    assert RunPlan(shipped_job("kt2"), tmp_path / "raw", (0, 1, 2)).unwritten() == 3


def test_more_odometers_and_steps_take_longer(capfd, few_frames):
    one = planned(capfd, "bench", "odometry", few_frames, "--only", "icp_rgbd")
    all_of_ours = planned(capfd, "bench", "odometry", few_frames, "--only", "ours")
    assert all_of_ours["seconds"] == pytest.approx(5 * one["seconds"])
    curve = ("bench", "curve", "iterations", few_frames, "--method", "icp", "--frames", ":3")
    two = planned(capfd, *curve, "--values", "1,2")
    four = planned(capfd, *curve, "--values", "1,2,3,4")
    assert two["work"].startswith("2 steps of iterations, 3 frames")
    assert four["seconds"] == pytest.approx(2 * two["seconds"])
