"""Run inside a Blender with a window: drives the panel by a script, with a screenshot of each step.

usage: xvfb-run -s "-screen 0 1600x1200x24" blender --factory-startup -P gui_driver_window.py -- ZIP
OUT ESTIMATE SHOTS [SETTINGS]

SETTINGS is JSON: settings of the panel after the preset `Quick look`, "open_all" to draw every
sub-panel open, and "parts", names of what is done after a look at the scene (PARTS below; default:
all). Ends the Blender and leaves SHOTS/result.json: what was pressed and said, ticks of a timer
during the renders, time to draw, what stayed behind.
"""

import gc
import importlib
import json
import os
import signal
import subprocess
import sys
import time
import traceback
import types
from pathlib import Path

import bpy

MODULE = "bl_ext.user_default.iclnuim"
bpy.context.preferences.view.show_splash = False
arguments = sys.argv[sys.argv.index("--") + 1 :]
archive, out, estimate, shots = arguments[:4]
wanted = json.loads(arguments[4]) if len(arguments) > 4 else {}
open_all, parts = wanted.pop("open_all", False), wanted.pop("parts", None)
Path(shots).mkdir(parents=True, exist_ok=True)
found: dict = {"messages": {}, "ticks_s": {}, "panels_ms": [], "view_ms": []}


def window():
    return bpy.context.window_manager.windows[0]


def view():
    return max((a for a in window().screen.areas if a.type == "VIEW_3D"), key=lambda a: a.x)


def press(name: str, **options) -> None:
    with bpy.context.temp_override(window=window(), area=view(), region=view().regions[-1]):
        try:
            getattr(bpy.ops.iclnuim, name)("INVOKE_DEFAULT", True, **options)
        except RuntimeError as error:
            found["messages"][name + " raised"] = str(error)
    found["messages"][name] = state.current().work.message


def undo_and_redo(look) -> list:
    """What `look` sees: before, after an undo, and after a redo."""
    seen = [look()]
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        with bpy.context.temp_override(window=window()):
            step()
        seen.append(look())
    return seen


def shoot(name: str) -> None:
    subprocess.run(["import", "-window", "root", str(Path(shots, name + ".png"))], check=False)


def from_above() -> None:
    region = next(r for r in view().regions if r.type == "WINDOW")
    with bpy.context.temp_override(window=window(), area=view(), region=region):
        bpy.ops.view3d.view_axis(type="TOP")


def ticking(name: str, until, max_s: float = 300.0):
    """Wait for `until`, noting how late a timer of 20 ms fires."""
    late = found["ticks_s"].setdefault(name, [])
    begun = last = time.perf_counter()
    while not until() and time.perf_counter() - begun < max_s:
        yield 0.02
        now = time.perf_counter()
        late.append(now - last - 0.02)
        last = now


def idle() -> bool:
    return not state.current().work.busy


def steps():
    global state
    yield 1.5
    bpy.ops.extensions.package_install_files(
        filepath=archive, repo="user_default", enable_on_install=False
    )
    if open_all:
        open_every_panel()
    bpy.ops.preferences.addon_enable(module=MODULE)
    state = importlib.import_module(MODULE + ".ui.state")
    measure()
    yield 1.0
    found["drawn_before_use"] = sorted(state.current().shapes)
    shoot("0_not_used")
    view().spaces.active.show_region_ui = True
    yield 1.0
    region = next(r for r in view().regions if r.type == "UI")
    region.active_panel_category = "ICL-NUIM"
    region.tag_redraw()
    yield from ticking("first use", lambda: state.current().shapes, 20.0)
    yield 1.0
    shoot("1_enabled")
    yield from look_and_key()
    for part in PARTS:
        if parts is None or part.__name__ in parts:
            yield from part()


def look_and_key():
    settings = bpy.context.scene.iclnuim
    settings.trajectory_source, settings.out = "kt2", out
    press("preset", preset="Quick look")
    for name, value in wanted.items():
        setattr(settings, name, value)
    settings.frames = "0:10:2"
    press("load_scene")
    yield 2.0
    shoot("2_scene_framed")
    press("remove_scene")
    yield 1.0
    shoot("2_scene_removed")
    found["start_up"] = [bpy.data.objects[n].hide_viewport for n in ("Cube", "Light")]
    press("load_scene")
    view().spaces.active.shading.color_type = "TEXTURE"
    yield 2.0
    from_above()
    view().spaces.active.region_3d.view_distance = 9.0
    yield 3.0
    shoot("2_scene_and_path")
    press("keyframe")
    yield 1.0
    found["camera_undone"] = undo_and_redo(lambda: "ICL-NUIM camera" in bpy.data.objects)
    bpy.context.scene.iclnuim.scale = 0.5
    bpy.ops.ed.undo_push(message="Scale")
    found["scale_undone"] = undo_and_redo(
        lambda: [bpy.context.scene.iclnuim.scale, state.current().trajectory_lines[1]]
    )
    bpy.ops.ed.undo()
    bpy.context.scene.frame_set(300)
    yield 3.0
    shoot("3_keyframed")


def preview():
    press("preview")
    yield from ticking("preview", idle)
    yield 2.0
    shoot("4_preview")
    found["messages"]["preview"] = state.current().work.message


def frames(folder: str = out) -> list[str]:
    return sorted(p.name for p in Path(folder, "raw/exr").glob("[0-9]*.exr"))


def render_five():
    work = state.current().work
    press("render")
    yield from ticking("render", lambda: work.done >= 2 or idle())
    yield 0.3
    shoot("5_rendering")
    press("render")  # two renders at once
    found["messages"]["second render"] = found["messages"].pop(
        "render raised", found["messages"]["render"]
    )
    press("cancel")
    yield from ticking("render", idle)
    yield 0.5
    shoot("6_cancelled")
    found["frames_after_cancel"] = frames()
    found["messages"]["after cancel"] = state.current().work.message
    press("resume")
    yield from ticking("render", idle)
    yield 1.0
    shoot("7_resumed")
    found["messages"]["after resume"] = state.current().work.message
    found["frames"] = frames()


def evaluate():
    settings = bpy.context.scene.iclnuim
    settings.estimate = estimate
    press("evaluate")
    from_above()
    view().spaces.active.region_3d.view_distance = 9.0
    press("plot")
    yield 3.0
    shoot("8_evaluated")
    press("open_folder")
    found["evaluation"] = state.current().evaluation_lines


def bad_situations():
    settings = bpy.context.scene.iclnuim
    settings.out = "/proc/nowhere"
    press("render")
    yield from ticking("refused", idle)
    yield 1.0
    shoot("9_refused")
    found["messages"]["refused"] = state.current().work.message
    settings.out, settings.frames = out + "_killed", "0:400:2"
    press("render")
    yield from ticking("killed", lambda: state.current().work.done >= 1 or idle())
    os.kill(state.current().work.worker.pid, signal.SIGKILL)
    yield from ticking("killed", idle)
    found["messages"]["child killed"] = state.current().work.message
    yield 1.0
    shoot("10_child_killed")


def render_longer():
    """Ticks over a render that shows its last frames beside the room in solid view."""
    settings = bpy.context.scene.iclnuim
    settings.out, settings.frames = out + "_longer", "0:60:2"
    press("render")
    yield from ticking("longer", lambda: state.current().work.done >= 12 or idle())
    shoot("11_last_frame")
    yield from ticking("longer", idle)
    found["longer"] = [state.current().work.message, len(frames(out + "_longer"))]


def switch_off_during_a_render():
    settings = bpy.context.scene.iclnuim
    settings.out, settings.frames = out + "_off", "0:400:2"
    press("render")
    yield from ticking("off", lambda: state.current().work.done >= 1 or idle())
    child = state.current().work.worker
    found["timers_meanwhile"] = timers()
    log = (state.user_folder("log") / "child.txt").read_text()
    found["denied_in_log"] = "PermissionError" in log
    for step in ("disable", "enable", "disable"):
        getattr(bpy.ops.preferences, f"addon_{step}")(module=MODULE)
        yield 1.0
    yield from ticking("switched off", lambda: child.poll() is not None, 10.0)
    found["child_after_switching_off"] = child.poll()
    found["left"] = {
        "timers": timers(),
        "classes": [name for name in dir(bpy.types) if name.startswith("ICLNUIM")],
        "property": hasattr(bpy.types.Scene, "iclnuim"),
        "handlers": [
            f.__qualname__
            for name in dir(bpy.app.handlers)
            if isinstance(getattr(bpy.app.handlers, name), list)
            for f in getattr(bpy.app.handlers, name)
            if "iclnuim" in f.__module__
        ],
    }
    yield 1.0
    shoot("12_switched_off")


PARTS = (preview, render_five, evaluate, bad_situations, render_longer, switch_off_during_a_render)


def timers() -> list[str]:
    """Functions of the extension that Blender would still call."""
    functions = [f for f in gc.get_objects() if isinstance(f, types.FunctionType)]
    ours = [f for f in functions if "iclnuim" in (f.__module__ or "")]
    return sorted({f.__qualname__ for f in ours if bpy.app.timers.is_registered(f)})


def panels() -> list[type[bpy.types.Panel]]:
    """All panels of the extension."""
    members = vars(importlib.import_module(MODULE + ".ui.panels")).values()
    return [
        member
        for member in members
        if isinstance(member, type) and member.__name__.startswith("ICLNUIM_PT")
    ]


def open_every_panel() -> None:
    for panel in panels():
        panel.bl_options = set()


def time_draw(panel: type[bpy.types.Panel]) -> None:
    content = panel.draw

    def timed(self, context):
        begun = time.perf_counter()
        content(self, context)
        found["panels_ms"].append((panel.__name__, (time.perf_counter() - begun) * 1e3))

    panel.draw = timed


def measure() -> None:
    """Time what the panels and the viewport draw."""
    for panel in panels():
        time_draw(panel)
    viewport = importlib.import_module(MODULE + ".ui.trajectory_view")
    drawn = viewport.draw

    def timed_view():
        begun = time.perf_counter()
        drawn()
        found["view_ms"].append((time.perf_counter() - begun) * 1e3)

    bpy.types.SpaceView3D.draw_handler_remove(state.current().draw_handle, "WINDOW")
    state.current().draw_handle = bpy.types.SpaceView3D.draw_handler_add(
        timed_view, (), "WINDOW", "POST_VIEW"
    )


remaining = steps()


def advance():
    try:
        return next(remaining)
    except StopIteration:
        pass
    except Exception:
        found["traceback"] = traceback.format_exc()
    Path(shots, "result.json").write_text(json.dumps(found))
    if "state" in globals() and state.is_registered():
        state.current().work.end()
    os._exit(0)


bpy.app.timers.register(advance, first_interval=1.0, persistent=True)
