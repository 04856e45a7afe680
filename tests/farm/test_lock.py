"""One command at a time on a folder: living holders are respected, dead ones buried, and of many
that try one gets it.
"""

import json
import multiprocessing
import os
import subprocess
import sys

import pytest
from iclnuim.errors import WorkError
from iclnuim.headless.farm.lock import STALE_S, OutputLock


def test_a_second_one_is_told_who_works_there(tmp_path):
    with (
        OutputLock(tmp_path / "run"),
        pytest.raises(WorkError, match=f"process {os.getpid()} on .* is already using this folder"),
    ):
        OutputLock(tmp_path / "run").__enter__()
    with OutputLock(tmp_path / "run"):
        pass
    assert list((tmp_path / "run").iterdir()) == []


def test_the_lock_of_a_killed_process_is_taken_over_at_once(tmp_path):
    program = (
        "import os, sys; from pathlib import Path; from iclnuim.headless.farm.lock import OutputLock;"
        "OutputLock(Path(sys.argv[1])).__enter__(); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert (tmp_path / "lock").exists()
    with OutputLock(tmp_path):
        pass


@pytest.mark.parametrize("age_s, free", [(0, False), (STALE_S + 10, True)])
def test_another_hosts_lock_counts_by_its_heartbeat(tmp_path, age_s, free):
    lock = tmp_path / "lock"
    lock.write_text(json.dumps({"host": "elsewhere", "pid": 1, "born": "1", "token": "x"}))
    when = lock.stat().st_mtime - age_s
    os.utime(lock, (when, when))
    if free:
        with OutputLock(tmp_path) as taken:
            assert taken.held()
    else:
        with pytest.raises(WorkError, match="elsewhere"):
            OutputLock(tmp_path).__enter__()


def _try(folder, barrier, won):
    barrier.wait()
    try:
        OutputLock(folder).__enter__()
        won.put(os.getpid())
    except WorkError:
        pass
    barrier.wait(30)


def test_of_eight_that_bury_the_same_dead_holder_one_goes_on(tmp_path):
    context = multiprocessing.get_context("fork")
    for turn in range(10):
        folder = tmp_path / str(turn)
        folder.mkdir()
        (folder / "lock").write_text(
            json.dumps({"host": os.uname().nodename, "pid": 2**22, "born": "0", "token": "x"})
        )
        barrier, won = context.Barrier(8), context.SimpleQueue()
        tries = [context.Process(target=_try, args=(folder, barrier, won)) for _ in range(8)]
        for process in tries:
            process.start()
        for process in tries:
            process.join()
        winners = []
        while not won.empty():
            winners.append(won.get())
        assert len(winners) == 1
