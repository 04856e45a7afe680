"""The parent's end of a worker process: events in, commands out, silence, its end and the last
lines of its log.
"""

import importlib.util
import sys
import textwrap
import time
from pathlib import Path

import pytest
from iclnuim import wall, worker_client
from iclnuim.errors import WorkError
from iclnuim.worker_client import WorkerClient
from iclnuim.worker_events import Exited, FrameDone, Note
from patience import patience

JOB = {"job": {"scene": "office", "trajectory": "office/kt0"}}
WORKER = textwrap.dedent("""
    import json, sys
    options = json.load(open(sys.argv[1]))
    print("Blender 4.5: a line that is no event")
    print(json.dumps({"event": "note", "text": options["greeting"]}), flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        if command.get("stop"):
            break
        if command.get("write"):
            open(command["write"], "w").close()
        if command.get("crash"):
            print("first line\\n\\nOIIO DEBUG: chatter", file=sys.stderr)
            sys.exit("the last line")
        print(json.dumps({"event": "frame", "frame": command["frames"][0]}), flush=True)
""")


@pytest.fixture
def client(tmp_path):
    (tmp_path / "worker.py").write_text(WORKER)
    command = [sys.executable, str(tmp_path / "worker.py")]
    options = {"greeting": "hello", **JOB}
    client = WorkerClient(command, options, tmp_path / "out", tmp_path / "worker.log")
    yield client
    client.kill()
    client.close()


def until(client, kind):
    found = []
    end = time.monotonic() + patience(20)
    while time.monotonic() < end and not any(isinstance(event, kind) for event in found):
        found += client.events()
        time.sleep(0.01)
    return found


def test_events_arrive_typed_and_other_lines_are_left_out(client):
    assert until(client, Note) == [Note("hello")]
    client.send({"frames": [7]})
    assert until(client, FrameDone) == [FrameDone(7)]
    assert client.poll() is None and client.silent_s < 20
    client.stop()
    assert until(client, Exited) == [Exited(0)]
    assert client.asked_to_stop and client.poll() is not None


def test_a_crash_is_told_with_the_last_line_of_the_log(client, tmp_path):
    client.send({"crash": True})
    assert until(client, Exited)[-1] == Exited(1, "the last line")
    assert client.log_end() == "first line | the last line"
    client.send({"frames": [1]})  # to a process that is gone: nothing happens
    client.close(keep_log=False)
    assert list(tmp_path.glob("worker.*")) == [tmp_path / "worker.py"]


def test_a_killed_worker_exits_below_zero(client):
    until(client, Note)
    client.kill()
    assert until(client, Exited)[-1].code < 0


def test_a_program_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(WorkError, match="cannot be started"):
        WorkerClient(["/no/such/program"], JOB, tmp_path, tmp_path / "log.log")


@pytest.mark.parametrize("own", [None, "glibc.malloc.check=0"])
def test_a_worker_uses_large_pages_unless_the_user_has_set_the_allocator(
    tmp_path, monkeypatch, own
):
    name = "GLIBC_TUNABLES"
    monkeypatch.setenv(name, own) if own else monkeypatch.delenv(name, raising=False)
    (tmp_path / "worker.py").write_text(
        f'import json, os; print(json.dumps({{"event": "note", "text": os.environ["{name}"]}}))'
    )
    client = WorkerClient(
        [sys.executable, str(tmp_path / "worker.py")],
        JOB,
        tmp_path / "out",
        tmp_path / "worker.log",
    )
    (note,) = (event for event in until(client, Exited) if isinstance(event, Note))
    client.close()
    assert note.text == own if own else "hugetlb=1" in note.text


@pytest.mark.skipif(not wall.version(), reason="this kernel has no Landlock")
def test_a_worker_writes_only_its_folders(client, tmp_path):
    for inside in (tmp_path / "out/a", client.temporary / "b"):
        client.send({"write": str(inside), "frames": [1]})
        until(client, FrameDone)
        assert inside.is_file()
    elsewhere = tmp_path.parent / f"{tmp_path.name}-elsewhere"
    client.send({"write": str(elsewhere)})
    [ended] = [event for event in until(client, Exited) if isinstance(event, Exited)]
    assert ended.code == 1 and "Permission denied" in ended.log
    assert not elsewhere.exists() and not client.temporary.exists()


def test_the_package_is_compiled_before_a_worker_stands_behind_the_wall(client):
    child = Path(worker_client.CHILD)
    for module in (child, child.with_name("render") / "worker.py"):
        assert Path(importlib.util.cache_from_source(str(module))).is_file()
