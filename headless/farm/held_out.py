"""Held-out views of a run: they are chosen or checked before rendering, then rendered as a separate
run with the same light, in a subfolder.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim import shipped
from iclnuim.blender.open.run_frames import RunFrames
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import make_folder, read_bytes, sha256, write_json
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.held_out import check_held_out, choose_held_out
from iclnuim.sensor.imu import ImuOnCamera
from iclnuim.sequences.record import Record
from iclnuim.sequences.run_folder import load_trajectory, read_run
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory
from iclnuim.version import __version__

from ..isolation import opened_scene, run_isolated
from .chunks import numbers_text
from .run_plan import RunPlan

#: Folder of the separate run, below the output folder.
FOLDER = "held_out"
#: The poses of the views.
POSES = "views.txt"
#: The settings that decide the views, and the figures of every view.
RECORD = "views.json"


def prepare(plan: RunPlan, console: Console) -> None:
    """Write the poses of the plan's held-out views, unless they exist.

    Raises InputError if a view is too close to a training view or shows parts that no training view
    saw, if other views exist, or if the scene moves; WorkError without Blender or embreex.
    """
    if plan.farm.engine != "local":
        expected = "{engine} local with {held_out}"
        later = "when the frames are done, the same command renders the views"
        raise InputError(f"{expected}: {later}")
    record = Record("set of views", plan.out / FOLDER / RECORD, _identity(plan))
    if not record.is_begun():
        run_isolated(partial(_make, plan, record, console), plan.job.scene)


def views_plan(plan: RunPlan) -> RunPlan:
    """The plan for the run of the views, once the training frames exist: with the same light as
    these, no shutter, and no noisy sequence.
    """
    folder = plan.out / FOLDER
    settled = read_run(plan.raw).job
    light = {name: getattr(settled, name) for name in ("light", "samples", "denoise", "map_size")}
    job = replace(
        plan.job,
        sequence=f"{plan.job.sequence}/{FOLDER}",
        trajectory=str((folder / POSES).resolve()),
        exposure_s=0.0,
        readout_s=0.0,
        imu=ImuOnCamera(),
        **light,
    )
    numbers = tuple(range(len(load_trajectory(job))))
    return replace(plan, job=job, raw=folder / "raw", numbers=numbers, held_out="", noisy=False)


def _identity(plan: RunPlan) -> dict[str, Any]:
    """All settings that decide the views."""
    poses = load_trajectory(plan.job).T_world_camera.matrix
    count_or_poses = plan.held_out
    if not count_or_poses.isdecimal():
        count_or_poses = sha256(read_bytes(_file(plan.held_out)))
    return {
        "held_out": count_or_poses,
        "seed": plan.job.seed,
        "scene": Path(plan.job.scene).name,
        "camera": plan.job.camera.to_dict(),
        "training_frames": numbers_text(plan.numbers),
        "training_sha256": sha256(np.ascontiguousarray(poses).tobytes()),
    }


def _file(name: str) -> Path:
    if name in shipped.sequence_names():
        return shipped.trajectory_file(name)
    return Path(name)


def _make(plan: RunPlan, record: Record, console: Console) -> None:
    """Choose or check the views and write them, in a separate process in which Blender opens the
    scene.
    """
    job = plan.job
    whole = load_trajectory(job)
    training = whole.T_world_camera[np.array(plan.numbers)]
    given = [shipped.cache_folder()]
    if not plan.held_out.isdecimal():
        given.append(Path(plan.held_out))
    frames = RunFrames(len(whole), max(plan.numbers), console.note)
    opening = opened_scene(
        "held-out views", job.scene, job.reading, given, [plan.out], frames=frames
    )
    with opening:
        from iclnuim.blender import surfaces
        from iclnuim.blender.open import motion, scene

        if moving := motion.moving_names(scene.bpy.context.scene):
            found = ", ".join(moving[:3])
            raise InputError("a scene without motion, for {held_out}", path=job.scene, found=found)
        surface = surfaces.triangles()
    caster = RayCaster(surface.vertices, surface.triangles)
    if plan.held_out.isdecimal():
        count = int(plan.held_out)
        chosen = choose_held_out(caster, job.camera, training, count, job.seed, console.progress)
        views = Trajectory.at_rate(chosen)
    else:
        views = read_trajectory(_file(plan.held_out)).trajectory
    poses = views.T_world_camera
    figures = check_held_out(caster, job.camera, poses, training, console.progress)
    make_folder(plan.out / FOLDER)
    write_trajectory(plan.out / FOLDER / POSES, views, "tum")
    rows: list[dict[str, float]] = []
    for number, view in enumerate(figures):
        rounded = {name: round(value, 6) for name, value in vars(view).items()}
        rows.append({"view": number, **rounded})
    write_json(record.file, {**record.identity, "version": __version__, "views": rows})
