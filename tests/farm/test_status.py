"""`iclnuim status`: the files alone say what is done."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.formats.files import write_json
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.cli import main
from iclnuim.headless.farm import slurm_queue
from iclnuim.headless.farm.lock import OutputLock
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.headless.farm.tasks import SequenceStage
from iclnuim.job import shipped_job
from iclnuim.sequences.run_folder import load_trajectory, open_run
from iclnuim.sequences.sequence_options import SequenceOptions


@pytest.fixture
def run(tmp_path):
    job = shipped_job("kt2").changed(camera=PinholeCamera.parse("16x12"))
    run = open_run(tmp_path / "out/raw", {"job": job.to_dict()}, load_trajectory(job))
    for number in (0, 1, 3):
        run.write_frame(number, np.zeros((12, 16, 3)), np.ones((12, 16)))
    return run


def told(capsys, *arguments):
    assert main(["status", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_folder_tells_which_frames_are_missing(run, capsys):
    values = told(capsys, run.path, "--frames", ":5")
    assert (values["frames"], values["finished"], values["missing_frames"]) == (5, 3, [2, 4])
    assert told(capsys, run.path.parent, "--frames", ":5")["missing_frames"] == [2, 4]


def test_a_broken_frame_counts_as_missing(run, capsys):
    file = run.frame_file(1)
    file.write_bytes(file.read_bytes()[:-20])
    assert told(capsys, run.path, "--frames", ":4")["missing_frames"] == [1, 2]


@pytest.mark.skipif(not os.path.exists("/proc/self/io"), reason="Linux counts what is read")
def test_of_a_frame_its_header_is_read_and_no_pixel(tmp_path):
    job = shipped_job("kt2").changed(camera=PinholeCamera.parse("640x480"))
    run = open_run(tmp_path, {"job": job.to_dict()}, load_trajectory(job))
    run.write_frame(0, np.zeros((480, 640, 3)), np.ones((480, 640)))
    assert run.key and run.camera.width == 640 and run.missing([0]) == []  # all else is read now

    def read_bytes(read_pixels):
        before = _bytes_read()
        assert run.missing([0], read_pixels=read_pixels) == []
        return _bytes_read() - before

    size = run.frame_file(0).stat().st_size
    assert read_bytes(read_pixels=True) > size
    assert read_bytes(read_pixels=False) < size / 10


def _bytes_read():
    with open("/proc/self/io") as counters:
        return int(dict(line.split(": ") for line in counters)["rchar"])


def test_frames_that_became_pairs_are_not_missed(run, capsys):
    for name in ("clean", "noisy"):
        (run.path.parent / name).mkdir()
        (run.path.parent / name / "frames.jsonl").write_text('{"frame": 0}\n{"fra')
    run.frame_file(0).unlink()
    values = told(capsys, run.path, "--frames", ":4")
    assert (values["in_sequences"], values["missing_frames"]) == (1, [2])


def test_images_that_were_deleted_are_missing(run, capsys):
    job = shipped_job("kt2").changed(camera=PinholeCamera.parse("16x12"))
    plan = RunPlan(job, run.path, (0, 1, 3), SequenceOptions(), keep_raw=False)
    with SequenceStage(plan, 1) as stage:
        stage.begin(run)
        stage.add_finished(plan.numbers)
        stage.complete()
    plan.write_record()
    assert told(capsys, run.path.parent)["missing_frames"] == []
    (run.path.parent / "noisy/depth/000001.png").unlink()
    values = told(capsys, run.path.parent)
    assert (values["in_sequences"], values["missing_frames"]) == (2, [1])


@pytest.mark.parametrize(
    "wrong", [{"light": []}, {"light": {}}, {"camera": []}, {"camera": {"fx": 0}}]
)
def test_a_setting_of_the_job_that_is_wrong_names_the_recipe(run, wrong, capsys):
    write_json(run.path / "sequence.json", {"job": {**run.recipe["job"], **wrong}})
    assert main(["status", str(run.path)]) == 2
    assert "raw/sequence.json: " in capsys.readouterr().err


def test_a_killed_command_does_not_count_as_working(run, capsys):
    program = (
        "import os, sys; from pathlib import Path; from iclnuim.headless.farm.lock import OutputLock;"
        "lock = OutputLock(Path(sys.argv[1])); lock.__enter__(); os.kill(os.getpid(), 9)"
    )
    subprocess.run(
        [sys.executable, "-c", program, run.path / ".farm"], env=environment(), check=False
    )
    assert (run.path / ".farm/lock").is_file() and told(capsys, run.path)["locked_by"] is None
    with OutputLock(run.path / ".farm"):
        assert told(capsys, run.path)["locked_by"].startswith(f"process {os.getpid()} on ")


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def test_a_folder_without_a_run_is_bad_input(tmp_path, capsys):
    assert main(["status", str(tmp_path)]) == 2
    assert "no sequence.json" in capsys.readouterr().err


def test_a_queue_that_does_not_answer_is_unknown_not_empty(run, capsys, monkeypatch):
    slurm_queue.record(run.path, [slurm_queue.Submitted("11", "frames", ((2, 4),))])
    monkeypatch.setenv("PATH", str(run.path))
    assert told(capsys, run.path)["queue"].startswith("unknown (")
