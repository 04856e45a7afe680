"""`iclnuim make`, `render`, `resume` and `task`: turn the options into a plan, and execute the plan
on this machine or on Slurm.
"""

import os
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob, read_recipe, shipped_job
from iclnuim.sequences.bags.recorded import LogSettings
from iclnuim.sequences.run_folder import load_trajectory

from .. import options
from ..farm import tasks
from ..farm.all_sequences import lacking, make_all
from ..farm.chunks import numbers_from, own_cores
from ..farm.estimate import local_estimate
from ..farm.execution import execute, refuse_print_only
from ..farm.farm_settings import FarmSettings, SlurmSettings, read_settings
from ..farm.rendering import stop_on_signals
from ..farm.run_plan import RunPlan, find_run, read_plan
from ..outputs import refuse_existing
from ..planned_work import PlannedWork, add_dry_run, told
from ..sequence_options import add_sensor_options, log_settings, sequence_options

#: Two seconds of consecutive frames: enough for odometers, fusion and errors over one second. They
#: are the first frames, so that stamps begin at 1 s.
QUICK_FRAMES = ":60"
_STAGES = {
    "simulations": "first: write the run folder, and bake the simulations of a .blend that has any",
    "light": "then: write the run folder with its recipe, and bake the light into the cache",
    "frames": "then: render those of the given frames that are missing",
    "dataset": "last: write the clean and the noisy sequence of all frames",
}


def configure_make(parser: ArgumentParser) -> None:
    out = (
        "folder for clean/, noisy/ and, while frames are rendered, raw/; "
        "default: out/SEQUENCE (with `all`: out)"
    )
    add_run_options(parser, "make", out)
    views = (
        "also render novel views into held_out/: 0.5 m or 20 degrees away from all other views, "
        "of what these saw; their number, or their trajectory"
    )
    parser.add_argument("--held-out", metavar="N|TRAJECTORY", help=views)
    add_dry_run(parser)
    _add_farm_options(parser, "iclnuim make kt2 --quick", _begin)


def configure_render(parser: ArgumentParser) -> None:
    add_run_options(parser, "render", "folder of the run; default: out/SEQUENCE/raw")
    blend = "also save the scene with the animated camera, to play it in Blender"
    parser.add_argument("--blend", type=Path, metavar="FILE", help=blend)
    add_dry_run(parser)
    _add_farm_options(parser, "iclnuim render kt2 --quick", _begin)


def configure_resume(parser: ArgumentParser) -> None:
    help = "output folder of `iclnuim render` or `make`"
    parser.add_argument("folder", type=Path, metavar="DIR", help=help)
    options.add_settings(parser, SceneReading, ["allow_outside"])
    _add_farm_options(parser, "iclnuim resume out/living_room/kt2", _resume)


def configure_task(parser: ArgumentParser) -> None:
    actions = options.subcommands(parser, "STAGE")
    for stage, help in _STAGES.items():
        example = f"iclnuim task {stage} kt2 --out out/kt2"
        if stage == "frames":
            example += " --numbers 0-24,30"
        one = options.action(actions, stage, help, example, _task, json=False)
        out = "folder that all tasks of the run share, for clean/, noisy/ and raw/"
        add_run_options(one, "make", out)
        which = "numbers of the frames, both ends included; default: those of --frames"
        one.add_argument("--numbers", metavar="A-B,C", help=which)
        farm = "print progress in lines that this render farm reads"
        one.add_argument("--progress", choices=("flamenco",), help=farm)


def add_run_options(parser: ArgumentParser, command: str, out: str) -> None:
    """Add the options of `render` or `make`, except those that distribute the work.

    `out`: the help text of --out.
    """
    parser.set_defaults(command=command)
    add = parser.add_argument
    known = "kt2, living_room/kt2, office/kt0, or a recipe file (.json)"
    if command == "make":
        known += ", or all for all eight"
    add("sequence", nargs="?", metavar="SEQUENCE", help=known)
    names = ", ".join(shipped.SCENE_NAMES)
    help = f"use another scene: {names}, or a file: {options.SCENE_KINDS}"
    add("--scene", metavar="NAME|FILE", help=help)
    help = "use another trajectory, in any format that `iclnuim trajectory info` reads"
    add("--trajectory", metavar="FILE", help=help)
    options.add_scene_options(parser)
    add("--frames", metavar="A:B:S", help=options.FRAMES)
    help = "only the first 60 frames (two seconds): enough for all further commands"
    add("--quick", action="store_true", help=help)
    help = "resolution and K; default: 640x480 and the paper's K"
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help=help)
    options.add_settings(parser, RenderJob, light="baked, or auto for a file")
    add("-o", "--out", type=Path, metavar="DIR", help=out)
    if command == "make":
        add_sensor_options(parser, "released", ("depth_units", "formats", "names"))
        options.add_settings(parser, LogSettings)
        help = "keep the EXR frames; default: remove them once both sequences are complete"
        add("--keep-raw", action="store_true", help=help)


def _add_farm_options(parser: ArgumentParser, example: str, run: Callable) -> None:
    """Add the options that distribute the work; none of them changes a pixel."""
    options.add_settings(parser, FarmSettings)
    add = parser.add_argument
    help = "settings for Slurm in TOML; options take precedence"
    add("--slurm", type=Path, metavar="FILE", help=help)
    options.add_settings(parser, SlurmSettings)
    help = "show the job scripts and the estimate; submit nothing"
    add("--print-only", action="store_true", help=help)
    options.common(parser, example)
    parser.set_defaults(run=run)


def plan_from(args: Namespace) -> RunPlan:
    """The plan given by the options. Raises InputError."""
    return _plan(args, args.sequence, args.out)


def every_plan(args: Namespace) -> list[RunPlan]:
    """The plans of `make all`, each with a folder ROOM/KT below --out. Raises InputError."""
    if args.scene or args.trajectory:
        raise InputError("all without {scene} and {trajectory}, as it makes the built-in sequences")
    out = args.out or Path("out")
    return [_plan(args, name, out / name) for name in shipped.paper_sequences()]


def _plan(args: Namespace, sequence: str | None, out: Path | None) -> RunPlan:
    job = _job(args, sequence)
    if args.quick and args.frames:
        raise InputError("{quick} or {frames}, not both")
    frames = args.frames or (QUICK_FRAMES if args.quick else "::")
    numbers = tuple(frame_slice(frames, len(load_trajectory(job))))
    folder = out or Path("out") / job.sequence
    if args.command == "render":
        return _with_farm_options(RunPlan(job, out or folder / "raw", numbers), args)
    plan = RunPlan(
        job,
        folder / "raw",
        numbers,
        sequence_options(args),
        args.keep_raw,
        logs=log_settings(args),
        held_out=_held_out(getattr(args, "held_out", None) or "", job),
    )
    return _with_farm_options(plan, args)


def _with_farm_options(plan: RunPlan, args: Namespace) -> RunPlan:
    """The plan with the engine and the settings given by the options. Raises InputError."""
    file = getattr(args, "slurm", None)
    slurm = read_settings(file) if file else plan.slurm
    return replace(
        plan, farm=options.settings_from(args, plan.farm), slurm=options.settings_from(args, slurm)
    )


def _job(args: Namespace, sequence: str | None) -> RenderJob:
    """The render job given by the options.

    Raises InputError for an unknown sequence, scene or camera.
    """
    given = options.given_settings(args, RenderJob)
    for name in ("scene", "trajectory"):
        file = given[name] = getattr(args, name)
        if file is not None and file not in (*shipped.SCENE_NAMES, *shipped.sequence_names()):
            # absolute, so that the recipe identifies the file
            given[name] = str(Path(file).expanduser().resolve())
    if args.camera:
        given["camera"] = PinholeCamera.parse(args.camera)
    is_recipe = sequence is not None and sequence.endswith(".json")
    if not is_recipe and not {"map_size", "map_samples"} & given.keys():
        given.setdefault("light", "auto")
    job = _sequence_job(sequence, args)
    _check_asked(job, args, sequence or "")
    return job.changed(reading=options.settings_from(args, job.reading), **given)


def _sequence_job(sequence: str | None, args: Namespace) -> RenderJob:
    """The job of a recipe, of a shipped sequence, or of a scene and a trajectory."""
    if sequence is not None:
        return read_recipe(sequence) if sequence.endswith(".json") else shipped_job(sequence)
    if not (args.scene and args.trajectory):
        expected = "a SEQUENCE, or {scene} and {trajectory}"
        raise InputError(expected, hint=", ".join(shipped.sequence_names()))
    name = f"{Path(args.scene).stem}/{Path(args.trajectory).stem}"
    return RenderJob(sequence=name, scene=args.scene, trajectory=args.trajectory)


def _check_asked(job: RenderJob, args: Namespace, file: str | Path) -> None:
    """Raises InputError if a recipe, but no option, lets the scene read files outside."""
    allowed = options.given_settings(args, SceneReading, ["allow_outside"])
    job.reading.check_asked(bool(allowed), file)


def _held_out(name: str, job: RenderJob) -> str:
    """The number of views, the full name of a shipped trajectory, or the absolute path of a file.

    Raises InputError.
    """
    if name.isdecimal() and int(name) < 1:
        expected = "a number of views of at least 1, or a trajectory"
        raise InputError(expected, setting="held_out", found=name)
    if not name or name.isdecimal():
        return name
    own = name if "/" in name else f"{job.scene}/{name}"
    if own in shipped.sequence_names():
        return own
    return str(Path(name).expanduser().resolve())


def _begin(args: Namespace, console: Console) -> int:
    if args.command == "make" and args.sequence == "all":
        plans = every_plan(args)
        refuse_print_only(plans[0], args.print_only)
        if told(_work(plans), args, console):
            return 0
        return make_all(plans, partial(execute, print_only=args.print_only), console)
    plan = plan_from(args)
    if plan.farm.engine == "local" and told(_work([plan]), args, console):
        return 0
    blend = _new_blend(getattr(args, "blend", None), plan, console)
    return execute(plan, console, args.print_only or args.dry_run, blend)


def _work(plans: list[RunPlan]) -> PlannedWork:
    """The missing frames of runs on this machine, one after another. A raw frame is removed once
    all sequences of its run have it, unless it is kept.
    """
    cores = len(own_cores())
    missing = 0
    minutes = 0.0
    gigabytes = 0.0
    for plan in plans:
        if frames := lacking(plan):
            missing += frames
            minutes += local_estimate(plan, frames, cores).wall_minutes
            raw_stays = plan.keep_raw or plan.sequences is None
            gigabytes += local_estimate(plan, frames * raw_stays, cores).gigabytes
    where = f"{len(plans)} sequences"
    if len(plans) == 1:
        where = f"{plans[0].job.sequence}, in {plans[0].out}"
    total = sum(len(plan.numbers) for plan in plans)
    what = f"{missing} of {total} frames to render on {cores} cores, {where}"
    return PlannedWork(what, 60 * minutes, gigabytes)


def _new_blend(blend: Path | None, plan: RunPlan, console: Console) -> Path | None:
    """The file to save the scene in.

    One that exists is kept, with a note, if the run has begun; otherwise raises InputError.
    """
    if blend is None or not os.path.lexists(blend):
        return blend
    if blend.is_dir() or not (plan.raw / "sequence.json").is_file():
        refuse_existing(blend, "another name for {blend}")
    if plan.farm.engine != "local":
        return blend  # which is refused
    hint = "give another name to save the scene again"
    console.note(f"{blend} exists already and is not changed; {hint}")
    return None


def _resume(args: Namespace, console: Console) -> int:
    """Execute the recorded plan of the folder again; finished work is skipped."""
    plan = _with_farm_options(read_plan(find_run(args.folder)), args)
    _check_asked(plan.job, args, args.folder)
    console.note(f"resuming: iclnuim {plan.command} {plan.job.sequence}")
    if plan.farm.engine == "local":
        told(_work([plan]), args, console)
    return execute(plan, console, args.print_only)


def _task(args: Namespace, console: Console) -> int:
    """Run one task of a render farm, as called by a scheduler.

    Tasks on many machines may share a folder.
    """
    if args.out is None:
        raise InputError("a folder that all tasks of the run share", setting="out")
    plan = plan_from(args)
    if args.numbers is not None:
        numbers = numbers_from(args.numbers)
        planned = plan.numbers
        if not set(numbers) <= set(planned):
            expected = f"some of the {len(planned)} frames {planned[0]}..{planned[-1]}"
            raise InputError(expected, setting="numbers", found=args.numbers)
        plan = replace(plan, numbers=numbers)
    if args.progress == "flamenco":
        on_frame = _flamenco(args.action, console, plan)
    else:
        progress = console.progress(len(plan.numbers), plan.job.sequence)

        def on_frame(number: int) -> None:
            progress.advance()

    if args.action == "dataset":
        return tasks.run(args.action, plan, console, on_frame)
    with stop_on_signals() as stopped:
        return tasks.run(args.action, plan, console, on_frame, stopped)


def _flamenco(stage: str, console: Console, plan: RunPlan) -> Callable[[int], None]:
    """Returns a callback that prints the lines which Flamenco's worker parses, as Blender prints
    them: `Time:` and `skipping` count as a step, `Saved:` names a picture to show.
    """
    images = plan.out / "clean/rgb"
    last_s = time.monotonic()

    def on_frame(number: int) -> None:
        nonlocal last_s
        seconds = time.monotonic() - last_s
        last_s += seconds
        console.result({}, f"Time: {int(seconds // 60):02}:{seconds % 60:05.2f} (frame {number})")
        image = images / f"{number:06}.png"
        if stage == "dataset" and image.is_file():  # only in the format tum
            console.result({}, f"Saved: '{image}'")

    if stage == "frames":
        for number in sorted(set(plan.numbers).difference(plan.missing())):
            console.result({}, f"skipping existing frame {number}")
    return on_frame
