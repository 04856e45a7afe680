"""Chaos: workers and commands killed, stopped, and without space; the same command again; the same bytes at the end, no frame made twice."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="needs the bpy package")
psutil = pytest.importorskip("psutil", reason="finds the workers to kill")

SMALL = ("--light", "path", "--samples", "1", "--no-denoise", "--camera", "80x60", "--stuck-after", "8")


def command(out: Path, *options: str) -> list[str]:
    return [sys.executable, "-m", "iclnuim_bench", "make", "kt2", *SMALL, *options, "--out", str(out)]


def run(out: Path, *options: str) -> subprocess.CompletedProcess:
    return subprocess.run(command(out, *options), capture_output=True, text=True, timeout=560)


def finished(out: Path) -> list[int]:
    """Frames in the order in which workers finished them."""
    journal = out / "raw/.farm/finished.jsonl"
    lines = journal.read_text().split("\n")[:-1] if journal.exists() else []
    return [json.loads(line)["frame"] for line in lines]


def workers_of(parent: psutil.Process) -> list[psutil.Process]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return parent.children()
    return []


def wait_for(out: Path, count: int, parent: subprocess.Popen, seconds: float = 120) -> bool:
    """Until that many frames are finished; False when the command ended before."""
    until = time.monotonic() + seconds
    while parent.poll() is None:
        if len(finished(out)) >= count:
            return True
        assert time.monotonic() < until, f"{len(finished(out))} of {count} frames after {seconds} s"
        time.sleep(0.02)
    return False


def disturb(out: Path, kind: str, rng: np.random.Generator, options: tuple[str, ...]) -> bool:
    """Start the command, and after three more frames let something happen; False when it came to its end undisturbed."""
    before = len(finished(out))
    limit = (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))) if kind == "full" else None
    parent = subprocess.Popen(
        command(out, *options), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=limit
    )
    if kind == "full":  # no file may grow beyond 20 kB: frames are about 25 kB
        words = parent.communicate(timeout=120)[1]
        assert parent.returncode == 3 and "cannot write" in words, words
        assert len(finished(out)) == before
        return True
    if not wait_for(out, before + 3, parent):
        assert parent.wait() == 0
        return False
    workers = workers_of(psutil.Process(parent.pid))
    victim = workers[int(rng.integers(len(workers)))] if workers else None
    with contextlib.suppress(psutil.NoSuchProcess):
        if kind == "stop" and victim:
            victim.send_signal(signal.SIGSTOP)
        if kind in ("worker", "both") and victim:
            victim.kill()
    if kind in ("parent", "both"):
        parent.kill()
    else:
        assert wait_for(out, before + 6, parent) or parent.wait() == 0
        if kind == "stop":
            assert not until_gone([victim], 20), "a stopped worker was not replaced"
        parent.send_signal(signal.SIGINT)
    parent.wait(60)
    parent.stderr.close()
    assert not until_gone(workers, 30), "workers outlived their parent"
    return True


def until_gone(processes: list, seconds: float) -> list:
    return psutil.wait_procs([p for p in processes if p], timeout=seconds)[1]


def contents(out: Path) -> dict[str, bytes]:
    """Every file of both sequences. The commit of a checkout that others work in may change meanwhile; it decides no pixel."""
    found = {
        str(p.relative_to(out)): p.read_bytes() for s in ("clean", "noisy") for p in (out / s).rglob("*") if p.is_file()
    }
    for name in ("clean/recipe.json", "noisy/recipe.json"):
        recipe = json.loads(found[name])
        recipe.pop("source_commit")
        recipe["source"]["run"].pop("source_commit")
        found[name] = json.dumps(recipe).encode()
    return found


def chaos(tmp_path: Path, frames: str, kinds: list[str]) -> None:
    out, undisturbed, rng = tmp_path / "disturbed", tmp_path / "undisturbed", np.random.default_rng(7)
    happened = sum(disturb(out, kind, rng, ("--frames", frames)) for kind in kinds)
    assert happened == len(kinds), f"all frames were done after {happened} of {len(kinds)} disturbances"
    last = run(out, "--frames", frames)
    assert last.returncode == 0, last.stderr
    reference = run(undisturbed, "--frames", frames)
    assert reference.returncode == 0, reference.stderr
    ours, theirs = contents(out), contents(undisturbed)
    assert sorted(ours) == sorted(theirs)
    assert [name for name in ours if ours[name] != theirs[name]] == []
    twice = [number for number, times in Counter(finished(out)).items() if times > 1]
    assert twice == []
    assert not list((out / "raw/exr").iterdir())


def test_each_kind_of_disturbance_once_and_the_data_set_is_the_same(tmp_path):
    chaos(tmp_path, "0:120", ["worker", "both"])


@pytest.mark.slow
def test_thirty_kills_a_full_disk_and_a_stopped_worker_and_the_data_set_is_the_same(tmp_path):
    kinds = ["worker", "parent", "both"] * 10
    kinds.insert(8, "full")
    kinds.insert(17, "stop")
    chaos(tmp_path, "::", kinds)


def test_of_two_commands_on_one_folder_one_works_and_the_other_says_so(tmp_path):
    out = tmp_path / "out"
    first = subprocess.Popen(command(out, "--frames", "0:60"), stderr=subprocess.DEVNULL)
    assert wait_for(out, 1, first)
    second = run(out, "--frames", "0:60")
    assert (
        second.returncode == 3 and f"process {first.pid} on {os.uname().nodename} works there already" in second.stderr
    )
    assert first.wait() == 0
    assert sorted(finished(out)) == list(range(60))


def test_no_worker_outlives_a_killed_command_not_even_a_stopped_one(tmp_path):
    out = tmp_path / "out"
    parent = subprocess.Popen(command(out), stderr=subprocess.DEVNULL)
    assert wait_for(out, 2, parent)
    workers = workers_of(psutil.Process(parent.pid))
    workers[0].send_signal(signal.SIGSTOP)
    parent.kill()
    parent.wait()
    assert len(workers) >= 2 and not until_gone(workers, 20)
