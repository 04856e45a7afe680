"""Events of a render worker, each a typed object or one JSON object. It needs no Blender.

`worker.Session` emits them inside its process; blender/child.py prints them as lines on its
standard output, and worker_client.py, at the other end of the pipe, reads them.
"""

from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar, dataclass_transform

from .errors import InputError


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Event:
    """Base of all events.

    Each event is a frozen dataclass. In JSON, `event` is its `name`, and fields that are None or
    False are left out.
    """

    name: ClassVar[str]

    def __init_subclass__(cls, name: str) -> None:
        cls.name = name
        dataclass(frozen=True)(cls)

    def to_dict(self) -> dict[str, Any]:
        """The event as a mapping, ready for JSON."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {
            "event": self.name,
            **{k: v for k, v in values.items() if v is not None and v is not False},
        }


class Note(Event, name="note"):
    """A message for the user."""

    text: str


class Started(Event, name="start"):
    """The run folder exists. frames: number of frames of the trajectory."""

    frames: int
    pid: int | None = None


class Ready(Event, name="ready"):
    """The scene is prepared; frames follow."""


class Missing(Event, name="missing"):
    """How many frames the command still has to make. of: `frames` or `sequences`."""

    of: str
    missing: int


class FrameDone(Event, name="frame"):
    """Frame `frame` is finished and its file has its final name.

    cycles, close: seconds to render, and to close the file. found: another process had finished
    it. black: the likely cause, if the frame is black.
    """

    frame: int
    cycles: float | None = None
    close: float | None = None
    found: bool = False
    black: str | None = None


class Written(Event, name="written"):
    """Frame `frame` is written in all requested sequences."""

    frame: int


class Baking(Event, name="baking"):
    """A bake of simulations begins, which takes about `seconds`. Interrupted, it begins again."""

    seconds: float


class Baked(Event, name="baked"):
    """The light map is in `folder`. made: this command has baked it."""

    folder: str
    made: bool = False


class ChunkDone(Event, name="chunk"):
    """A command is done: number of rendered frames, seconds, resident memory in MB."""

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
    """An error in one line, the same line with placeholders `{name}` for settings (errors.named),
    and the exit code.

    bug: the error is a defect of this program.
    """

    text: str
    code: int | None = None
    template: str | None = None
    bug: bool = False


class Done(Event, name="done"):
    """All requested work is done."""


class Exited(Event, name="exit"):
    """Added by the parent: the worker process has exited with this code, below 0 for a signal. log:
    the log's last line, if it failed.
    """

    code: int
    log: str | None = None


_KINDS: dict[str, type[Event]] = {kind.name: kind for kind in Event.__subclasses__()}


def from_dict(content: dict[str, Any]) -> Event | None:
    """The event of a JSON object; None for an unknown event, which a later version may send.
    Unknown keys are ignored.

    Raises InputError if a field is missing.
    """
    kind = _KINDS.get(str(content.get("event")))
    if kind is None:
        return None
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in content]
    if missing:
        raise InputError(f"the event '{kind.name}' with {', '.join(missing)}", found=content)
    return kind(**{f.name: content[f.name] for f in fields(kind) if f.name in content})
