"""State machine of the work in a worker process, without Blender: start, poll, cancel.

It turns the worker's events into messages.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .. import worker_events as events
from ..errors import WorkError, named
from ..worker_client import WorkerClient

#: After a request to stop, a worker has this time to finish its frame. Then it is terminated, and
#: the frame is rendered again on resume.
GRACE_S = 4.0
BUSY = ("starting", "preparing", "rendering", "writing", "stopping")


def _now(now_s: float | None) -> float:
    return time.monotonic() if now_s is None else now_s


@dataclass
class Work:
    """The state that the panel shows. phase: idle, one of BUSY, done, stopped or failed. done of
    total frames are finished in the current stage, those of an earlier run included.

    name_of: returns the panel's label of a setting, for errors. last_frame: the number of the last
    finished frame. Seconds are wall time.
    """

    name_of: Callable[[str], str] = str
    phase: str = "idle"
    kind: str = ""
    done: int = 0
    total: int = 0
    last_frame: int | None = None
    message: str = ""
    notes: list[str] = field(default_factory=list)
    worker: WorkerClient | None = None
    _when_done: str = ""
    _found: int = 0
    _stage_begun_s: float = 0.0
    _started_s: float = field(default_factory=time.monotonic, compare=False)
    _stopping_since_s: float | None = None

    @property
    def busy(self) -> bool:
        return self.phase in BUSY

    def check_idle(self) -> None:
        """Raises WorkError if other work is running."""
        if self.busy:
            hint = "again when it has finished, or Cancel first"
            raise WorkError(f"a {self.kind} is already running", hint=hint)

    def start(
        self, kind: str, command: Mapping[str, Any], worker: WorkerClient, when_done: str = "done"
    ) -> None:
        """Send `command` (see blender/child.py) to the worker.

        `kind` is its name in the panel. Raises WorkError if other work is running.
        """
        self.check_idle()
        starting = "Blender is starting in the background"
        vars(self).update(vars(Work(self.name_of, "starting", kind, message=starting)))
        self.worker = worker
        self.total = len(command.get("frames", ()))
        self._when_done = when_done
        worker.send(command)

    def poll(self, now_s: float | None = None) -> bool:
        """Process the worker's events without waiting. Returns True if there were any."""
        now_s = _now(now_s)
        if self.worker is None:
            return False
        worker = self.worker
        found = self.worker.events()
        for event in found:
            self._take(event, now_s)
        if self._stopping_since_s is not None and now_s - self._stopping_since_s > GRACE_S:
            worker.terminate()
        return bool(found)

    def cancel(self, now_s: float | None = None) -> None:
        """Request a stop. Finished frames stay."""
        if self.busy and self.worker is not None:
            self._stopping_since_s = _now(now_s)
            if self.phase in ("starting", "preparing"):  # there is no frame to finish
                self._stopping_since_s -= GRACE_S
            self.phase = "stopping"
            self.message = "stopping" + self._what_stays()
            self.worker.stop()

    def end(self) -> None:
        """Terminate the worker immediately."""
        if self.worker is not None:
            self.worker.terminate()
            if self.busy:
                self.phase = "stopped"
            self.worker = None

    def frames_per_second(self, now_s: float | None = None) -> float:
        """Frames per second of the current stage; 0 before its first frame."""
        elapsed = _now(now_s) - self._stage_begun_s
        return (self.done - self._found) / elapsed if elapsed > 0 else 0.0

    def seconds_here(self, now_s: float | None = None) -> float:
        """Seconds since the work was started."""
        return _now(now_s) - self._started_s

    def seconds_left(self, now_s: float | None = None) -> float | None:
        rate = self.frames_per_second(now_s)
        return (self.total - self.done) / rate if rate else None

    def _take(self, event: events.Event, now_s: float) -> None:
        match event:
            case events.Note(text):
                self.notes.append(text)
                self._become(self.phase, text)
            case events.Started():
                self._become("preparing", "preparing scene and light")
            case events.Missing(of, missing):
                self.done = self._found = self.total - missing
                self._stage_begun_s = now_s
                if of == "sequences":
                    self._become("writing", "")
            case events.Ready():
                self._stage_begun_s = now_s
                self._become("rendering", "")
            case events.FrameDone(frame) | events.Written(frame):
                self.done += 1
                self.last_frame = frame
                if isinstance(event, events.FrameDone):
                    self._note_black(frame, event.black)
            case events.ChunkDone() if self.worker is not None:
                self.worker.stop()
            case events.Failed():
                self.message = named(event.template or event.text, self.name_of)
                if self.done and self.phase in ("rendering", "writing"):
                    self.message += self._what_stays()
                self.phase = "failed"
            case events.Exited(code, log):
                self.worker = self._stopping_since_s = None
                self._exited(code, log)

    def _note_black(self, frame: int, black: str | None) -> None:
        """Add a note of a black frame, once for each reason."""
        if black and not any(black in note for note in self.notes):
            self.notes.append(f"frame {frame} is black: {black}")

    def _exited(self, code: int, log: str | None) -> None:
        if self.phase == "failed":
            return
        if self.phase == "stopping" or code == 130:
            self.phase = "stopped"
            self.message = "stopped" + self._what_stays()
        elif code == 0:
            self.phase = "done"
            self.message = self._when_done
        else:
            self.phase = "failed"
            self.message = f"the background Blender exited unexpectedly (code {code})"
            self.message += self._what_stays()
            if log:
                self.message += f". The end of its log: {log}"

    def _what_stays(self) -> str:
        stays = "; finished frames stay, and Resume continues after them"
        return stays if self.kind == "render" else ""

    def _become(self, phase: str, message: str) -> None:
        if self.phase != "stopping":
            self.phase = phase
            self.message = message
