"""Chaos: workers and commands killed, stopped, and without space; the same command again; the same
bytes at the end, no frame made twice.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="needs the bpy package")
pytest.importorskip("psutil", reason="finds the workers to kill")

from iclnuim.formats.exr import write_exr  # noqa: E402
from iclnuim.tools.farm_chaos import Chaos, Damage, children, finished, kinds, still_there
from iclnuim.tools.plain_blender import PlainBlender

ROOM = str(Path(__file__).resolve().parents[1] / "room.obj")
SMALL = ("--scene", ROOM, "--light", "path", "--samples", "1", "--no-denoise", "--camera", "80x60")
#: Enough for two disturbances: three frames before each, and what two workers do in the third of a
#: second until it happens.
SOME = ("--frames", "0:60")


def make(out: Path, *options: str) -> Chaos:
    return Chaos("kt2", (*SMALL, *options), out, np.random.default_rng(7))


def wait_for(out: Path, count: int, parent: subprocess.Popen, seconds: float = 400) -> None:
    until = time.monotonic() + seconds
    while len(finished(out)) < count:
        assert parent.poll() is None and time.monotonic() < until, (
            f"{len(finished(out))} of {count} frames"
        )
        time.sleep(0.02)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """(folder of SOME frames; process, exit code and words of each command): a second one was
    started while the first worked.
    """
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    first = make(out, *SOME).start()
    wait_for(out, 1, first)
    second = make(out, *SOME).start()
    ended = [
        (process.pid, process.communicate()[1], process.returncode) for process in (second, first)
    ]
    return out, ended[1], ended[0]


def disturbed(out: Path, happens: list[str], *options: str) -> Chaos:
    chaos = make(out, *options)
    chaos.run(happens, lambda text: None)
    assert not list((chaos.out / "raw/exr").iterdir())
    return chaos


def test_each_kind_of_kill_once_and_the_data_set_is_the_same(undisturbed, tmp_path):
    damage = disturbed(tmp_path / "disturbed", ["worker", "both"], *SOME).damage(undisturbed[0])
    assert damage == Damage(60, 2, 0, 0, 0, 0, {"worker": 1, "both": 1}, ())


@pytest.mark.slow
def test_thirty_kills_a_full_disk_and_a_stopped_worker_and_the_data_set_is_the_same(tmp_path):
    undisturbed = make(tmp_path / "undisturbed")
    undisturbed.complete()
    damage = disturbed(tmp_path / "disturbed", kinds(30)).damage(undisturbed.out)
    assert damage.events == {"worker": 10, "parent": 10, "both": 10, "full": 1, "stop": 1}
    assert (damage.frames, damage.kills) == (882, 30)
    assert damage.none, damage


def test_of_two_commands_on_one_folder_one_works_and_the_other_says_so(undisturbed):
    out, (pid, said, code), (_, words, refused) = undisturbed
    assert (
        refused == 3
        and f"process {pid} on {os.uname().nodename} is already using this folder" in words
    )
    assert code == 0, said
    assert sorted(number for number, _ in finished(out)) == list(range(60))


@pytest.mark.parametrize("under_nohup", [False, True])
def test_no_worker_outlives_a_killed_command_not_even_a_stopped_one(tmp_path, under_nohup):
    out = tmp_path / "out"
    ignore = (lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)) if under_nohup else None
    parent = make(out, *(("--workers", "1") if under_nohup else ())).start(preexec_fn=ignore)
    wait_for(out, 2, parent)
    workers = children(parent)
    workers[0].send_signal(signal.SIGSTOP)
    parent.kill()
    parent.communicate()
    left = still_there(workers, 20)
    for worker in left:
        worker.kill()
    assert workers and not left


def test_of_a_folder_with_everything_wrong_all_damage_is_counted(undisturbed, tmp_path):
    chaos = make(shutil.copytree(undisturbed[0], tmp_path / "a"), *SOME)
    (chaos.out / "noisy/depth/000001.png").unlink()
    (chaos.out / "clean/rgb/000002.png").write_bytes(b"half of it")
    with open(chaos.out / "raw/.farm/finished.jsonl", "a") as journal:
        journal.write('{"frame": 3, "pid": 1}\n')
    damage = chaos.damage(undisturbed[0])
    assert (damage.frames, damage.lost, damage.broken, damage.twice) == (60, 1, 1, 1)
    assert damage.names == ("clean/rgb/000002.png", "noisy/depth/000001.png")


def test_what_a_command_killed_while_writing_has_left_is_gone_after_the_next(undisturbed, tmp_path):
    chaos = make(shutil.copytree(undisturbed[0], tmp_path / "out"), *SOME)
    whole = sorted(chaos.out.rglob("*"))
    program = (
        "import os, sys; from pathlib import Path; from iclnuim.formats.files import atomic_write;"
        "atomic_write(Path(sys.argv[1]), lambda file: (file.write_bytes(b'half'), os.kill(os.getpid(), 9)))"
    )
    for name in (
        "clean/rgb/000001.png",
        "noisy/depth/000000.png",
        "noisy/recipe.json",
        "raw/exr/000001.exr",
    ):
        subprocess.run([sys.executable, "-c", program, str(chaos.out / name)], check=False)
    assert len(list(chaos.out.rglob(".*.tmp.*"))) == 4
    chaos.complete()
    assert sorted(chaos.out.rglob("*")) == whole


def test_plain_blenders_placeholders_and_halves_are_counted(tmp_path):
    plain = PlainBlender(tmp_path / "no.blend", tmp_path, 0, 3, np.random.default_rng(0))
    write_exr(tmp_path / "000000.exr", {"Z": np.ones((60, 80), np.float32)})
    whole = (tmp_path / "000000.exr").read_bytes()
    (tmp_path / "000001.exr").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "000002.exr").touch()
    assert plain.damage(1) == Damage(4, 1, broken=1, lost=2)
