"""The worker process of farm and panel. It reads JSON commands and writes JSON events, one per
line, and builds its scene once.

    python .../child.py JOB.json OUT
    blender -b --factory-startup --python-exit-code 3 -P .../child.py -- JOB.json OUT

JOB.json is a job (job.py), alone or as {"job": {...}, "cores": [0, 1], "threads": 2, "nice": 10,
"journal": FILE, "asked": [..], "last": 9}. Commands: {"frames": [..]}, optionally with "sequences":
{..} to be made from them (sequences.writer.writer_of), {"bake": true}, {"blend": FILE} for a copy
of the prepared scene, {"stop": true}. At the end of input, or when the parent has ended, the
current frame is finished and the process ends. Events are those of worker_events.py. Exit codes: 0
done, 2 and 3 as on the command line, 130 stopped.
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from iclnuim.blender.render import worker
    from iclnuim.worker_events import Event
#: Time for a process whose parent has ended to finish its frame.
GRACE_S = 60.0
#: Interval of the heartbeat, which distinguishes a stopped process from one that renders a long
#: frame.
ALIVE_S = 2.0


class EventStream:
    """Writes one JSON object per line to the original standard output. All other output is
    redirected to standard error.

    With a `journal`, finished frames are first appended to that file, one line each; lines are
    complete even if several processes write.
    """

    def __init__(self) -> None:
        self._stream = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
        os.dup2(2, 1)
        self._lock = threading.Lock()
        self.journal: int | None = None

    def __call__(self, event: Event) -> None:
        content = event.to_dict()
        if self.journal is not None and content["event"] == "frame" and not content.get("found"):
            line = {"frame": content["frame"], "pid": os.getpid(), "time_s": round(time.time(), 3)}
            with suppress(OSError):  # a full disk is reported by the next frame
                os.write(self.journal, json.dumps(line).encode() + b"\n")
        with self._lock, suppress(OSError):  # the parent has ended: _watch_parent ends this process
            self._stream.write(json.dumps(content) + "\n")


class Commands:
    """Reads standard input in a thread.

    `stopped` is set by {"stop": true}, by the end of input, and when the parent has ended.
    """

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self._queue: queue.SimpleQueue[dict | None] = queue.SimpleQueue()
        self.next = self._queue.get  # waits for a command; None after the last one
        threading.Thread(target=self._read, daemon=True).start()
        threading.Thread(target=self._watch_parent, args=(os.getppid(),), daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            command = json.loads(line)
            if command.get("stop"):
                self.stopped.set()
                self._queue.put(None)
            else:
                self._queue.put(command)
        self._orphaned()

    def _watch_parent(self, parent: int) -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        self._orphaned()

    def _orphaned(self) -> None:
        self.stopped.set()
        self._queue.put(None)
        threading.Timer(GRACE_S, os._exit, (130,)).start()


def main(arguments: list[str]) -> int:
    """Execute commands until there are no more. Returns the exit code."""
    emit = EventStream()
    commands = Commands()
    _load_package()
    from iclnuim.errors import IclnuimError
    from iclnuim.worker_events import Failed

    try:
        job_file, out = arguments
        content = json.loads(Path(job_file).read_text("utf-8"))
    except (ValueError, OSError) as error:
        emit(Failed(f"expected JOB.json OUT, found {arguments}: {error}", 2))
        return 2
    options = content if isinstance(content.get("job"), dict) else {"job": content}
    _share_the_machine(options)
    try:
        return _serve(options, Path(out), emit, commands)
    except IclnuimError as error:
        emit(Failed(str(error), error.exit_code, template=error.template))
        return error.exit_code
    except BaseException as error:
        traceback.print_exc()
        text = f"{type(error).__name__}: {error}; this should not happen, please report it"
        emit(Failed(text, 3, bug=True))
        return 3


def _serve(options: dict, out: Path, emit: EventStream, commands: Commands) -> int:
    from iclnuim import worker_events as events

    writes_no_bytecode = sys.dont_write_bytecode
    # this import disables bytecode: our modules would be compiled at each start
    import bpy  # noqa: F401

    sys.dont_write_bytecode = writes_no_bytecode
    from iclnuim.blender import compat
    from iclnuim.blender.render import worker
    from iclnuim.job import RenderJob

    def heartbeat() -> None:
        while True:
            time.sleep(ALIVE_S)
            emit(events.Alive())

    job = RenderJob.from_dict(options["job"])
    if job.denoise and not compat.has_denoiser():
        emit(events.Note("this Blender has no OpenImageDenoise: frames are not denoised"))
        job = job.changed(denoise=False)
    if options.get("journal"):
        emit.journal = os.open(options["journal"], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    threads = options.get("threads")
    frames = options.get("asked", ()), options.get("last")
    with worker.Session(job, out, emit, threads, *frames) as session:
        emit(events.Started(frames=len(session.trajectory), pid=os.getpid()))
        threading.Thread(target=heartbeat, daemon=True).start()
        while (command := commands.next()) is not None:
            begun = time.perf_counter()
            rendered, whole = _execute(session, command, emit, commands.stopped.is_set)
            seconds = round(time.perf_counter() - begun, 4)
            if not whole:
                emit(events.Stopped(rendered, seconds, _rss_mb()))
                return 130
            emit(events.ChunkDone(rendered, seconds, _rss_mb()))
    emit(events.Done())
    return 0


def _execute(
    session: worker.Session, command: dict, emit: EventStream, should_stop: Callable[[], bool]
) -> tuple[int, bool]:
    """Execute a command. Returns the number of frames rendered, and whether nothing is missing."""
    from iclnuim.worker_events import Baked

    if command.get("bake"):
        folder, made = session.bake()
        emit(Baked(str(folder), made))
    elif command.get("blend"):
        session.save_blend(Path(command["blend"]))
    else:
        return _render(session, command, emit, should_stop)
    return 0, True


def _render(
    session: worker.Session, command: dict, emit: EventStream, should_stop: Callable[[], bool]
) -> tuple[int, bool]:
    """Render frames, then write sequences from them.

    Errors in the settings of the sequences are raised before the first frame.
    """
    from iclnuim.sequences.writer import writer_of
    from iclnuim.worker_events import Missing, Written

    wanted = command.get("sequences")
    numbers = command["frames"]
    writer = writer_of(session.run, numbers, wanted) if wanted else None
    rendered, whole = session.render(numbers, should_stop)
    if writer is not None and whole:
        emit(Missing("sequences", len(writer.missing)))
        whole = bool(writer.write(None, lambda n: emit(Written(n)), should_stop))
    return rendered, whole


def _share_the_machine(options: dict) -> None:
    """Set the process's cores and priority before Blender counts the cores, and request a signal
    when the parent ends.
    """
    if options.get("cores") and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, set(options["cores"]))
    if options.get("nice") and hasattr(os, "nice"):
        os.nice(options["nice"])
    if sys.platform == "linux":
        # a stopped process continues when its parent is killed, so that it can end
        # (PR_SET_PDEATHSIG)
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, int(signal.SIGCONT), 0, 0, 0)


def _rss_mb() -> float:
    """Resident memory of this process; 0 if the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0


def _load_package() -> None:
    """Import this package as `iclnuim`, whatever the path and name of its folder."""
    if "iclnuim" in sys.modules:
        return
    package = Path(__file__).resolve().parents[1]
    places = [str(package)]
    spec = importlib.util.spec_from_file_location(
        "iclnuim", package / "__init__.py", submodule_search_locations=places
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"{package} is no package")
    sys.modules["iclnuim"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["iclnuim"])


if __name__ == "__main__":
    own = Path(__file__).resolve().parent
    sys.path[:] = [place for place in sys.path if Path(place or ".").resolve() != own]
    code = main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
