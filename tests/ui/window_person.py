"""Run inside a Blender with a window: a scripted person works through the panel, with a screenshot of each step.

usage: xvfb-run -s "-screen 0 1600x1200x24" blender --factory-startup -P window_person.py -- ZIP OUT ESTIMATE SHOTS
Ends the Blender and leaves SHOTS/result.json: what was pressed and said, ticks of a timer during the render, time to draw.
"""

import importlib
import json
import os
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy

MODULE = "bl_ext.user_default.iclnuim"
bpy.context.preferences.view.show_splash = False
archive, out, estimate, shots = sys.argv[-4:]
Path(shots).mkdir(parents=True, exist_ok=True)
found: dict = {"messages": {}, "ticks_s": [], "panels_ms": [], "view_ms": []}


def view():
    return max(
        (a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D"), key=lambda a: a.x
    )


def press(name: str, **options) -> None:
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=view(), region=view().regions[-1]):
        try:
            getattr(bpy.ops.iclnuim, name)("INVOKE_DEFAULT", True, **options)
        except RuntimeError as error:
            found["messages"][name + " raised"] = str(error)
    found["messages"][name] = session.current.work.message


def undo_and_redo(name: str) -> list[bool]:
    """Whether the object is there before, after an undo, and after a redo."""
    there = [name in bpy.data.objects]
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            step()
        there.append(name in bpy.data.objects)
    return there


def shoot(name: str) -> None:
    subprocess.run(["import", "-window", "root", str(Path(shots, name + ".png"))], check=False)


def ticking(until, most_s: float = 300.0):
    """Wait for `until`, noting how late a timer of 20 ms fires."""
    begun = last = time.perf_counter()
    while not until() and time.perf_counter() - begun < most_s:
        yield 0.02
        now = time.perf_counter()
        found["ticks_s"].append(now - last - 0.02)
        last = now


def person():
    global session
    yield 1.5
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    session = importlib.import_module(MODULE + ".ui.session")
    measure()
    view().spaces.active.show_region_ui = True
    yield 1.0
    region = next(r for r in view().regions if r.type == "UI")
    region.active_panel_category = "ICL-NUIM"
    region.tag_redraw()
    yield 1.5
    shoot("1_enabled")
    settings = bpy.context.scene.iclnuim
    settings.trajectory_source, settings.out, settings.frames = "kt2", out, "0:10:2"
    press("preset", preset="Quick look")
    settings.frames = "0:10:2"
    press("load_scene")
    yield 2.0
    with bpy.context.temp_override(
        window=bpy.context.window_manager.windows[0],
        area=view(),
        region=next(r for r in view().regions if r.type == "WINDOW"),
    ):
        bpy.ops.view3d.view_axis(type="TOP")
    yield 3.0
    shoot("2_scene_and_path")
    press("keyframe")
    yield 1.0
    found["undone"] = undo_and_redo("ICL-NUIM camera")
    settings = bpy.context.scene.iclnuim
    bpy.context.scene.frame_set(300)
    yield 3.0
    shoot("3_keyframed")
    press("preview")
    yield from ticking(lambda: not session.current.work.busy)
    yield 2.0
    shoot("4_preview")
    found["messages"]["preview"] = session.current.work.message
    found["ticks_s"].clear()
    press("render")
    yield from ticking(lambda: session.current.work.done >= 2 or not session.current.work.busy)
    shoot("5_rendering")
    press("render")  # two renders at once
    press("cancel")
    yield from ticking(lambda: not session.current.work.busy)
    yield 0.5
    shoot("6_cancelled")
    found["frames_after_cancel"] = sorted(p.name for p in Path(out, "raw/exr").glob("[0-9]*.exr"))
    found["messages"]["after cancel"] = session.current.work.message
    press("resume")
    yield from ticking(lambda: not session.current.work.busy)
    yield 1.0
    shoot("7_resumed")
    found["messages"]["after resume"] = session.current.work.message
    found["frames"] = sorted(p.name for p in Path(out, "raw/exr").glob("[0-9]*.exr"))
    settings.estimate = estimate
    press("evaluate")
    with bpy.context.temp_override(
        window=bpy.context.window_manager.windows[0],
        area=view(),
        region=next(r for r in view().regions if r.type == "WINDOW"),
    ):
        bpy.ops.view3d.view_axis(type="TOP")
    press("plot")
    yield 3.0
    shoot("8_evaluated")
    found["evaluation"] = session.current.evaluation_lines
    settings.out = "/proc/nowhere"
    press("render")
    yield from ticking(lambda: not session.current.work.busy)
    yield 1.0
    shoot("9_refused")
    found["messages"]["refused"] = session.current.work.message


def measure() -> None:
    """Time what the panels and the viewport draw."""
    panels, viewport = (importlib.import_module(f"{MODULE}.ui.{name}") for name in ("panels", "viewport"))
    content = panels._SubPanel.draw

    def timed(self, context):
        begun = time.perf_counter()
        content(self, context)
        found["panels_ms"].append((type(self).__name__, (time.perf_counter() - begun) * 1e3))

    panels._SubPanel.draw = timed
    drawn = viewport._draw

    def timed_view():
        begun = time.perf_counter()
        drawn()
        found["view_ms"].append((time.perf_counter() - begun) * 1e3)

    bpy.types.SpaceView3D.draw_handler_remove(viewport._handle, "WINDOW")
    viewport._handle = bpy.types.SpaceView3D.draw_handler_add(timed_view, (), "WINDOW", "POST_VIEW")


steps = person()


def advance():
    try:
        return next(steps)
    except StopIteration:
        pass
    except Exception:
        found["traceback"] = traceback.format_exc()
    Path(shots, "result.json").write_text(json.dumps(found))
    if "session" in globals():
        session.end()
    os._exit(0)


bpy.app.timers.register(advance, first_interval=1.0, persistent=True)
