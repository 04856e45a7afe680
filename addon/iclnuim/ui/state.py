"""The panel's state that is not saved, from register() to unregister(): work in a worker process,
timers, results, drawn shapes.
"""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Area, Context, Operator

from ..errors import IclnuimError, WorkError
from ..evaluation.absolute_error import AbsoluteError
from ..job import RenderJob
from ..worker_client import WorkerClient, worker_command
from .work import Work

POLL_S = 0.1
#: Added to the worker's niceness, so that the window stays responsive.
WINDOW_FIRST = 10
PACKAGE = __package__.rpartition(".")[0]


@dataclass
class PanelState:
    """Lines of text are ready to be shown. trajectory_key: the settings that the drawn trajectory
    was read with.

    shapes: name -> end points of line segments (m, 3) and their colours (m, 4); batches: the same
    on the GPU. light_map: the last look-up of a scene's light map: its key, its time
    (time.monotonic()) and the line that is shown. view_before: whether the views showed extras and
    culled backfaces before a scene was shown; None while none is shown.
    """

    work: Work
    trajectory_changed: Callable[[Context], None]
    trajectory_lines: list[str] = field(default_factory=list)
    trajectory_warning: str = ""
    trajectory_key: tuple = ()
    evaluation: AbsoluteError | None = None
    evaluation_lines: list[str] = field(default_factory=list)
    evaluation_warnings: list[str] = field(default_factory=list)
    shapes: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    batches: dict[str, list] = field(default_factory=dict)
    draw_handle: Any = None
    view_before: tuple[bool, bool] | None = None
    light_map: tuple[tuple, float, str] | None = None
    on_done: Callable[[], None] | None = None
    on_tick: Callable[[Work], None] | None = None
    waiting: set[Callable[[], None]] = field(default_factory=set)


def current() -> PanelState:
    """The state of the registered panel."""
    return bpy.types.WindowManager.iclnuim_state


def is_registered() -> bool:
    """Whether the panel is registered."""
    return hasattr(bpy.types.WindowManager, "iclnuim_state")


def end() -> None:
    """End the worker process and the timers, and delete the state."""
    state = current()
    for action in (*state.waiting, _tick):
        if bpy.app.timers.is_registered(action):
            bpy.app.timers.unregister(action)
    state.work.end()
    shutil.rmtree(user_folder("preview"), ignore_errors=True)
    del bpy.types.WindowManager.iclnuim_state


def user_folder(name: str) -> Path:
    """A folder in the extension's user folder.

    Only this folder and the output folder are written to.
    """
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path=name, create=True))
    except ValueError:  # run from a checkout, not as an installed extension
        user = os.getuid() if hasattr(os, "getuid") else 0
        folder = Path(tempfile.gettempdir()) / f"iclnuim-{user}" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def cache_folder() -> Path:
    """The folder of the light maps: ICLNUIM_CACHE, or a folder in the extension's user folder."""
    own = os.environ.get("ICLNUIM_CACHE")
    return Path(own) if own else user_folder("cache")


def start(
    kind: str,
    job: RenderJob,
    out: Path,
    command: dict[str, Any],
    when_done: str = "done",
    on_done: Callable[[], None] | None = None,
    on_tick: Callable[[Work], None] | None = None,
) -> None:
    """Start `command` of `job` in a worker process that writes into `out`.

    `on_done()` is called after success, `on_tick(work)` ten times a second until the end. In
    background mode timers are never called, so this function waits for the end. Raises WorkError.
    """
    state = current()
    state.work.check_idle()
    numbers = command.get("frames", ())
    options = {"job": job.to_dict(), "asked": (), "last": max(numbers, default=None)}
    if not bpy.app.background:
        options["nice"] = WINDOW_FIRST
    if job.light == "auto":
        options["asked"] = numbers
    log = user_folder("log") / "child.txt"
    environment = {"ICLNUIM_CACHE": str(cache_folder())}
    worker = WorkerClient(
        worker_command(), options, out, log, environment=environment, writable=[out.parent]
    )
    state.work.start(kind, command, worker, when_done)
    state.on_done = on_done
    if not bpy.app.background:
        state.on_tick = on_tick
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, persistent=True)
        return
    while state.work.busy:
        time.sleep(POLL_S)
        _tick()
    if state.work.phase == "failed":
        raise WorkError(state.work.message)


def later(action: Callable[[], None]) -> None:
    """Call `action` after the window has been redrawn.

    It is not called if the extension is disabled before.
    """
    waiting = current().waiting

    def act() -> None:
        waiting.discard(act)
        action()

    waiting.add(act)
    bpy.app.timers.register(act, first_interval=0.2)


def operator(
    label: str,
    *needs: Callable[[Context], object],
    undo: bool = False,
    invoke: Callable[..., set[str]] | None = None,
    **properties: Any,
) -> Callable[[Callable[..., None]], type[Operator]]:
    """Decorator: makes the operator iclnuim.NAME from a function NAME(self, context) whose
    docstring is the tooltip.

    If one of `needs` raises an IclnuimError, the button is greyed, and its message is in the
    tooltip. If the function raises one, the operator is cancelled and the message is shown in the
    panel and the status bar.
    """

    def made(function: Callable[..., None]) -> type[Operator]:
        def execute(self: Operator, context: Context) -> set[str]:
            return _executed(function, self, context)

        members: dict[str, Any] = {
            "__doc__": function.__doc__,
            "__module__": function.__module__,
            "__annotations__": properties,
            "bl_idname": f"iclnuim.{function.__name__}",
            "bl_label": label,
            "execute": execute,
            "poll": classmethod(lambda cls, context: _possible(needs, cls, context)),
        }
        if undo:
            members["bl_options"] = {"REGISTER", "UNDO"}
        if invoke:
            members["invoke"] = invoke
        return type(f"ICLNUIM_OT_{function.__name__}", (Operator,), members)

    return made


def _possible(
    needs: Iterable[Callable[[Context], object]],
    operator: type[Operator],
    context: Context,
) -> bool:
    try:
        for need in needs:
            need(context)
    except IclnuimError as error:
        operator.poll_message_set(sentence(error.worded(current().work.name_of)))
        return False
    return True


def _executed(function: Callable[..., None], operator: Operator, context: Context) -> set[str]:
    work = current().work
    if not work.busy:  # the messages belong to the previous step
        work.phase = "idle"
        work.message = ""
        work.notes.clear()
    try:
        function(operator, context)
    except IclnuimError as error:
        text = error.worded(work.name_of)
        if not work.busy:
            work.phase = "failed"
            work.message = text
        operator.report({"WARNING"}, text)
        return {"CANCELLED"}
    finally:
        redraw("UI")
    return {"FINISHED"}


def idle(context: Context) -> None:
    """Raises WorkError if other work is running."""
    current().work.check_idle()


def sentence(text: str) -> str:
    """The text with a capital letter, unless it begins with a name or a path."""
    word = text.partition(" ")[0].rstrip(",;:")
    return text[:1].upper() + text[1:] if word.isalpha() else text


def areas(kind: str) -> list[Area]:
    """The areas of all windows whose editor is of this kind."""
    found = []
    for window in bpy.context.window_manager.windows:
        found += [area for area in window.screen.areas if area.type == kind]
    return found


def redraw(kind: str = "") -> None:
    """Redraw the regions of this kind in every 3D view, or all of them."""
    for area in areas("VIEW_3D"):
        for region in area.regions:
            if kind in ("", region.type):
                region.tag_redraw()


def _tick() -> float | None:
    """The timer: process events, redraw the panel, finish.

    Returns the seconds until the next tick, or None after the last one.
    """
    state = current()
    if state.work.poll():
        redraw("UI")
    if state.on_tick is not None:
        state.on_tick(state.work)
    if state.work.busy:
        return POLL_S
    finish = state.on_done
    state.on_done = None
    state.on_tick = None
    if finish is not None and state.work.phase == "done":
        try:
            finish()
        except IclnuimError as error:
            state.work.phase = "failed"
            state.work.message = error.worded(state.work.name_of)
        redraw()
    return None
