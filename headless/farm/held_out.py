"""Held-out views of a run: chosen or checked before anything is rendered, then a run of their own, by the same light, in a folder below."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from iclnuim import __version__, shipped
from iclnuim.dataset.run_folder import load_trajectory, read_run, refuse_other
from iclnuim.errors import InputError
from iclnuim.formats.files import make_folder, read_bytes, read_json, sha256, write_json
from iclnuim.formats.trajectories import read_trajectory, write_trajectory
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.job import RenderJob
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.held_out import check_held_out, choose_held_out

from ..isolation import opened_scene, run_isolated
from ..options import Console
from .chunks import numbers_text
from .run_plan import RunPlan

#: Below the output folder: a run of its own, the poses, and what was asked for with the figures of every view.
FOLDER, POSES, RECORD = "held_out", "views.txt", "views.json"


def prepare(plan: RunPlan, console: Console) -> None:
    """The held-out views that a plan asks for, as files; nothing where they stand. Raises InputError where a view is too near a training
    view or shows what none saw, where others stand there, or things move in the scene; WorkError without Blender or embreex.
    """
    if plan.farm.engine != "local":
        raise InputError("{engine} local with {held_out}: when the frames are done, the same command renders the views")
    record, asked = plan.out / FOLDER / RECORD, _asked(plan)
    if record.is_file():
        there = read_json(record)
        refuse_other("set of views", record, {key: there.get(key) for key in asked}, asked, "another {out}")
        return
    run_isolated(partial(_make, plan, asked, console), plan.job.scene)


def views_plan(plan: RunPlan) -> RunPlan:
    """The views' own run, once the training frames stand: the light as it was settled for them, no shutter, exact images alone."""
    folder = plan.out / FOLDER
    settled = RenderJob.from_dict(read_run(plan.raw).recipe["job"])
    light = {name: getattr(settled, name) for name in ("light", "samples", "denoise")}
    poses, sequence = str((folder / POSES).resolve()), f"{plan.job.sequence}/{FOLDER}"
    job = replace(plan.job, sequence=sequence, trajectory=poses, exposure_s=0.0, readout_s=0.0, **light)
    numbers = tuple(range(len(load_trajectory(job))))
    return replace(plan, job=job, raw=folder / "raw", numbers=numbers, held_out="", noisy=False)


def _asked(plan: RunPlan) -> dict:
    """What decides the views."""
    poses = load_trajectory(plan.job).T_world_camera.matrix
    return {
        "held_out": plan.held_out if plan.held_out.isdecimal() else sha256(read_bytes(_file(plan.held_out))),
        "seed": plan.job.seed,
        "scene": Path(plan.job.scene).name,
        "camera": plan.job.camera.to_dict(),
        "training_frames": numbers_text(plan.numbers),
        "training_sha256": sha256(np.ascontiguousarray(poses).tobytes()),
    }


def _file(name: str) -> Path:
    return shipped.trajectory_file(name) if name in shipped.sequence_names() else Path(name)


def _make(plan: RunPlan, asked: dict, console: Console) -> None:
    """In a process of its own, in which Blender opens the scene."""
    job, numbers = plan.job, np.array(plan.numbers)
    with opened_scene("held-out views", job.scene, job.reading):
        from iclnuim.blender import preflight, scene, surfaces

        if moving := preflight.moving_names(scene.bpy.context.scene):
            found = ", ".join(moving[:3])
            raise InputError("a scene in which nothing moves, for {held_out}", path=job.scene, found=found)
        surface = surfaces.triangles()
    caster, training = RayCaster(surface.vertices, surface.triangles), load_trajectory(job).T_world_camera[numbers]
    if plan.held_out.isdecimal():
        count = int(plan.held_out)
        on_view = console.progress(count, "held-out views", "views").advance
        views = Trajectory.at_rate(choose_held_out(caster, job.camera, training, count, job.seed, on_view))
    else:
        views = read_trajectory(_file(plan.held_out)).trajectory
    on_view = console.progress(len(views), "held-out views, checked", "views").advance
    figures = check_held_out(caster, job.camera, views.T_world_camera, training, on_view)
    make_folder(plan.out / FOLDER)
    write_trajectory(plan.out / FOLDER / POSES, views, "tum")
    rows = [{"view": k, **{n: round(v, 6) for n, v in vars(view).items()}} for k, view in enumerate(figures)]
    write_json(plan.out / FOLDER / RECORD, {**asked, "version": __version__, "views": rows})
