"""A render worker as its parent sees it: started, told commands, listened to, stopped. The farm and the panel both use it; needs no Blender.

The other end of the pipes is blender/child.py; worker_events.py has the events.
"""

import importlib.util
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from .errors import InputError, WorkError, how_to_get_bpy
from .formats.files import write_json
from .worker_events import Event, Exited, from_dict

CHILD = Path(__file__).resolve().parent / "blender/child.py"
_BLENDER = ("-b", "--factory-startup", "--python-exit-code", "3", "-P", str(CHILD), "--")


def worker_command() -> list[str]:
    """How a worker is started: this Blender again, Python with the bpy package, or a Blender on the PATH. Raises WorkError."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and not getattr(bpy.app, "module", False) and bpy.app.binary_path:
        return [bpy.app.binary_path, *_BLENDER]
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable, str(CHILD)]
    blender = shutil.which("blender")
    if blender is None:
        hint = f"{how_to_get_bpy()}; or install Blender"
        raise WorkError("there is neither the bpy package nor a blender binary", hint=hint)
    return [blender, *_BLENDER]


class WorkerClient(subprocess.Popen[bytes]):
    """A worker process. Its events are returned by `events()`, or put into `inbox` as (this client, event); the last is Exited.

    terminate() and kill() end it at once, kill() also where it is stopped or hangs; the frame in work is lost.

    `options`: {"job": {...}, "cores": [...], ...} as child.py describes them, written beside `log`, which takes standard error.
    """

    def __init__(
        self,
        command: Sequence[str],
        options: Mapping[str, Any],
        out: Path,
        log: Path,
        inbox: "queue.SimpleQueue[tuple[WorkerClient, Event]] | None" = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Raises WorkError where it cannot be started."""
        self.log, self.asked_to_stop = log, False
        self._inbox = queue.SimpleQueue() if inbox is None else inbox
        self._options_file = log.with_suffix(".json")
        self._last_s = time.monotonic()
        write_json(self._options_file, dict(options))
        try:
            with open(log, "wb") as errors:
                super().__init__(
                    [*command, str(self._options_file), str(out)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env={**os.environ, **(environment or {})},
                    creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),
                    # a group of its own: Ctrl-C reaches the parent alone, and the kernel ends a stopped child whose parent is gone
                    process_group=0,
                )
        except OSError as error:
            raise WorkError(f"{command[0]}: cannot be started: {error.strerror or error}") from None
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def silent_s(self) -> float:
        """Seconds since the last event, or since the last command. A worker sends one every two seconds once it has started."""
        return time.monotonic() - self._last_s

    def send(self, command: Mapping[str, Any]) -> None:
        """Never fails: where the process has ended, its Exited event has the exit code."""
        self._last_s = time.monotonic()
        assert self.stdin is not None
        with suppress(OSError, ValueError):
            self.stdin.write(json.dumps(command).encode() + b"\n")
            self.stdin.flush()

    def events(self) -> list[Event]:
        """What has arrived since the last call, where no inbox was given."""
        found = []
        with suppress(queue.Empty):
            while True:
                found.append(self._inbox.get_nowait()[1])
        return found

    def stop(self) -> None:
        """Ask it to end after the frame in work; once."""
        if not self.asked_to_stop:
            self.asked_to_stop = True
            self.send({"stop": True})

    def close(self, keep_log: bool = True) -> None:
        """Wait for its end, and remove its options file."""
        self.wait()
        assert self.stdin is not None
        with suppress(OSError):  # what it did not live to read
            self.stdin.close()
        self._options_file.unlink(missing_ok=True)
        if not keep_log:
            self.log.unlink(missing_ok=True)

    def log_end(self, lines: int = 3) -> str:
        """The last lines of its log, in one line of at most 400 characters."""
        try:
            text = self.log.read_text("utf-8", "replace")
        except OSError:
            return ""
        kept = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("OIIO DEBUG")]
        return " | ".join(kept[-lines:])[:400]

    def _listen(self) -> None:
        assert self.stdout is not None
        for line in self.stdout:
            with suppress(ValueError, InputError):  # a line of Blender's own, before the stream was ours
                content = json.loads(line)
                event = from_dict(content) if isinstance(content, dict) else None
                if event is not None:
                    self._last_s = time.monotonic()
                    self._inbox.put((self, event))
        self.stdout.close()
        code = self.wait()
        self._inbox.put((self, Exited(code, self.log_end(1) if code else None)))
