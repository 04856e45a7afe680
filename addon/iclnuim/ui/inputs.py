"""Make a trajectory, a render job and the files that a worker needs from the panel's settings, and
look up the light map in the cache.
"""

import os
import platform
import time
from dataclasses import replace
from pathlib import Path

import bpy
import mathutils
import numpy as np
from bpy.types import Context, PropertyGroup, Scene

from .. import shipped
from ..blender.light import light_map
from ..blender.render import camera
from ..blender.render.camera_notes import camera_notes
from ..errors import IclnuimError, InputError, WorkError
from ..formats import exr, png
from ..formats.files import make_folder, process_is_running, sha256
from ..formats.libraries import first_library
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import adopt
from ..job import RenderJob
from ..shipped import SCENES, TRAJECTORIES
from ..trajectory_files.trajectories import (
    LoadedTrajectory,
    ReadAs,
    read_trajectory,
    trajectory_text,
    write_trajectory,
)
from . import state

DEFAULT_OUT = "//iclnuim"
#: Metres and radians between the poses of a camera that stands still.
_STILL = 1e-6
#: The panel needs the state of the light map at every redraw. Files are checked again after this
#: many seconds.
_FRESH_S = 1.0


def trajectory(context: Context) -> LoadedTrajectory:
    """The chosen trajectory, scaled and moved. Raises InputError."""
    check_trajectory(context)
    settings = context.scene.iclnuim
    if settings.trajectory_source == "CAMERA":
        loaded = _animation(context.scene)
    elif settings.trajectory_source == "FILE":
        loaded = read_trajectory(bpy.path.abspath(settings.trajectory_file))
    else:
        name = _shipped_name(settings)
        loaded = read_trajectory(shipped.trajectory_file(name))
        sentence = name
        if settings.scene_source not in SCENES:
            sentence += (
                "; it was made for another room, and may pass through surfaces of this scene"
            )
        loaded = replace(loaded, read_as=replace(loaded.read_as, sentence=sentence))
    if settings.scale == 1.0 and not settings.use_start:
        return loaded
    start = loaded.trajectory.T_world_camera[0]
    if settings.use_start:
        rotation = np.array(mathutils.Euler(settings.start_rotation).to_matrix(), float)
        pose = SE3.from_matrix(np.c_[rotation, np.array(settings.start_location, float)])
        start = axes.world_cv_from_world_blender(pose)
    moved = adopt(loaded.trajectory, start, round(settings.scale, 6))
    return replace(loaded, trajectory=moved)


def _animation(scene: Scene) -> LoadedTrajectory:
    poses = camera.trajectory(scene)
    notes = camera_notes(scene)
    moved = np.r_[poses.step_lengths_m(), poses.step_angles_rad()]
    if not (moved > _STILL).any():
        notes.append(f"it stands still: its {len(poses)} poses are the same")
    sentence = "; ".join(["the active camera's animation", *notes])
    read_as = ReadAs("tum", "right-handed", "world", sentence)
    return LoadedTrajectory(poses, read_as, np.arange(len(poses)), len(poses))


def check_trajectory(context: Context) -> None:
    """Raises InputError if no trajectory is chosen."""
    settings = context.scene.iclnuim
    if settings.trajectory_source == "FILE" and not settings.trajectory_file:
        hint = "choosing one under {trajectory}"
        raise InputError("a trajectory file", found="none", hint=hint)
    if settings.trajectory_source == "CAMERA":
        camera.active(context.scene)


def current_pose(context: Context) -> int:
    """The pose at the timeline's current frame, from 0. An animation begins at the first frame of
    the timeline, keyframes of a trajectory at 0.
    """
    scene = context.scene
    number = scene.frame_current
    if scene.iclnuim.trajectory_source == "CAMERA":
        number -= scene.frame_start
    return max(number, 0)


def output_folder(settings: PropertyGroup) -> Path:
    """The absolute path; `//` is the folder of the saved .blend.

    Raises InputError if that file is not saved yet.
    """
    out = settings.out.strip() or DEFAULT_OUT
    if out.startswith("//") and not bpy.data.filepath:
        hint = "choosing one as {out}, or saving this file"
        raise InputError("an output folder", found="none", hint=hint)
    return Path(bpy.path.abspath(out)).expanduser().resolve()


def existing_output(context: Context) -> Path:
    """The output folder. Raises InputError if it does not exist."""
    folder = output_folder(context.scene.iclnuim)
    if not folder.is_dir():
        raise InputError("a folder", path=folder, found="none yet", hint="Render")
    return folder


def folders_to_view(context: Context) -> list[Path]:
    """The sequences in the output folder, or else its run. Raises InputError if there is neither."""
    out = existing_output(context)
    sequences = [out / name for name in ("clean", "noisy") if (out / name).is_dir()]
    found = sequences or [folder for folder in (out / "raw",) if (folder / "exr").is_dir()]
    if not found:
        raise InputError("rendered frames", path=out, found="none", hint="Render")
    return found


def run_to_resume(context: Context) -> Path:
    """The folder of the run in the output folder. Raises InputError if there is none."""
    raw = output_folder(context.scene.iclnuim) / "raw"
    if not (raw / "sequence.json").is_file():
        hint = "Render, or the {out} that the render was started in"
        raise InputError("a render to resume", path=raw, found="none", hint=hint)
    return raw


def scene_name(settings: PropertyGroup) -> str:
    """The name of the scene in the settings: a built-in name, the path of a file, or OPEN."""
    if settings.scene_source == "FILE" and settings.scene_file:
        return str(Path(bpy.path.abspath(settings.scene_file)).expanduser().resolve())
    return settings.scene_source


def job(context: Context, out: Path) -> RenderJob:
    """The render job of the settings. A scene or trajectory that has no file is written into `out`.

    Raises InputError, WorkError.
    """
    settings = context.scene.iclnuim
    # a missing library is reported before the first frame is rendered
    first_library("EXR", *exr.BACKENDS)
    first_library("PNG", *png.BACKENDS)
    check_free(out / "raw")
    return settings.to_job(_scene_for(settings, out), _trajectory_for(context, settings, out))


def check_free(raw: Path) -> None:
    """Raises WorkError if a running process on this machine renders into the folder."""
    for folder in raw.glob(f".work-{platform.node()}-*"):
        process = int(folder.name.rsplit("-", 1)[1])
        if process != os.getpid() and os.name != "nt" and process_is_running(process):
            text = f"{raw}: another render (process {process}) is running in this folder"
            raise WorkError(text, hint="again when it has finished, or another {out}")


def light_map_line(settings: PropertyGroup) -> str:
    """A sentence for the panel: whether the cache contains the light map of the chosen scene."""
    if settings.scene_source == "OPEN":
        return _OPEN_FILE
    name = scene_name(settings)
    panel = state.current()
    key = (name, settings.map_size, settings.map_samples, settings.seed, settings.reading())
    known = panel.light_map
    if known is None or known[0] != key or time.monotonic() - known[1] > _FRESH_S:
        known = panel.light_map = key, time.monotonic(), _looked_up(settings, name)
    return known[2]


_OPEN_FILE = (
    "Bake Light and Render use the cached light map of the open file, or bake it if there is none"
)
_NO_LIGHT_MAP = (
    "this scene's light map is not in the cache: "
    "Bake Light or the first render bakes it once, which takes minutes"
)


def _looked_up(settings: PropertyGroup, name: str) -> str:
    """A sentence about the light map of the scene `name`."""
    cache = state.cache_folder()
    try:
        found = light_map.find(cache, settings.to_job(name, "kt2"))
    except (IclnuimError, OSError):
        return "no scene file is chosen yet"
    if not found:
        return _NO_LIGHT_MAP
    if cache not in found.parents:
        return "this scene's light map is part of the extension: no bake is needed"
    return "this scene's light map is in the cache"


def _shipped_name(settings: PropertyGroup) -> str:
    scene = settings.scene_source
    if scene not in SCENES:
        scene = next(iter(SCENES))
    return f"{scene}/{settings.trajectory_source}"


def _trajectory_for(context: Context, settings: PropertyGroup, out: Path) -> str:
    """The name of an unchanged built-in trajectory. Any other trajectory is written to a TUM file
    in `out`; its path is returned.

    The name of the file depends on its content, so that no other file is overwritten, nor the
    trajectory of an earlier run.
    """
    plain = settings.scale == 1.0 and not settings.use_start
    if plain and settings.trajectory_source in TRAJECTORIES:
        return _shipped_name(settings)
    poses = trajectory(context).trajectory
    path = out / f"trajectory_{sha256(trajectory_text(poses, 'tum').encode())[:8]}.txt"
    make_folder(out, "another {out}")
    if not path.is_file():
        write_trajectory(path, poses, "tum")
    return str(path)


def check_scene(context: Context) -> None:
    """Raises InputError if no scene is chosen."""
    chosen_scene(context.scene.iclnuim)


def chosen_scene(settings: PropertyGroup) -> str:
    """scene_name() of the chosen scene.

    Raises InputError if a scene file is required and none is chosen.
    """
    if settings.scene_source == "FILE" and not settings.scene_file:
        raise InputError("a scene file", found="none", hint="choosing one under {scene}")
    return scene_name(settings)


def _scene_for(settings: PropertyGroup, out: Path) -> str:
    if (name := chosen_scene(settings)) != "OPEN":
        return name
    path = out / "iclnuim_scene.blend"
    if any((out / "raw").glob("exr/*.exr")):
        expected = "an output folder without frames of an earlier state of the open scene"
        hint = "Resume, which continues with the saved copy of the scene, or another {out}"
        raise InputError(expected, path=out, hint=hint)
    make_folder(out, "another {out}")
    try:
        # not compressed: not every Blender's Python can read that
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=False)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise WorkError(f"{path}: cannot be written: {reason}") from None
    return str(path)
