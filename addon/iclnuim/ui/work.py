"""A piece of work in a worker process, as a state machine without Blender: start, poll, cancel; events in, words out."""

from __future__ import annotations

import json
import os
import queue
import re
import subprocess
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, cast

from ..errors import WorkError

#: A child that was asked to stop gets this long to finish its frame; then it is ended, and the frame is rendered again on resume.
GRACE_S = 4.0
STOP = {"stop": True}
BUSY = ("starting", "preparing", "rendering", "writing", "stopping")


@dataclass
class Work:
    """phase: idle, one of BUSY, done, stopped or failed. Everything else is what the panel shows.

    done and total count frames of the stage at hand; last_frame is a frame's number; seconds are wall time.
    """

    phase: str = "idle"
    kind: str = ""
    done: int = 0
    total: int = 0
    last_frame: int | None = None
    message: str = ""
    notes: list[str] = field(default_factory=list)
    _when_done: str = ""
    _child: ChildProcess | None = None
    _stage_begun_s: float = 0.0
    _stopping_since_s: float | None = None

    @property
    def busy(self) -> bool:
        return self.phase in BUSY

    def refuse_a_second(self) -> None:
        """Raises WorkError where work is going on already."""
        if self.busy:
            raise WorkError(f"a {self.kind} is running here already; wait for it, or press Cancel first")

    def start(self, kind: str, command: dict, child: ChildProcess, when_done: str = "done") -> None:
        """Begin `command` (see blender/child.py), a `kind` of work in the panel's words. Raises WorkError where work is going on already."""
        self.refuse_a_second()
        for name, value in vars(Work()).items():
            setattr(self, name, value)
        self.phase, self.kind, self.message = "starting", kind, "Blender starts in the background"
        self._child, self._when_done = child, when_done
        child.send(command)

    def poll(self, now_s: float | None = None) -> bool:
        """Take in what the child has said; True when anything changed. Never waits."""
        now_s = time.monotonic() if now_s is None else now_s
        if self._child is None:
            return False
        events = self._child.events()
        for event in events:
            self.handle(event, now_s)
        if self._stopping_since_s is not None and now_s - self._stopping_since_s > GRACE_S:
            self._child.end()
        return bool(events)

    def cancel(self, now_s: float | None = None) -> None:
        """Ask for a stop; frames that are finished stay."""
        if self.busy and self._child is not None:
            at_once = self.phase in ("starting", "preparing")
            self.phase, self.message = "stopping", "stopping; finished frames stay"
            self._stopping_since_s = (time.monotonic() if now_s is None else now_s) - (GRACE_S if at_once else 0.0)
            self._child.send(STOP)

    def end(self) -> None:
        """End the child at once."""
        if self._child is not None:
            self._child.end()
            if self.busy:
                self.phase = "stopped"
            self._child = None

    def handle(self, event: dict, now_s: float) -> None:
        """One event of the child (headless/README.md lists them), or its end."""
        {
            "note": self._note,
            "start": lambda event, now: self._become("preparing", "the scene is opened and lit"),
            "missing": self._missing,
            "ready": self._ready,
            "frame": self._frame,
            "written": self._frame,
            "chunk": self._all_done,
            "error": self._error,
            "exit": self._exit,
        }.get(str(event.get("event")), lambda event, now: None)(event, now_s)

    def frames_per_second(self, now_s: float | None = None) -> float:
        """Of the stage at hand; 0 before its first frame."""
        elapsed = (time.monotonic() if now_s is None else now_s) - self._stage_begun_s
        return self.done / elapsed if self.done and elapsed > 0 else 0.0

    def seconds_left(self, now_s: float | None = None) -> float | None:
        rate = self.frames_per_second(now_s)
        return (self.total - self.done) / rate if rate else None

    def _note(self, event: dict, now_s: float) -> None:
        text = in_panel_words(event["text"])
        self.notes.append(text)
        self._become(self.phase, text)

    def _missing(self, event: dict, now_s: float) -> None:
        self.done, self.total, self._stage_begun_s = 0, event["missing"], now_s
        if event["of"] == "sequences":
            self._become("writing", "sequences are written")

    def _ready(self, event: dict, now_s: float) -> None:
        self._stage_begun_s = now_s
        self._become("rendering", "rendering")

    def _become(self, phase: str, message: str) -> None:
        if self.phase != "stopping":
            self.phase, self.message = phase, message

    def _all_done(self, event: dict, now_s: float) -> None:
        if self._child is not None:
            self._child.send(STOP)

    def _frame(self, event: dict, now_s: float) -> None:
        self.done += 1
        self.last_frame = event["frame"]

    def _error(self, event: dict, now_s: float) -> None:
        text = in_panel_words(event["text"])
        if self.kind == "render" and "cannot write" in text:
            text += "; finished frames stay: see that there is space, then Resume"
        self.phase, self.message = "failed", text

    def _exit(self, event: dict, now_s: float) -> None:
        self._child, self._stopping_since_s = None, None
        if self.phase == "failed":
            return
        if self.phase == "stopping" or event.get("code") == 130:
            self.phase, self.message = "stopped", "stopped; finished frames stay, Resume goes on from here"
        elif event.get("code") == 0:
            self.phase, self.message = "done", self._when_done
        else:
            self.phase = "failed"
            self.message = (
                f"the background Blender ended by itself (code {event.get('code')}); finished frames stay, try Resume. "
                f"{event.get('log', '')}"
            ).strip()


def in_panel_words(text: str) -> str:
    """The library's hints name options of the command line; the panel has fields."""
    for option, field_name in (
        ("another --out", "another Folder under Output"),
        ("--frames", "fewer Frames"),
        ("--light path", "Light: Path traced"),
        ("--up and --scene-unit decide", "Up and Unit under Scene decide"),
        ("--up decide", "Up under Scene decides"),
        ("--scene-unit decide", "Unit under Scene decides"),
        ("--textures", "Textures under Scene"),
        ("--no-denoise with more --samples", "Denoise: Off with more Samples"),
        ("--from FORMAT", "another file"),
    ):
        text = text.replace(option, field_name)
    return re.sub(r"(\w+)_sha256 \S+ there, \S+ asked", r"another \1", text)


class ChildProcess:
    """A process that takes JSON commands on standard input and says JSON events on standard output, one a line."""

    def __init__(self, command: list[str], log: Path, environment: dict[str, str] | None = None) -> None:
        """Raises WorkError where it cannot be started."""
        self._log = log
        self._events: queue.SimpleQueue[dict] = queue.SimpleQueue()
        try:
            with open(log, "wb") as errors:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env={**os.environ, **(environment or {})},
                    creationflags=getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0),
                )
        except OSError as error:
            raise WorkError(f"{command[0]}: cannot be started: {error.strerror or error}") from None
        threading.Thread(target=self._read, daemon=True).start()

    def send(self, command: dict) -> None:
        """Never fails: where the process has ended, its exit event says how."""
        with suppress(OSError, ValueError):
            stdin = cast(IO[bytes], self._process.stdin)
            stdin.write(json.dumps(command).encode() + b"\n")
            stdin.flush()

    def events(self) -> list[dict]:
        """What was said since the last call."""
        found = []
        while not self._events.empty():
            found.append(self._events.get_nowait())
        return found

    def end(self) -> None:
        if self._process.poll() is None:
            self._process.terminate()

    def _read(self) -> None:
        for line in cast(IO[bytes], self._process.stdout):
            try:
                event = json.loads(line)
            except ValueError:
                continue  # a line of Blender's own
            if isinstance(event, dict):
                self._events.put(event)
        code = self._process.wait()
        self._events.put({"event": "exit", "code": code, "log": _last_line(self._log) if code else ""})


def _last_line(log: Path) -> str:
    try:
        lines = log.read_text(errors="replace").split("\n")
    except OSError:
        return ""
    said = (line.strip() for line in reversed(lines) if not line.startswith("OIIO DEBUG"))
    return next((f"Its last word: {line[:200]}" for line in said if line), "")
