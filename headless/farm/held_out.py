"""Held-out views of a run: they are chosen or checked before rendering, then rendered as a separate
run with the same light, in a subfolder.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.dataset.run_folder import load_trajectory, read_run, refuse_other
from iclnuim.errors import InputError
from iclnuim.formats.files import make_folder, read_bytes, read_json, sha256, write_json
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.held_out import check_held_out, choose_held_out
from iclnuim.version import __version__

from ..isolation import opened_scene, run_isolated
from .chunks import numbers_text
from .run_plan import RunPlan

#: Folder of the separate run below the output folder, file of its poses, and record of its settings
#: with the figures of every view.
FOLDER, POSES, RECORD = "held_out", "views.txt", "views.json"


def prepare(plan: RunPlan, console: Console) -> None:
    """Write the poses of the plan's held-out views, unless they exist. Raises InputError if a view
    is too close to a training view or shows
    parts that no training view saw, if other views exist, or if the scene moves; WorkError without
    Blender or embreex.
    """
    if plan.farm.engine != "local":
        raise InputError(
            "{engine} local with {held_out}: when the frames are done, the same command renders the views"
        )
    record, requested = plan.out / FOLDER / RECORD, _identity(plan)
    if record.is_file():
        existing = read_json(record)
        refuse_other(
            "set of views",
            record,
            {key: existing.get(key) for key in requested},
            requested,
            "another {out}",
        )
        return
    run_isolated(partial(_make, plan, requested, console), plan.job.scene)


def views_plan(plan: RunPlan) -> RunPlan:
    """The plan for the run of the views, once the training frames exist: with the same light as
    these, no shutter, and no noisy sequence.
    """
    folder = plan.out / FOLDER
    settled = read_run(plan.raw).job
    light = {name: getattr(settled, name) for name in ("light", "samples", "denoise")}
    poses, sequence = str((folder / POSES).resolve()), f"{plan.job.sequence}/{FOLDER}"
    job = replace(
        plan.job, sequence=sequence, trajectory=poses, exposure_s=0.0, readout_s=0.0, **light
    )
    numbers = tuple(range(len(load_trajectory(job))))
    return replace(plan, job=job, raw=folder / "raw", numbers=numbers, held_out="", noisy=False)


def _identity(plan: RunPlan) -> dict:
    """All settings that decide the views."""
    poses = load_trajectory(plan.job).T_world_camera.matrix
    return {
        "held_out": plan.held_out
        if plan.held_out.isdecimal()
        else sha256(read_bytes(_file(plan.held_out))),
        "seed": plan.job.seed,
        "scene": Path(plan.job.scene).name,
        "camera": plan.job.camera.to_dict(),
        "training_frames": numbers_text(plan.numbers),
        "training_sha256": sha256(np.ascontiguousarray(poses).tobytes()),
    }


def _file(name: str) -> Path:
    return shipped.trajectory_file(name) if name in shipped.sequence_names() else Path(name)


def _make(plan: RunPlan, identity: dict, console: Console) -> None:
    """Choose or check the views and write them, in a separate process in which Blender opens the
    scene.
    """
    job, numbers = plan.job, np.array(plan.numbers)
    with opened_scene("held-out views", job.scene, job.reading):
        from iclnuim.blender import surfaces
        from iclnuim.blender.open import preflight, scene

        if moving := preflight.moving_names(scene.bpy.context.scene):
            found = ", ".join(moving[:3])
            raise InputError("a scene without motion, for {held_out}", path=job.scene, found=found)
        surface = surfaces.triangles()
    caster, training = (
        RayCaster(surface.vertices, surface.triangles),
        load_trajectory(job).T_world_camera[numbers],
    )
    if plan.held_out.isdecimal():
        count = int(plan.held_out)
        on_view = console.progress(count, "held-out views", "views").advance
        views = Trajectory.at_rate(
            choose_held_out(caster, job.camera, training, count, job.seed, on_view)
        )
    else:
        views = read_trajectory(_file(plan.held_out)).trajectory
    on_view = console.progress(len(views), "held-out views, checked", "views").advance
    figures = check_held_out(caster, job.camera, views.T_world_camera, training, on_view)
    make_folder(plan.out / FOLDER)
    write_trajectory(plan.out / FOLDER / POSES, views, "tum")
    rows = [
        {"view": k, **{n: round(v, 6) for n, v in vars(view).items()}}
        for k, view in enumerate(figures)
    ]
    write_json(plan.out / FOLDER / RECORD, {**identity, "version": __version__, "views": rows})
