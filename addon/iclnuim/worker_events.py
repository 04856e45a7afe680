"""What a render worker reports: typed events <-> one JSON object each. No Blender is needed to read them.

`worker.Session` emits them in this process, child.py as lines on its standard output.
"""

from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar, dataclass_transform

from .errors import InputError


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Event:
    """Base of all events, each a frozen dataclass. `name` is the value of `event` in JSON; fields that are None or False are left out there."""

    name: ClassVar[str]

    def __init_subclass__(cls, name: str) -> None:
        cls.name = name
        dataclass(frozen=True)(cls)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {"event": self.name, **{k: v for k, v in values.items() if v is not None and v is not False}}


class Note(Event, name="note"):
    """Something worth knowing."""

    text: str


class Started(Event, name="start"):
    """The run folder exists. frames: of the trajectory."""

    frames: int
    pid: int | None = None


class Ready(Event, name="ready"):
    """The scene is prepared, frames follow."""


class Missing(Event, name="missing"):
    """How many `frames` or `sequences` (of) the command still has to make."""

    of: str
    missing: int


class FrameDone(Event, name="frame"):
    """Frame `frame` is finished under its name. Seconds in Cycles, and to close its file; found: another process had finished it."""

    frame: int
    cycles: float | None = None
    close: float | None = None
    found: bool = False


class Written(Event, name="written"):
    """Frame `frame` is in all sequences that the command asks for."""

    frame: int


class Baked(Event, name="baked"):
    """The light map lies in `folder`."""

    folder: str


class ChunkDone(Event, name="chunk"):
    """A command is done: frames rendered, seconds, resident memory in MB."""

    rendered: int
    seconds: float
    rss_mb: float | None = None


class Stopped(Event, name="stopped"):
    """A command was stopped before its end."""

    rendered: int
    seconds: float
    rss_mb: float | None = None


class Alive(Event, name="alive"):
    """Sent every two seconds by a worker process."""


class Failed(Event, name="error"):
    """One line that says what failed, the same with `{name}` for each setting (errors.named), and the exit code.

    bug: an error inside this program.
    """

    text: str
    code: int | None = None
    template: str | None = None
    bug: bool = False


class Done(Event, name="done"):
    """All that was asked for is done."""


class Exited(Event, name="exit"):
    """Added by the parent: the worker process has ended with this code, below 0 for a signal; log: its last line where it failed."""

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
