"""Runs handed over to a real Slurm: whatever is cancelled or dies on the way, after `resume` the
bytes are those of a local run.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import patience

pytest.importorskip("bpy", reason="needs the bpy package")
pytest.importorskip("submitit", reason="needs submitit: pip install submitit")

pytestmark = pytest.mark.slow
SMALL = (
    "--light",
    "path",
    "--samples",
    "1",
    "--no-denoise",
    "--camera",
    "80x60",
    "--frames",
    "0:60",
)
ENGINE = ("--engine", "slurm", "--cpus", "2", "--memory", "1G")


class Cluster:
    """Our commands where Slurm's work, and what its queue says."""

    def __init__(self, slurm, folder: Path) -> None:
        self.slurm, self.environment = (
            slurm,
            {**slurm.environment, "ICLNUIM_CACHE": str(folder / "cache")},
        )

    def run(self, *command: str) -> subprocess.CompletedProcess:
        words = [sys.executable, "-m", "iclnuim", *map(str, command)]
        done = subprocess.run(
            words, env=self.environment, capture_output=True, text=True, timeout=patience(500)
        )
        assert done.returncode == 0, done.stderr
        return done

    def status(self, out: Path) -> dict:
        return json.loads(self.run("status", out, "--json").stdout)

    def tasks(self, state: str) -> list[str]:
        return self.slurm.call(
            "squeue", "-h", "-r", "-n", "iclnuim-frames", "-t", state, "-o", "%i"
        ).split()

    def wait(self, condition, seconds: float = 300) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.slurm.call("squeue", "-l")
            time.sleep(0.1)

    def wait_until_empty(self) -> None:
        self.wait(lambda: not self.slurm.call("squeue", "-h"))


@pytest.fixture
def cluster(slurm, tmp_path):
    return Cluster(slurm, tmp_path)


def frames_in(out: Path) -> int:
    return len(list((out / "raw/exr").glob("[0-9]*.exr")))


def contents(out: Path) -> dict[str, bytes]:
    """Every file of both sequences; the commit of the checkout decides no pixel."""
    files = [p for s in ("clean", "noisy") for p in (out / s).rglob("*.*") if p.is_file()]
    found = {str(p.relative_to(out)): p.read_bytes() for p in files}
    for name in ("clean/recipe.json", "noisy/recipe.json"):
        recipe = json.loads(found[name])
        recipe.pop("source_commit")
        recipe["source"]["run"].pop("source_commit")
        found[name] = json.dumps(recipe).encode()
    return found


def test_after_a_cancelled_task_and_a_killed_node_resume_gives_the_bytes_of_a_local_run(
    cluster, tmp_path
):
    out, local = tmp_path / "far", tmp_path / "near"
    cluster.run("make", "kt2", *SMALL, *ENGINE, "--chunk-minutes", "0.005", "--out", out)
    assert cluster.status(out)["missing"] == 60, "told before there is a recipe"
    cluster.wait(lambda: frames_in(out) >= 3)
    victim = [*cluster.tasks("running"), *cluster.tasks("pending")][-1]
    cluster.slurm.call("scancel", victim)
    before = frames_in(out)
    cluster.wait(lambda: frames_in(out) >= before + 3)
    cluster.slurm.kill_node()
    time.sleep(2)
    cluster.slurm.start_node()
    cluster.wait_until_empty()
    state = cluster.status(out)
    assert 0 < state["missing"] < 60, (
        "the cancelled task's frames are missing, and the folder says so"
    )
    assert "are not rendered" in state["failed"]
    words = cluster.run("resume", out).stderr
    assert f"{state['missing']} frames in" in words, words
    cluster.wait_until_empty()
    assert cluster.status(out)["missing"] == 0
    assert "nothing is missing" in cluster.run("resume", out).stderr
    cluster.run("make", "kt2", *SMALL, "--out", local)
    ours, theirs = contents(out), contents(local)
    assert sorted(ours) == sorted(theirs) and len(ours) > 240
    assert [name for name in ours if ours[name] != theirs[name]] == []


def test_what_is_in_the_queue_is_not_submitted_twice_and_arrays_keep_to_their_limit(
    cluster, tmp_path
):
    out = tmp_path / "far/raw"
    cluster.run("render", "kt2", *SMALL, *ENGINE, "--chunk-minutes", "0.001", "--out", out)
    jobs = json.loads((out / ".farm/slurm/submitted.json").read_text())["jobs"]
    arrays = [len(job["chunks"]) for job in jobs if job["stage"] == "frames"]
    assert len(arrays) > 1 and max(arrays) <= 21, arrays
    assert "nothing to submit" in cluster.run("resume", out).stderr
    assert "pending" in cluster.run("status", out).stdout
    cluster.slurm.call("scancel", *(job["job"] for job in jobs))
    cluster.wait_until_empty()


def test_a_task_that_must_make_room_goes_back_into_the_queue_and_on(cluster, tmp_path):
    out = tmp_path / "far/raw"
    cluster.run(
        "render",
        "kt2",
        *SMALL,
        *ENGINE,
        "--chunk-minutes",
        "0.05",
        "--scratch",
        tmp_path / "s p",
        "--out",
        out,
    )
    cluster.wait(lambda: frames_in(out.parent) >= 2)
    assert list((tmp_path / "s p").glob(".work-*")) and not list(out.glob(".work-*"))
    cluster.slurm.call("scancel", "--signal", "USR2", cluster.tasks("running")[0])
    cluster.wait_until_empty()
    logs = "".join(p.read_text() for p in (out / ".farm/slurm").glob("*log.*"))
    assert "requeued" in logs
    assert cluster.status(out)["missing"] == 0


def test_a_node_that_loses_power_and_comes_back_gets_its_tasks_again(cluster, tmp_path):
    out = tmp_path / "far/raw"
    cluster.run("render", "kt2", *SMALL, *ENGINE, "--chunk-minutes", "0.05", "--out", out)
    cluster.wait(lambda: frames_in(out.parent) >= 2)
    cluster.slurm.lose_node()
    before = cluster.status(out)["missing"]
    assert before > 0
    cluster.slurm.start_node()
    cluster.wait_until_empty()
    assert cluster.status(out)["missing"] == 0
