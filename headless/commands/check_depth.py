"""`iclnuim check-depth DIR`: compares the depth and ground truth of a run's frames with rays cast
independently at the same geometry.
"""

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.blender.open.run_frames import RunFrames
from iclnuim.console import Console
from iclnuim.errors import InputError, within
from iclnuim.formats.exr import read_exr
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.job import RenderJob
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.depth_check import (
    GlassCaster,
    RayDepthErrors,
    TruthCaster,
    TruthErrors,
    compare_depth,
    depth_summary,
    rounding_m,
    truth_summary,
)
from iclnuim.sequences.run_folder import RunFolder, read_run
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..isolation import opened_scene
from ..options import add_settings, common, count, given_settings

#: Guaranteed share of pixels with right depth, and with right ground truth.
_MIN_SHARE = 0.999
#: Guaranteed median error of depth, where a step of float32 is not larger.
_MAX_MEDIAN_M = 1e-5


def configure(parser: ArgumentParser) -> None:
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="folder of a run, as `iclnuim render` writes it"
    )
    frames = "frames to check, spread over the run; default: 20"
    parser.add_argument("--max-frames", type=count, default=20, metavar="N", help=frames)
    add_settings(parser, SceneReading, ["allow_outside"])
    common(parser, "iclnuim check-depth out/living_room/kt2/raw").set_defaults(opens="folder")


def run(args: Namespace, console: Console) -> int:
    frames = read_run(args.folder)
    allowed = given_settings(args, SceneReading, ["allow_outside"])
    frames.job.reading.check_asked(bool(allowed), args.folder)
    numbers = frames.frame_numbers()
    if not numbers:
        hint = "frames of `iclnuim render`, or of `iclnuim make` with --keep-raw"
        raise InputError("a run with at least one frame", path=args.folder, found="none", hint=hint)
    spread = np.linspace(0, len(numbers) - 1, min(args.max_frames, len(numbers)))
    picked = sorted({numbers[i] for i in spread.round().astype(int)})
    poses = read_trajectory(args.folder / "groundtruth.txt", "tum").trajectory.T_world_camera
    casters = _casters(frames, picked, console)
    progress = console.progress(len(picked), "check-depth")
    errors = []
    depths_z_m = []
    truths = []
    for number, (caster, truth_caster) in zip(picked, casters, strict=True):
        channels = read_exr(frames.frame_file(number))
        with within(frames.frame_file(number)):
            errors.append(compare_depth(channels["Z"], caster, frames.camera, poses[number]))
            depths_z_m.append(channels["Z"])
        if truth_caster is not None:
            truths.append(truth_caster.compare(channels, frames.camera, poses[number]))
        progress.advance()
    result = depth_summary(errors, depths_z_m)
    truth = truth_summary(truths) if truths else None
    seen_z_m = np.concatenate([z[z > 0] for z in depths_z_m])
    rounded_m = float(rounding_m(np.median(seen_z_m))) if len(seen_z_m) else 0.0
    failed = _failed(result, truth, max(_MAX_MEDIAN_M, rounded_m))
    figures = asdict(result)
    if truth:
        figures |= asdict(truth)
    for name, value in figures.items():
        if np.isnan(value):
            figures[name] = None  # JSON has no NaN
    values = {"frames": picked, **figures, "failed": failed}
    lines = [_text(len(picked), result, truth), *(f"failed: {text}" for text in failed)]
    console.result(values, "\n".join(lines))
    return 3 if failed else 0


def _failed(e: RayDepthErrors, truth: TruthErrors | None, max_median_m: float) -> list[str]:
    """A sentence for each figure beyond its limit. max_median_m: of the error of depth."""
    shares = [("within 0.1 mm", e.within_01mm_share)]
    if truth:
        shares.append(("equal instances", truth.equal_instance_share))
        shares.append(("normals within 0.1 degrees", truth.normal_within_share))
    failed = []
    for name, share in shares:
        if not share >= _MIN_SHARE:
            limit = f"the limit is {_MIN_SHARE:.1%} or more"
            failed.append(f"{name}: {share:.4%} of the pixels, {limit}")
    if not e.median_m < max_median_m:
        failed.append(
            f"|Z error| median: {e.median_m * 1e3:.6f} mm, the limit is {max_median_m * 1e3:.2g} mm"
        )
    return failed


def _casters(
    frames: RunFolder, picked: list[int], console: Console
) -> list[tuple[RayCaster, TruthCaster | None]]:
    """For each frame, the casters for depth and (if the run has it) ground truth; all frames share
    them unless the scene moves.
    """
    job = frames.job
    run_frames = RunFrames(len(frames.truth()), max(picked), console.note)
    reads = [frames.path, shipped.cache_folder()]
    with opened_scene("check-depth", job.scene, job.reading, reads, frames=run_frames):
        from iclnuim.blender.open import light_choice, motion, scene

        if scene.scene_sha256(job.scene) != frames.recipe["scene_sha256"]:
            console.note(
                f"note: the scene {job.scene} has changed since these frames were rendered"
            )
        opened = scene.bpy.context.scene
        if strands := light_choice.strand_names(opened):
            console.note(
                "note: rays do not hit hair, curves and points "
                f"({', '.join(strands)[:120]}), so pixels on them fail"
            )
        if not motion.moving_names(opened):
            return [_caster(job, console)] * len(picked)
        found = []
        for number in picked:
            opened.frame_set(number)  # as rendering does
            found.append(_caster(job, console))
        return found


def _caster(job: RenderJob, console: Console) -> tuple[RayCaster, TruthCaster | None]:
    """The casters of the open scene in its current state."""
    from iclnuim.blender import surfaces
    from iclnuim.blender.render import model

    found = surfaces.triangles()
    behind = surfaces.triangles(panes=False) if job.glass != "surface" else found
    truth_caster = TruthCaster(model.scene_model(job.light == "path")) if job.ground_truth else None
    console.note(f"{len(found.triangles)} triangles of {len(found.names)} objects")
    caster = RayCaster(found.vertices, found.triangles, found.held_out)
    if behind is not found:
        behind_caster = RayCaster(behind.vertices, behind.triangles, behind.held_out)
        caster = GlassCaster(caster, behind_caster, job.glass == "none")
    return caster, truth_caster


def _text(frames: int, e: RayDepthErrors, truth: TruthErrors | None) -> str:
    rows = [
        ("frames", f"{frames}"),
        ("pixels", f"{e.pixels}"),
        ("on an edge (left out)", f"{e.edge_share:.3%}"),
        ("hit by one of the two only", f"{e.one_sided_share:.4%}"),
        ("|Z error| median", f"{e.median_m * 1e3:.6f} mm"),
        ("|Z error| 99.9 %", f"{e.p999_m * 1e3:.6f} mm"),
        ("|Z error| largest", f"{e.max_m * 1e3:.6f} mm"),
        ("within 0.1 mm", f"{e.within_01mm_share:.4%}"),
    ]
    if truth:
        rows += [
            ("on an outline (left out)", f"{truth.outline_share:.3%}"),
            ("on faces that coincide (left out)", f"{truth.coincident_share:.3%}"),
            ("equal instances", f"{truth.equal_instance_share:.4%}"),
            ("normals, median", f"{truth.normal_median_deg:.6f} degrees"),
            ("normals, 99.9 %", f"{truth.normal_p999_deg:.6f} degrees"),
            ("normals within 0.1 degrees", f"{truth.normal_within_share:.4%}"),
        ]
    return "\n".join(f"{name:<34} {value}" for name, value in rows)
