"""The client of a render worker: it starts the process behind the wall of its scene, sends it
commands, and receives its events. The farm and the panel use it. It needs no Blender.
"""

import compileall
import functools
import importlib.util
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from . import scene_wall, shipped, wall
from .errors import InputError, WorkError, how_to_get_bpy
from .formats.files import make_folder, write_json
from .geometry.scene_axes import SceneReading
from .worker_events import Event, Exited, from_dict

_PACKAGE = Path(__file__).resolve().parent
CHILD = _PACKAGE / "blender/child.py"
_BLENDER = ("-b", "--factory-startup", "--python-exit-code", "3", "-P", str(CHILD), "--")


def worker_command() -> list[str]:
    """The command that starts a worker: this Blender again, Python with the bpy package, or a
    Blender on the PATH. Raises WorkError.
    """
    bpy = sys.modules.get("bpy")
    if bpy is not None and not getattr(bpy.app, "module", False) and bpy.app.binary_path:
        return [bpy.app.binary_path, *_BLENDER]
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable, str(CHILD)]
    blender = shutil.which("blender")
    if blender is None:
        hint = f"{how_to_get_bpy()}; or install Blender"
        raise WorkError("neither the bpy package nor a blender executable was found", hint=hint)
    return [blender, *_BLENDER]


#: Settings of glibc's allocator for workers: large pages, as every ray reads from a few hundred
#: megabytes; one arena, as the arenas of threads, which load textures, get none; and buffers of a
#: frame stay allocated for the next. Frames do not change (docs/measured/light.md). Ignored where
#: there is no glibc; the user's own value has precedence.
_ALLOCATOR = {
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1:glibc.malloc.arena_max=1"
    ":glibc.malloc.mmap_threshold=33554432:glibc.malloc.trim_threshold=4294967296"
}


def _further_folders(environment: Mapping[str, str]) -> list[Path]:
    """The cache folder, and the folder for raw frames if there is one."""
    cache = environment.get("ICLNUIM_CACHE") or shipped.cache_folder()
    scratch = environment.get("ICLNUIM_SCRATCH")
    return [Path(place).expanduser() for place in (cache, scratch) if place]


@functools.cache
def _compile_package() -> None:
    """Write the bytecode of this package, which no process behind the wall can write: each worker
    would compile it again.
    """
    with suppress(OSError):
        compileall.compile_dir(_PACKAGE, quiet=2)


def _launcher(options_file: Path) -> list[str]:
    """The command in front of a worker's, which puts up the wall of the options; none where the
    kernel has no wall.
    """
    if not wall.version():
        return []
    _compile_package()
    return [sys.executable, "-I", "-S", wall.__file__, str(options_file)]


class WorkerClient(subprocess.Popen[bytes]):
    """A worker process. Its events are returned by `events()`, or put into `inbox` as (this client,
    event). The last event is Exited.

    `temporary`: its folder for temporary files, removed when it has ended.

    terminate() and kill() end it immediately, kill() also if it is stopped or hangs; the unfinished
    frame is lost.

    `options`: {"job": {...}, "cores": [...], ...} as described in child.py. They are written to a
    file next to `log`, which receives standard error. The process is behind the wall of its scene
    (scene_wall.py): it writes only the run folder `out`, `writable`, and a temporary folder.
    """

    def __init__(
        self,
        command: Sequence[str],
        options: Mapping[str, Any],
        out: Path,
        log: Path,
        inbox: "queue.SimpleQueue[tuple[WorkerClient, Event]] | None" = None,
        environment: Mapping[str, str] | None = None,
        writable: Sequence[Path] = (),
    ) -> None:
        """Raises WorkError if the process cannot be started."""
        if shutil.which(command[0]) is None:
            raise WorkError(f"{command[0]}: cannot be started: no such program")
        self.log = log
        self.asked_to_stop = False
        self._inbox = queue.SimpleQueue() if inbox is None else inbox
        self._options_file = log.with_suffix(".json")
        self._last_s = time.monotonic()
        self.temporary = Path(tempfile.mkdtemp(prefix="iclnuim-"))
        # the user's extensions are behind the wall: an empty folder has none to look for
        temporary = dict.fromkeys(("TMPDIR", "BLENDER_USER_EXTENSIONS"), str(self.temporary))
        own = {**temporary, shipped.COMMIT: shipped.source_commit() or ""}
        given = {**_ALLOCATOR, **os.environ, **own, **(environment or {})}
        places = [out, log.parent, self.temporary, *writable, *_further_folders(given)]
        self._write_options(options, command[0], places)
        try:
            with open(log, "wb") as errors:
                super().__init__(
                    [*_launcher(self._options_file), *command, str(self._options_file), str(out)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env=given,
                    creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),
                    # a separate process group: only the parent receives Ctrl-C, and the kernel ends
                    # a stopped child whose parent has exited
                    process_group=0,
                )
        except OSError as error:
            shutil.rmtree(self.temporary, ignore_errors=True)
            raise WorkError(f"{command[0]}: cannot be started: {error.strerror or error}") from None
        threading.Thread(target=self._listen, daemon=True).start()

    def _write_options(
        self, options: Mapping[str, Any], program: str, writable: list[Path]
    ) -> None:
        """Write the options with the wall of the job's scene, and make the folders."""
        for place in writable:
            make_folder(place, "another {out}")
        job = options["job"]
        reading = SceneReading.from_dict(job.get("reading") or {})
        trajectory = [Path(job["trajectory"])]
        behind = scene_wall.around(job["scene"], reading, program, trajectory, writable)
        write_json(self._options_file, {**options, "wall": behind.to_dict()})

    @property
    def silent_s(self) -> float:
        """Seconds since the last event or command.

        A started worker sends an event every two seconds.
        """
        return time.monotonic() - self._last_s

    def send(self, command: Mapping[str, Any]) -> None:
        """Send a command.

        Never fails: if the process has ended, its Exited event has the exit code.
        """
        self._last_s = time.monotonic()
        assert self.stdin is not None
        with suppress(OSError, ValueError):
            self.stdin.write(json.dumps(command).encode() + b"\n")
            self.stdin.flush()

    def events(self) -> list[Event]:
        """The events received since the last call, if no inbox was given."""
        found = []
        with suppress(queue.Empty):
            while True:
                found.append(self._inbox.get_nowait()[1])
        return found

    def stop(self) -> None:
        """Request that it ends after the current frame. The request is sent once."""
        if not self.asked_to_stop:
            self.asked_to_stop = True
            self.send({"stop": True})

    def close(self, keep_log: bool = True) -> None:
        """Wait until the process ends, and remove its options file."""
        self.wait()
        assert self.stdin is not None
        with suppress(OSError):  # the process may have ended before it read everything
            self.stdin.close()
        self._options_file.unlink(missing_ok=True)
        shutil.rmtree(self.temporary, ignore_errors=True)
        if not keep_log:
            self.log.unlink(missing_ok=True)

    def log_end(self, lines: int = 3) -> str:
        """The last lines of its log, joined to one line of at most 400 characters."""
        try:
            text = self.log.read_text("utf-8", "replace")
        except OSError:
            return ""
        kept = [line for line in text.splitlines() if not line.startswith("OIIO DEBUG")]
        kept = list(filter(None, map(str.strip, kept)))
        return " | ".join(kept[-lines:])[:400]

    def _listen(self) -> None:
        assert self.stdout is not None
        for line in self.stdout:
            # other lines are what Blender printed before its output was redirected
            with suppress(ValueError, InputError):
                content = json.loads(line)
                event = from_dict(content) if isinstance(content, dict) else None
                if event is not None:
                    self._last_s = time.monotonic()
                    self._inbox.put((self, event))
        self.stdout.close()
        code = self.wait()
        shutil.rmtree(self.temporary, ignore_errors=True)
        self._inbox.put((self, Exited(code, self.log_end(1) if code else None)))
