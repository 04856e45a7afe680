"""One worker of the local farm: a child process, what it was told, and when it was last heard of."""

from __future__ import annotations

import importlib.util
import json
import queue
import shutil
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import iclnuim
from iclnuim.errors import IclnuimError, WorkError
from iclnuim.formats.files import write_json

from .plan import Chunk

CHILD = Path(iclnuim.__file__).resolve().parent / "blender/child.py"


def worker_command() -> list[str]:
    """How a worker is started: this Blender again, Python with the bpy package, or a Blender on the PATH. Raises WorkError."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and not getattr(bpy.app, "module", False) and bpy.app.binary_path:
        return _by_blender(bpy.app.binary_path)
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable, str(CHILD)]
    blender = shutil.which("blender")
    if blender is None:
        raise WorkError(
            "neither the bpy package nor a blender binary is there; try: pip install bpy, or `iclnuim doctor`"
        )
    return _by_blender(blender)


def _by_blender(binary: str) -> list[str]:
    return [binary, "-b", "--factory-startup", "--python-exit-code", "3", "-P", str(CHILD), "--"]


class WorkerError(IclnuimError):
    """What a worker said was wrong, in its words and with its exit code."""

    def __init__(self, event: dict) -> None:
        super().__init__(str(event.get("text", "a worker failed without a word")))
        self.exit_code = event.get("code", 3)


class WorkerProcess:
    """A child that puts (itself, event) into `heard`; its end is the event `exit`."""

    def __init__(self, command: list[str], options: dict, out: Path, log: Path, heard: queue.SimpleQueue) -> None:
        self.log, self.chunk, self.left = log, None, []
        self.ready = self.asked_to_stop = self.gone = False
        self.rendered, self._heard = 0, heard
        self.last_heard_s = self.last_frame_s = time.monotonic()
        options_file = log.with_suffix(".json")
        write_json(options_file, options)
        try:
            with open(log, "wb") as errors:
                self.process = subprocess.Popen(
                    [*command, str(options_file), str(out)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    # a group of its own: Ctrl-C reaches the parent alone, and the kernel ends a stopped child whose parent is gone
                    process_group=0,
                )
        except OSError as error:
            raise WorkError(f"{command[0]}: cannot be started: {error.strerror or error}") from None
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def busy(self) -> bool:
        return self.chunk is not None

    def give(self, chunk: Chunk) -> None:
        """A chunk to render."""
        self.chunk, self.left = chunk, list(chunk.frames)
        self.last_heard_s = self.last_frame_s = time.monotonic()
        self.send({"frames": self.left})

    def send(self, command: dict) -> None:
        try:
            self.process.stdin.write(json.dumps(command).encode() + b"\n")
            self.process.stdin.flush()
        except (OSError, ValueError):
            pass  # it has ended: its exit says how

    def ask_to_stop(self) -> None:
        """After the frame in work."""
        if not self.asked_to_stop:
            self.asked_to_stop = True
            self.send({"stop": True})

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()

    def finish(self, clean: bool) -> None:
        """Close what is open; the log of a worker that did well is dropped."""
        self.gone = True
        self.process.wait()
        with suppress(OSError):  # what it did not live to read
            self.process.stdin.close()
        self.log.with_suffix(".json").unlink(missing_ok=True)
        if clean:
            self.log.unlink(missing_ok=True)

    def last_words(self, lines: int = 3) -> str:
        """The end of its log."""
        try:
            text = self.log.read_text("utf-8", "replace")
        except OSError:
            return ""
        return " | ".join([line.strip() for line in text.splitlines() if line.strip()][-lines:])[:400]

    def _listen(self) -> None:
        for line in self.process.stdout:
            try:
                event = json.loads(line)
            except ValueError:
                continue  # a line of Blender's own, before the stream was ours
            if isinstance(event, dict):
                self._heard.put((self, event))
        self.process.stdout.close()
        self._heard.put((self, {"event": "exit", "code": self.process.wait()}))
