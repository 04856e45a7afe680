"""Options of a run, shared by `render`, `make`, `task` and `resume`, and the plan that they make."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from iclnuim import shipped
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob, read_recipe, shipped_job

from ..farm.run_plan import FarmSettings, RunPlan
from ..farm.slurm_settings import SlurmSettings, read_settings
from ..options import SCENE_KINDS, add_scene_options, add_settings, given_settings, reading_from, renamed, settings_from
from ..sequence_options import add_sensor_options, sequence_options

_OUT = {
    "render": "folder of the run; default: out/SEQUENCE/raw",
    "make": "default: out/SEQUENCE; holds clean/, noisy/ and, meanwhile, raw/",
}


def add_run_options(parser: argparse.ArgumentParser, command: str) -> None:
    """What `render` or `make` is asked for, but for how the work is shared."""
    add = parser.add_argument
    add("sequence", nargs="?", metavar="SEQUENCE", help="kt2, living_room/kt2, office/kt0, or a recipe file (.json)")
    add(
        "--scene",
        metavar="NAME|FILE",
        help=f"another scene: {', '.join(shipped.SCENE_NAMES)}, or a file: {SCENE_KINDS}",
    )
    add("--trajectory", metavar="FILE", help="another trajectory, in any format that `iclnuim trajectory info` reads")
    add_scene_options(parser)
    add("--frames", metavar="A:B:S", help="which frames, as a Python slice (B excluded); default: all")
    add("--quick", action="store_true", help="every 30th frame")
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help="resolution and K; default: 640x480 and the paper's K")
    add_settings(parser, RenderJob)
    add("-o", "--out", type=Path, metavar="DIR", help=_OUT[command])
    if command == "make":
        add_sensor_options(parser, "released", ("depth_units", "formats"))
        add("--keep-raw", action="store_true", help="keep the EXR frames; default: they go once both sequences stand")


def add_farm_options(parser: argparse.ArgumentParser) -> None:
    """How the work is shared: nothing here changes a pixel."""
    add_settings(parser, FarmSettings)
    renamed(parser, "--stuck-after", "--worker-timeout", type=float)
    add = parser.add_argument
    add("--slurm", type=Path, metavar="FILE", help="settings for Slurm in TOML; options take precedence")
    add_settings(parser, SlurmSettings)
    add("--print-only", action="store_true", help="show job scripts and the estimate, submit nothing")


def plan_from(args: argparse.Namespace, command: str) -> RunPlan:
    """What the options ask for. Raises InputError."""
    job = _job(args)
    if args.quick and args.frames:
        raise InputError("{quick} or {frames}, not both")
    frames = args.frames or ("::30" if args.quick else "::")
    numbers = tuple(frame_slice(frames, len(load_trajectory(job))))
    if command == "render":
        return RunPlan(job, args.out or Path("out") / job.sequence / "raw", numbers)
    out = args.out or Path("out") / job.sequence
    return RunPlan(job, out / "raw", numbers, sequence_options(args), args.keep_raw)


def with_farm_options(plan: RunPlan, args: argparse.Namespace) -> RunPlan:
    """The plan with the engine and the settings that options name. Raises InputError."""
    slurm = read_settings(args.slurm) if args.slurm else plan.slurm
    return replace(plan, farm=settings_from(args, plan.farm), slurm=settings_from(args, slurm))


def _job(args: argparse.Namespace) -> RenderJob:
    """Raises InputError for a sequence, scene or camera that is not there."""
    if args.sequence is None and not (args.scene and args.trajectory):
        raise InputError("a SEQUENCE, or {scene} and {trajectory}", hint=", ".join(shipped.sequence_names()))
    files = {name: _full_path(getattr(args, name)) for name in ("scene", "trajectory")}
    if args.sequence is None:
        name = f"{Path(args.scene).stem}/{Path(args.trajectory).stem}"
        job = RenderJob(sequence=name, scene=args.scene, trajectory=args.trajectory)
    else:
        job = read_recipe(args.sequence) if args.sequence.endswith(".json") else shipped_job(args.sequence)
    given: dict[str, Any] = {**files, **given_settings(args, RenderJob)}
    if args.camera:
        given["camera"] = PinholeCamera.parse(args.camera)
    return job.changed(reading=reading_from(args, job.reading), **given)


def _full_path(name: str | None) -> str | None:
    """A file's full path, so that the recipe says which; shipped names stay."""
    if name is None or name in (*shipped.SCENE_NAMES, *shipped.sequence_names()):
        return name
    return str(Path(name).expanduser().resolve())
