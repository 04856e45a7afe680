"""Chaos: workers and commands killed, stopped, and without space; the same command again; the same bytes at the end, no frame made twice."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="needs the bpy package")
pytest.importorskip("psutil", reason="finds the workers to kill")

from iclnuim.tools.farm_chaos import Chaos, Damage, children, finished, kinds, still_there
from iclnuim.tools.plain_blender import PlainBlender

SMALL = ("--light", "path", "--samples", "1", "--no-denoise", "--camera", "80x60")


def make(out: Path, *options: str) -> Chaos:
    return Chaos("kt2", (*SMALL, *options), out, np.random.default_rng(7))


def wait_for(out: Path, count: int, parent: subprocess.Popen, seconds: float = 120) -> None:
    until = time.monotonic() + seconds
    while len(finished(out)) < count:
        assert parent.poll() is None and time.monotonic() < until, f"{len(finished(out))} of {count} frames"
        time.sleep(0.02)


def disturbed(tmp_path: Path, happens: list[str], *options: str) -> Damage:
    chaos, left_alone = make(tmp_path / "disturbed", *options), make(tmp_path / "undisturbed", *options)
    chaos.run(happens, lambda text: None)
    left_alone.complete()
    assert not list((chaos.out / "raw/exr").iterdir())
    return chaos.damage(left_alone.out)


def test_each_kind_of_kill_once_and_the_data_set_is_the_same(tmp_path):
    damage = disturbed(tmp_path, ["worker", "both"], "--frames", "0:120")
    assert damage == Damage(120, 2, 0, 0, 0, 0, {"worker": 1, "both": 1}, ())


@pytest.mark.slow
def test_thirty_kills_a_full_disk_and_a_stopped_worker_and_the_data_set_is_the_same(tmp_path):
    damage = disturbed(tmp_path, kinds(30))
    assert damage.events == {"worker": 10, "parent": 10, "both": 10, "full": 1, "stop": 1}
    assert (damage.frames, damage.kills) == (882, 30)
    assert damage.none, damage


def test_of_two_commands_on_one_folder_one_works_and_the_other_says_so(tmp_path):
    out = tmp_path / "out"
    first = make(out, "--frames", "0:60").start()
    wait_for(out, 1, first)
    second = make(out, "--frames", "0:60").start()
    words = second.communicate()[1]
    assert second.returncode == 3 and f"process {first.pid} on {os.uname().nodename} works there already" in words
    first.communicate()
    assert first.returncode == 0
    assert sorted(number for number, _ in finished(out)) == list(range(60))


@pytest.mark.parametrize("under_nohup", [False, True])
def test_no_worker_outlives_a_killed_command_not_even_a_stopped_one(tmp_path, under_nohup):
    out = tmp_path / "out"
    ignore = (lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)) if under_nohup else None
    parent = make(out).start(preexec_fn=ignore)
    wait_for(out, 2, parent)
    workers = children(parent)
    workers[0].send_signal(signal.SIGSTOP)
    parent.kill()
    parent.communicate()
    left = still_there(workers, 20)
    for worker in left:
        worker.kill()
    assert workers and not left


def test_of_a_folder_with_everything_wrong_all_damage_is_counted(tmp_path):
    one = ["--frames", "0:4"]
    chaos, whole = make(tmp_path / "a", *one), make(tmp_path / "b", *one)
    chaos.complete()
    whole.complete()
    (chaos.out / "noisy/depth/000001.png").unlink()
    (chaos.out / "clean/rgb/000002.png").write_bytes(b"half of it")
    with open(chaos.out / "raw/.farm/finished.jsonl", "a") as journal:
        journal.write('{"frame": 3, "pid": 1}\n')
    damage = chaos.damage(whole.out)
    assert (damage.frames, damage.lost, damage.broken, damage.twice) == (4, 1, 1, 1)
    assert damage.names == ("clean/rgb/000002.png", "noisy/depth/000001.png")


def test_what_a_command_killed_while_writing_has_left_is_gone_after_the_next(tmp_path):
    chaos = make(tmp_path / "out", "--frames", "0:2")
    chaos.complete()
    whole = sorted(chaos.out.rglob("*"))
    program = (
        "import os, sys; from pathlib import Path; from iclnuim.formats.files import atomic_write;"
        "atomic_write(Path(sys.argv[1]), lambda file: (file.write_bytes(b'half'), os.kill(os.getpid(), 9)))"
    )
    for name in ("clean/rgb/000001.png", "noisy/depth/000000.png", "noisy/recipe.json", "raw/exr/000001.exr"):
        subprocess.run([sys.executable, "-c", program, str(chaos.out / name)], check=False)
    assert len(list(chaos.out.rglob(".*.tmp.*"))) == 4
    chaos.complete()
    assert sorted(chaos.out.rglob("*")) == whole


def test_plain_blenders_placeholders_and_halves_are_counted(tmp_path):
    plain = PlainBlender(tmp_path / "no.blend", tmp_path, 0, 3, np.random.default_rng(0))
    command = [sys.executable, "-m", "iclnuim", "render", "kt2", *SMALL, "--frames", "0:1", "--out"]
    subprocess.run([*command, str(tmp_path / "run")], check=True, capture_output=True)
    whole = (tmp_path / "run/exr/000000.exr").read_bytes()
    (tmp_path / "000000.exr").write_bytes(whole)
    (tmp_path / "000001.exr").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "000002.exr").touch()
    assert plain.damage(1) == Damage(4, 1, broken=1, lost=2)
