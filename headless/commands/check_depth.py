"""`iclnuim check-depth DIR`: the depth of a run's frames against rays cast independently at the same geometry."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim.blender import output
from iclnuim.dataset.run_folder import read_run
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.exr import read_exr
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.job import RenderJob

from ..benchmark import depth_check
from ..console import Console
from ..isolation import survived
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of a run, as `iclnuim render` makes it")
    parser.add_argument(
        "--most", type=int, default=20, metavar="N", help="frames to look at, spread over the run; default: 20"
    )
    common(parser, "iclnuim check-depth out/living_room/kt2/raw")


def run(args: argparse.Namespace, console: Console) -> int:
    return survived(lambda: _check(args, console), str(args.folder))


def _check(args: argparse.Namespace, console: Console) -> int:
    frames = read_run(args.folder)
    numbers = frames.frame_numbers()
    if not numbers or args.most < 1:
        raise InputError("a run with at least one frame, and --most of at least 1", path=args.folder)
    picked = sorted(
        {numbers[i] for i in np.linspace(0, len(numbers) - 1, min(args.most, len(numbers))).round().astype(int)}
    )
    poses = read_trajectory(args.folder / "groundtruth.txt", "tum").trajectory.T_world_camera
    caster = depth_check.RayCaster(*_geometry(RenderJob.from_dict(frames.recipe["job"]), frames.recipe, console))
    progress, errors = console.progress(len(picked), "check-depth"), []
    for number in picked:
        errors.append(
            depth_check.compare(read_exr(frames.frame_file(number))["Z"], caster, frames.camera, poses[number])
        )
        progress.advance()
    result = depth_check.summary(errors)
    console.result({"frames": picked, **asdict(result)}, _table(len(picked), result))
    return 0 if result.within_01mm_share >= 0.999 and result.median_m < 1e-5 else 3


def _geometry(job: RenderJob, recipe: dict, console: Console) -> tuple[np.ndarray, np.ndarray]:
    with output.blender_output_in(Path(os.devnull)):
        try:
            from iclnuim.blender import scene, surface
        except ImportError:
            raise WorkError("check-depth needs the bpy package and open3d; try: pip install bpy open3d-cpu") from None
        scene.open_scene(job.scene, job.reading)
        if scene.scene_sha256(job.scene) != recipe["scene_sha256"]:
            console.note(f"note: the scene {job.scene} has changed since these frames were rendered")
        found = surface.triangles()
    console.note(f"{len(found.triangles)} triangles of {len(found.names)} objects")
    return found.vertices, found.triangles


def _table(frames: int, e: depth_check.DepthErrors) -> str:
    return "\n".join(
        (
            f"frames                       {frames}",
            f"pixels                       {e.pixels}",
            f"on an edge (left out)        {e.edge_share:.3%}",
            f"seen by one of the two only  {e.lost_share:.4%}",
            f"|Z error| median             {e.median_m * 1e3:.6f} mm",
            f"|Z error| 99.9 %             {e.p999_m * 1e3:.6f} mm",
            f"|Z error| largest            {e.max_m * 1e3:.6f} mm",
            f"within 0.1 mm                {e.within_01mm_share:.4%}",
        )
    )
