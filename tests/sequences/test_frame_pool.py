"""Frames on all cores: processes and threads do the same, and nothing of a pool outlives its
parent.
"""

import os
import pickle
import signal
import subprocess
import sys
import time

import psutil
import pytest
from iclnuim.errors import InputError
from patience import patience

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="processes are forked on Linux only"
)

ADDON = os.pathsep.join(sys.path)
START = """
import os, sys, time
from iclnuim.sequences.frame_pool import FramePool
from iclnuim.errors import InputError
def results(work, count):
    found = []
    with FramePool(lambda n: (n, work(n)), 3, found.append) as pool:
        for n in range(count):
            pool.add(n)
    return [result for _, result in sorted(found)]
"""


def start(script: str) -> subprocess.Popen:
    """A process of its own: here Blender or other threads may be about."""
    environment = {**os.environ, "PYTHONPATH": ADDON}
    command = [sys.executable, "-W", "error", "-c", START + script]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def output(script: str) -> str:
    out, err = start(script).communicate(timeout=patience(60))
    assert err == ""
    return out


def test_the_work_is_done_in_other_processes_and_all_of_it_comes_back():
    script = "print(results(lambda n: (n * n, os.getpid() != parent), 20))"
    assert eval(output("parent = os.getpid()\n" + script)) == [(n * n, True) for n in range(20)]


@pytest.mark.parametrize(
    "hindrance", ["sys.modules['bpy'] = sys", "import threading; threading.Timer(9, int).start()"]
)
def test_beside_blender_or_other_threads_it_is_done_in_threads(hindrance):
    tail = "print(results(lambda n: os.getpid(), 5) == [os.getpid()] * 5, flush=True)\nos._exit(0)"
    assert output(f"{hindrance}\n{tail}") == "True\n"


def test_an_error_arrives_as_it_was_raised():
    script = """
def work(n):
    raise InputError("a frame", path="x.exr", line=3, found=n, hint="another")
try:
    results(work, 1)
except InputError as error:
    print(error, error.line, error.found)
"""
    assert output(script) == "x.exr:3: expected a frame, found 0; try another 3 0\n"


def test_an_error_of_the_work_or_of_what_follows_drops_what_was_not_begun_and_keeps_what_was_done():
    script = """
for fails in ("work", "finish"):
    begun, kept = [], []
    def finish(n):
        kept.append(n)
        if fails == "finish":
            raise KeyError(n)
    try:
        with FramePool(lambda n: 1 / (fails == "finish" or n > 0) and time.sleep(0.3) or n, 2, finish) as pool:
            for n in range(100):
                pool.add(n)
            for _ in range(30):
                time.sleep(0.05)
                pool.collect()
    except (RuntimeError, KeyError) as error:
        print(type(error).__name__, "ZeroDivisionError" in str(error), pool.failed, len(kept) < 10)
"""
    assert output(script) == "RuntimeError True True True\nKeyError False True True\n"


def test_an_input_error_survives_pickling():
    error = InputError("a camera", path="a/b", line=7, found="none", hint="--camera")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and vars(again) == vars(error) and type(again) is InputError


def test_a_killed_process_is_one_line():
    script = """
from iclnuim.errors import WorkError
try:
    results(lambda n: os.kill(os.getpid(), 9), 4)
except WorkError as error:
    print(error)
"""
    assert output(script).count("\n") == 1


def test_all_end_when_the_parent_is_killed():
    parent = start("print('begun', flush=True)\nresults(lambda n: time.sleep(60), 4)")
    parent.stdout.readline()
    children = _children(psutil.Process(parent.pid), 3)
    parent.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs(children, timeout=patience(60))
    parent.communicate()
    assert len(children) == 3 and not alive


def _children(process: psutil.Process, count: int) -> list[psutil.Process]:
    end = time.monotonic() + patience(20)
    while len(found := process.children()) < count and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(0.3)  # each has heard of its parent's end by now
    return found
