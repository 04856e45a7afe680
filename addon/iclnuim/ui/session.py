"""What the panel holds besides its saved settings: the work in the child, the path shown, the last results. Gone with the window."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import bpy

from ..errors import IclnuimError, WorkError
from ..formats.files import write_json
from ..job import RenderJob
from .work import ChildProcess, Work, in_panel_words

POLL_S = 0.1
PACKAGE = __package__.rpartition(".")[0]
CHILD = Path(__file__).parents[1] / "blender" / "child.py"


@dataclass
class Session:
    """path and estimate: what the viewport draws (see viewport.py). Lines are ready to be shown."""

    work: Work = field(default_factory=Work)
    path_lines: list[str] = field(default_factory=list)
    path_warning: str = ""
    path_key: tuple = ()
    evaluation: object | None = None
    evaluation_lines: list[str] = field(default_factory=list)
    on_done: Callable[[], None] | None = None
    on_tick: Callable[[Work], None] | None = None
    waiting: set[Callable[[], None]] = field(default_factory=set)


current = Session()


def user_folder(name: str) -> Path:
    """A folder of the extension's own, the one place besides the output folder that is written to."""
    try:
        return Path(bpy.utils.extension_path_user(PACKAGE, path=name, create=True))
    except ValueError:  # run from a checkout, not as an installed extension
        folder = Path(tempfile.gettempdir()) / f"iclnuim-{os.getuid() if hasattr(os, 'getuid') else 0}" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def cache_folder() -> Path:
    """Where light maps lie: ICLNUIM_CACHE, or the extension's own folder."""
    own = os.environ.get("ICLNUIM_CACHE")
    return Path(own) if own else user_folder("cache")


def start(
    kind: str,
    job: RenderJob,
    out: Path,
    command: dict,
    when_done: str = "done",
    on_done: Callable[[], None] | None = None,
    on_tick: Callable[[Work], None] | None = None,
) -> None:
    """Begin `command` of `job` in a worker process that writes into `out`; `on_done()` afterwards, where all went well,
    `on_tick(work)` ten times a second meanwhile.

    In background mode, where timers never fire, wait for its end. Raises WorkError.
    """
    current.work.refuse_a_second()
    job_file = user_folder("log") / "job.json"
    write_json(job_file, {"job": job.to_dict(), "nice": 10})
    environment = {"ICLNUIM_CACHE": str(cache_folder())}
    child = ChildProcess(_command(job_file, out), user_folder("log") / "child.txt", environment)
    current.work.start(kind, command, child, when_done)
    current.on_done = on_done
    current.on_tick = None if bpy.app.background else on_tick
    if bpy.app.background:
        while current.work.busy:
            time.sleep(POLL_S)
            _tick()
        if current.work.phase == "failed":
            raise WorkError(current.work.message)
    elif not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, persistent=True)


def later(action: Callable[[], None], seconds: float = 0.2) -> None:
    """Once the window has drawn itself anew; given up where the extension is switched off before."""
    held = current

    def act() -> None:
        held.waiting.discard(act)
        action()

    held.waiting.add(act)
    bpy.app.timers.register(act, first_interval=seconds)


def end() -> None:
    """End the child and the timers, forget everything."""
    global current
    for act in current.waiting:
        if bpy.app.timers.is_registered(act):
            bpy.app.timers.unregister(act)
    current.work.end()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    shutil.rmtree(user_folder("preview"), ignore_errors=True)
    current = Session()


def _tick() -> float | None:
    """The timer: take in events, redraw the panel, finish. Returns the seconds to the next tick, None for the last."""
    changed = current.work.poll()
    if changed:
        redraw()
    if current.on_tick is not None:
        current.on_tick(current.work)
    if current.work.busy:
        return POLL_S
    finish, current.on_done, current.on_tick = current.on_done, None, None
    if finish is not None and current.work.phase == "done":
        try:
            finish()
        except IclnuimError as error:
            current.work.phase, current.work.message = "failed", in_panel_words(str(error))
        redraw()
    return None


def redraw() -> None:
    """Every 3D view anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _command(job_file: Path, out: Path) -> list[str]:
    """The same Blender again; where it is Python's module bpy, Python."""
    arguments = [str(job_file), str(out)]
    if getattr(bpy.app, "module", False) or not bpy.app.binary_path:
        return [sys.executable, str(CHILD), *arguments]
    blender = [bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "3"]
    return [*blender, "-P", str(CHILD), "--", *arguments]
