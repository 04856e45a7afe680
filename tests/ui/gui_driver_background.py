"""Run inside a Blender without a window: installs the zip into a clean profile, presses every
button, prints findings as JSON.

usage: gui_driver_background.py ZIP OUT ESTIMATE   (after `--` where a blender binary runs it)
"""

import gc
import importlib
import json
import sys
import traceback
import types
from pathlib import Path

import bpy

MODULE = "bl_ext.user_default.iclnuim"
PREFIXES = ("ICLNUIM", "iclnuim")
#: Buttons that can do nothing with the defaults in a file that is not saved.
GREYED = ("remove_scene", "resume", "open_folder", "view", "cancel", "evaluate", "plot")
ROOM = """v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nv -2 -2 2\nv 2 -2 2\nv 2 2 2\nv -2 2 2
f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\n"""


def timers() -> list[str]:
    """Functions of ours that Blender would still call."""
    functions = [f for f in gc.get_objects() if isinstance(f, types.FunctionType)]
    ours = [f for f in functions if "iclnuim" in (f.__module__ or "")]
    return sorted({f.__qualname__ for f in ours if bpy.app.timers.is_registered(f)})


def leftovers() -> dict:
    """Everything of ours that Blender still knows."""
    handlers = [
        f"{name}: {f.__module__}"
        for name in dir(bpy.app.handlers)
        if isinstance(getattr(bpy.app.handlers, name), list)
        for f in getattr(bpy.app.handlers, name)
        if "iclnuim" in f.__module__
    ]
    classes = [name for name in dir(bpy.types) if name.startswith(PREFIXES)]
    operators = [name for name in dir(bpy.ops.iclnuim)] if "iclnuim" in dir(bpy.ops) else []
    found = {
        "handlers": handlers,
        "classes": classes,
        "operators": operators,
        "property": hasattr(bpy.types.Scene, "iclnuim"),
        "state": hasattr(bpy.types.WindowManager, "iclnuim_state"),
        "timers": timers(),
    }
    return {key: value for key, value in found.items() if value}


def press(name: str) -> str:
    """FINISHED, CANCELLED, or why the button is greyed."""
    try:
        return next(iter(getattr(bpy.ops.iclnuim, name)()))
    except RuntimeError as error:
        return str(error)


def hidden_things() -> list[str]:
    """Objects that the viewport does not draw, and the world."""
    hidden = sorted(thing.name for thing in bpy.data.objects if thing.hide_viewport)
    return [*hidden, bpy.context.scene.world.name]


def in_millimetres(estimate: str, out: str) -> str:
    """A copy of the estimate with positions in millimetres."""
    lines = []
    for line in Path(estimate).read_text().splitlines():
        stamp, *position = line.split()[:4]
        lines.append(" ".join([stamp, *(str(1e3 * float(v)) for v in position), *line.split()[4:]]))
    file = Path(out, "millimetres.txt")
    file.write_text("\n".join(lines))
    return str(file)


def in_an_older_blender(package) -> str:
    """What is said below Blender 4.2, which is simulated."""
    compat = importlib.import_module(MODULE + ".blender.compat")
    compat.bpy = types.SimpleNamespace(
        app=types.SimpleNamespace(version=(4, 1, 1), version_string="4.1.1")
    )
    try:
        package.register()
        return ""
    except importlib.import_module(MODULE + ".errors").IclnuimError as error:
        return str(error)
    finally:
        compat.bpy = bpy


def written_room(out: str) -> str:
    """A room as .obj: five faces, opened in no time."""
    room = Path(out + "_file", "room.obj")
    room.parent.mkdir(parents=True, exist_ok=True)
    room.write_text(ROOM)
    return str(room)


def own_file(found: dict, button, out: str) -> None:
    """A user-provided room as .obj: shown, lit, baked, rendered; what the panel reports of its
    light map before and after.
    """
    settings = bpy.context.scene.iclnuim
    inputs, state = (importlib.import_module(f"{MODULE}.ui.{name}") for name in ("inputs", "state"))
    before = {name: getattr(settings, name) for name in ("scene_source", "light", "out", "frames")}
    settings.scene_source, settings.scene_file, settings.light = "FILE", written_room(out), "baked"
    settings.map_size, settings.map_samples, settings.frames = 64, 2, "100"
    settings.out = out + "_file/run"
    found["light_before"] = inputs.light_map_line(settings)
    button("load_scene", "load_scene an own file")
    found["read_as"] = list(state.current().work.notes)
    for name in ("bake", "render"):
        button(name, f"{name} an own file")
    state.current().light_map = None
    found["light_after"] = inputs.light_map_line(settings)
    found["light_counts_as_another"] = (
        setattr(settings, "map_size", 128),
        inputs.light_map_line(settings),
    )[1]
    for name, value in before.items():
        setattr(settings, name, value)
    bpy.ops.iclnuim.load_scene()


def saved_and_opened_again(found: dict, folder: str) -> None:
    """Settings are saved in the .blend; the user's presets come back as they were saved."""
    settings = bpy.context.scene.iclnuim
    settings.seed, settings.formats = 7, {"tum", "euroc"}
    found["pressed"]["save preset"] = next(iter(bpy.ops.iclnuim.preset_save(preset="mine")))
    file = str(Path(folder + "_saved", "saved.blend"))
    Path(file).parent.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.read_factory_settings()
    bpy.ops.preferences.addon_enable(module=MODULE)
    found["factory"] = bpy.context.scene.iclnuim.seed
    bpy.ops.wm.open_mainfile(filepath=file)
    settings = bpy.context.scene.iclnuim
    found["opened_again"] = [settings.seed, sorted(settings.formats), settings.trajectory_source]
    state = importlib.import_module(MODULE + ".ui.state")
    found["path_before_use"] = state.current().trajectory_lines
    press("refresh")
    found["path_of_the_opened_file"] = state.current().trajectory_lines
    for preset in ("Quick look", "Benchmark", "mine"):
        found["pressed"][preset] = next(iter(bpy.ops.iclnuim.preset(preset=preset)))
    found["own_preset"] = [settings.seed, sorted(settings.formats)]


def main(archive: str, out: str, estimate: str) -> dict:
    bpy.ops.wm.read_factory_settings()
    bpy.ops.extensions.package_install_files(
        filepath=archive, repo="user_default", enable_on_install=True
    )
    package = importlib.import_module(MODULE)
    state = importlib.import_module(MODULE + ".ui.state")
    found = {"file": package.__file__, "pressed": {}, "messages": {}}

    def button(name: str, label: str | None = None) -> None:
        found["pressed"][label or name] = press(name)
        found["messages"][label or name] = state.current().work.message

    package.unregister()
    found["older_blender"] = in_an_older_blender(package)
    found["left_after_unregister"] = leftovers()
    for _ in range(2):
        package.register()

    settings = bpy.context.scene.iclnuim
    found["not_used"] = [state.current().trajectory_lines, sorted(state.current().shapes)]
    found["greyed"] = {name: press(name) for name in GREYED}
    button("render", "no folder chosen")
    settings.trajectory_source, settings.out, settings.frames = "kt2", out, "0:4:2"
    small = {"width": 64, "height": 48, "fx": 64 / 1.33, "fy": 48, "cx": 31.5, "cy": 23.5}
    for name, value in small.items():
        setattr(settings, name, value)
    settings.light, settings.samples, settings.denoise = "path", 1, "OFF"

    for name in ("load_scene", "remove_scene", "load_scene", "refresh", "keyframe", "preview"):
        button(name)
        found.setdefault("hidden", []).append(hidden_things())
    found["no_wall"] = state.current().trajectory_warning
    shown = settings.scene_source
    settings.scene_source, settings.scene_file = "FILE", written_room(out)
    button("render")
    kept = Path(out, "path.txt")
    found["pressed"]["save path"] = next(iter(bpy.ops.iclnuim.save_path(filepath=str(kept))))
    found["saved_path"] = kept.read_text()
    found["path"] = state.current().trajectory_lines
    camera = bpy.context.scene.camera
    bpy.context.scene.frame_set(100)
    found["camera_at_100"] = [*camera.matrix_world.translation]
    settings.frames = "0:6:2"
    button("resume")
    settings.scene_source = shown
    settings.estimate = estimate
    for name in ("evaluate", "plot", "view"):
        button(name)
    page = Path(out, "view.html")
    if page.is_file():
        found["page"] = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0])
    found["evaluation"] = state.current().evaluation_lines
    found["no_warning"] = state.current().evaluation_warnings
    settings.estimate = in_millimetres(estimate, out)
    button("evaluate", "evaluate millimetres")
    found["warnings"] = state.current().evaluation_warnings
    found["images"] = sorted(
        image.name for image in bpy.data.images if image.name.startswith("ICL-NUIM")
    )
    found["frames"] = sorted(path.name for path in Path(out, "raw/exr").glob("*.exr"))
    found["sequences"] = sorted(
        str(path.relative_to(out)) for path in Path(out).glob("*/rgb/*.png")
    )

    own_file(found, button, out)
    settings.out = "/proc/nowhere"
    button("render", "no folder")
    settings.out, settings.trajectory_source, settings.trajectory_file = out, "FILE", archive
    button("render", "wrong trajectory")
    found["wrong_path"] = state.current().trajectory_warning
    bpy.context.scene.camera, settings.trajectory_source = None, "CAMERA"
    button("keyframe", "no camera")
    settings.trajectory_source = "kt1"
    button("render", "another recipe")
    button("cancel")
    bpy.context.scene.frame_set(3)
    settings.trajectory_source = "kt2"
    button("keyframe", "keyframe again")
    settings.trajectory_source, settings.scene_source, settings.out, settings.frames = (
        "CAMERA",
        "OPEN",
        out + "_own",
        "100",
    )
    for name in ("render", "resume"):
        button(name, f"{name} the open file")
    settings.trajectory_source, settings.use_start, settings.scale = "kt2", True, 0.5
    settings.start_location = (0.0, 50.0, 1.0)
    found["moved_path"] = state.current().trajectory_lines
    settings.start_location, settings.scale = (0.0, -1.0, 1.2), 3.0
    button("refresh", "through the wall")
    found["wall"] = state.current().trajectory_warning
    saved_and_opened_again(found, out)
    package.unregister()
    found["left_at_the_end"] = leftovers()
    package.register()
    for step in ("disable", "enable", "disable"):
        getattr(bpy.ops.preferences, f"addon_{step}")(module=MODULE)
    found["left_when_disabled"] = leftovers()
    return found


if __name__ == "__main__":
    try:
        result = main(*sys.argv[-3:])
    except Exception:
        result = {"traceback": traceback.format_exc()}
    sys.stdout.write("\nRESULT " + json.dumps(result) + "\n")
    sys.stdout.flush()
