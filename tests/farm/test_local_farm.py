"""Workers that die, hang or fail: their frames are tried again elsewhere, given up after three
times, and the rest is done.
"""

import json
import os
import queue
import sys
import textwrap
import time

import pytest
from iclnuim.errors import IclnuimError, WorkError
from iclnuim.headless.farm.chunks import chunks_of
from iclnuim.headless.farm.farm_settings import FarmSettings
from iclnuim.headless.farm.local import LocalFarm
from iclnuim.worker_client import WorkerClient

JOB = {"job": {"scene": "office", "trajectory": "office/kt0"}}
#: A worker that speaks the protocol but renders nothing: it touches OUT/N and follows
#: OUT/orders.json, frame -> what goes wrong how often.
PRETENDER = textwrap.dedent("""
    import json, os, signal, sys, time
    from pathlib import Path
    out = Path(sys.argv[2])
    def say(**event): print(json.dumps(event), flush=True)
    say(event="start", frames=1000)
    def trouble(number):
        orders = json.loads((out / "orders.json").read_text())
        kind, times = orders.get(str(number), ("", 0))
        marks = list(out.glob(f"{number}-*"))
        if len(marks) < times:
            (out / f"{number}-{len(marks)}").touch()
            return kind
    for line in sys.stdin:
        command = json.loads(line)
        if command.get("stop"):
            break
        say(event="ready")
        for number in command["frames"]:
            kind = trouble(number)
            if kind == "die": os.kill(os.getpid(), signal.SIGKILL)
            if kind == "stop": os.kill(os.getpid(), signal.SIGSTOP)
            if kind == "crash": sys.exit("words of a crash")
            if kind == "full": say(event="error", text="no space left; free some", code=3); sys.exit(3)
            if (out / str(number)).exists(): continue
            (out / str(number)).touch()
            if kind != "mute": say(event="frame", frame=number)
            else: os.kill(os.getpid(), signal.SIGKILL)
        say(event="chunk", rendered=len(command["frames"]), seconds=0, rss_mb=9e9 if "fat" in sys.argv[2] else 1)
    say(event="done")
""")


@pytest.fixture
def farm(tmp_path):
    """`farm(frames, orders, **care)` -> outcome, frames in the order heard of, worker processes
    started.
    """
    script = tmp_path / "pretender.py"
    script.write_text(PRETENDER)

    def run(
        frames,
        orders,
        workers=2,
        name="out",
        should_stop=lambda: False,
        size=4,
        running=False,
        **care,
    ):
        out = tmp_path / name
        out.mkdir()
        (out / "orders.json").write_text(json.dumps(orders))
        started, heard = [], []

        def start(cores, events: queue.SimpleQueue) -> WorkerClient:
            log = tmp_path / f"worker-{len(started)}.log"
            started.append(
                WorkerClient(
                    [sys.executable, str(script)], {"cores": cores, **JOB}, out, log, events
                )
            )
            return started[-1]

        stop, inbox = should_stop, queue.SimpleQueue()
        farm = LocalFarm(
            start,
            [[k] for k in range(workers)],
            heard.append,
            should_stop=lambda: stop(),
            settings=FarmSettings(**care),
            first=(start([0], inbox), inbox) if running else None,
        )
        try:
            return farm.run(chunks_of(frames, size)), heard, started
        finally:
            assert all(worker.poll() is not None for worker in started)

    return run


def test_all_frames_are_done_once_and_workers_leave_no_logs(farm, tmp_path):
    outcome, heard, started = farm(list(range(30)), {})
    assert sorted(heard) == list(range(30)) and outcome.done == set(heard)
    assert len(started) == 2 and outcome.deaths == 0 and not outcome.failed
    assert list(tmp_path.glob("*.log")) == []


@pytest.mark.parametrize("kind", ["die", "crash", "mute"])
def test_a_frame_that_kills_its_worker_once_is_tried_again(farm, kind):
    outcome, heard, started = farm(list(range(12)), {"5": (kind, 1)})
    assert sorted(heard) == list(range(12))
    assert outcome.deaths == 1 and not outcome.failed


@pytest.mark.parametrize("orders", [{}, {"5": ("crash", 1)}])
def test_a_worker_that_runs_already_takes_its_share_and_is_replaced_where_it_dies(farm, orders):
    outcome, heard, started = farm(list(range(12)), orders, running=True)
    assert sorted(heard) == list(range(12)) and outcome.deaths == len(orders) == len(started) - 2


def test_a_frame_that_kills_three_workers_is_given_up_with_its_log_and_its_neighbours_are_not(farm):
    outcome, heard, _ = farm(list(range(12)), {"5": ("crash", 99)})
    assert sorted(heard) == [n for n in range(12) if n != 5]
    assert list(outcome.failed) == [5]
    assert "words of a crash" in outcome.failed[5].read_text()


def test_a_stopped_worker_is_replaced(farm):
    begun = time.monotonic()
    outcome, heard, _ = farm(list(range(12)), {"3": ("stop", 1)}, worker_timeout_s=8.0)
    assert sorted(heard) == list(range(12)) and outcome.deaths == 1
    assert time.monotonic() - begun < 60  # not the two minutes of FarmSettings


def test_a_full_disk_ends_the_run_with_the_workers_words(farm):
    with pytest.raises(IclnuimError, match="^no space left; free some$") as raised:
        farm(list(range(12)), {"3": ("full", 99)})
    assert raised.value.exit_code == 3


def test_a_worker_that_does_not_start_is_not_tried_for_ever(tmp_path):
    log = tmp_path / "log.log"

    def start(cores, events):
        return WorkerClient(
            [sys.executable, "-c", "import sys; sys.exit('no bpy here')"],
            JOB,
            tmp_path,
            log,
            events,
        )

    with pytest.raises(WorkError, match="no bpy here"):
        LocalFarm(start, [[0]], lambda number: None).run(chunks_of([1, 2, 3], 1))


@pytest.mark.parametrize("name, care", [("fat", {}), ("slim", {"max_frames": 4})])
def test_a_worker_is_replaced_after_enough_frames_or_grown_too_big(farm, name, care):
    outcome, heard, started = farm(list(range(16)), {}, workers=1, name=name, **care)
    assert sorted(heard) == list(range(16))
    assert len(started) == 4 and outcome.deaths == 0


def test_a_stop_is_obeyed(farm):
    until = time.monotonic() + 0.5
    outcome, heard, _ = farm(list(range(4000)), {}, should_stop=lambda: time.monotonic() > until)
    assert outcome.stopped and len(heard) < 4000


def test_processes_of_another_group_survive_ctrl_c_of_the_terminal(farm):
    _, _, started = farm([0], {})
    assert os.getpgid(0) not in {worker.pid for worker in started}
