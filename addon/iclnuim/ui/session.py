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
from .work import ChildProcess, Work, in_panel_words

POLL_S = 0.1
PACKAGE = __package__.rpartition(".")[0]


@dataclass
class Session:
    """path and estimate: what the viewport draws (see viewport.py). Lines are ready to be shown."""

    work: Work = field(default_factory=Work)
    path_lines: list[str] = field(default_factory=list)
    path_warning: str = ""
    evaluation: object | None = None
    evaluation_lines: list[str] = field(default_factory=list)
    on_done: Callable[[], None] | None = None
    waiting: set[Callable[[], None]] = field(default_factory=set)


current = Session()
_counted: dict = {"at_s": float("-inf"), "maps": 0}


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


def baked_maps() -> int:
    """How many light maps the cache holds; looked up once a second at most, for the panel asks at every redraw."""
    if time.monotonic() - _counted["at_s"] > 1.0:
        folder = cache_folder() / "light"
        _counted.update(at_s=time.monotonic(), maps=len(list(folder.glob("*/recipe.json"))))
    return _counted["maps"]


def start(task: dict, on_done: Callable[[], None] | None = None) -> None:
    """Begin `task` in a child; in background mode, where timers never fire, wait for its end. Raises WorkError."""
    script = str(Path(__file__).with_name("task_process.py"))
    current.work.refuse_a_second()
    environment = {"ICLNUIM_CACHE": str(cache_folder())}
    current.work.start(task, ChildProcess(_command(script), user_folder("log") / "child.txt", environment))
    current.on_done = on_done
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
    if current.work.busy:
        return POLL_S
    finish, current.on_done = current.on_done, None
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


def _command(script: str) -> list[str]:
    """The same Blender again; where it is Python's module bpy, Python."""
    if getattr(bpy.app, "module", False) or not bpy.app.binary_path:
        return [sys.executable, script]
    return [bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "3", "-P", script]
