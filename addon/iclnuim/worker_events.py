"""What a render worker reports: typed events <-> one JSON object each. No Blender is needed to read them.

`worker.render_run` and `worker.Session` emit them in this process, child.py as lines on its standard output.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar

from .errors import InputError


@dataclass(frozen=True)
class Event:
    """`name` is the value of `event` in JSON. Fields that are None or False are left out there."""

    name: ClassVar[str]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {"event": self.name, **{k: v for k, v in values.items() if v is not None and v is not False}}


@dataclass(frozen=True)
class Note(Event):
    """Something worth knowing."""

    name = "note"
    text: str


@dataclass(frozen=True)
class Started(Event):
    """The run folder exists. frames: of the trajectory (worker process) or asked for (render_run); missing: still to be rendered."""

    name = "start"
    frames: int
    missing: int | None = None
    pid: int | None = None


@dataclass(frozen=True)
class Ready(Event):
    """The scene is prepared, frames follow."""

    name = "ready"


@dataclass(frozen=True)
class Missing(Event):
    """How many `frames` or `sequences` (of) the command still has to make."""

    name = "missing"
    of: str
    missing: int


@dataclass(frozen=True)
class FrameDone(Event):
    """Frame `frame` is finished under its name. Seconds in Cycles, and to close its file; found: another process had finished it."""

    name = "frame"
    frame: int
    cycles: float | None = None
    close: float | None = None
    found: bool = False


@dataclass(frozen=True)
class Written(Event):
    """Frame `frame` is in all sequences that the command asks for."""

    name = "written"
    frame: int


@dataclass(frozen=True)
class Baked(Event):
    """The light map lies in `folder`."""

    name = "baked"
    folder: str


@dataclass(frozen=True)
class ChunkDone(Event):
    """A command is done: frames rendered, seconds, resident memory in MB."""

    name = "chunk"
    rendered: int
    seconds: float
    rss_mb: float | None = None


@dataclass(frozen=True)
class Stopped(Event):
    """A command was stopped before its end."""

    name = "stopped"
    rendered: int
    seconds: float
    rss_mb: float | None = None


@dataclass(frozen=True)
class Alive(Event):
    """Sent every two seconds by a worker process."""

    name = "alive"


@dataclass(frozen=True)
class Failed(Event):
    """One line that says what failed, the same with `{name}` for each setting (errors.named), and the exit code.

    bug: an error inside this program.
    """

    name = "error"
    text: str
    code: int | None = None
    template: str | None = None
    bug: bool = False


@dataclass(frozen=True)
class Done(Event):
    """All that was asked for is done."""

    name = "done"
    rendered: int | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Exited(Event):
    """Added by the parent: the worker process has ended with this code, below 0 for a signal; log: its last line where it failed."""

    name = "exit"
    code: int
    log: str | None = None


_KINDS: dict[str, type[Event]] = {kind.name: kind for kind in Event.__subclasses__()}


def from_dict(content: dict[str, Any]) -> Event | None:
    """The event of a JSON object; None for one that a later version may send. Keys that are not known are left out.

    Raises InputError where a field is missing.
    """
    kind = _KINDS.get(str(content.get("event")))
    if kind is None:
        return None
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in content]
    if missing:
        raise InputError(f"the event '{kind.name}' with {', '.join(missing)}", found=content)
    return kind(**{f.name: content[f.name] for f in fields(kind) if f.name in content})
