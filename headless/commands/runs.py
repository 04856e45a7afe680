"""`iclnuim make`, `render`, `resume` and `task`: turn the options into a plan, and execute the plan
on this machine or on Slurm.
"""

import argparse
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.dataset.bags_and_logs import LogSettings
from iclnuim.dataset.run_folder import load_trajectory, trajectory_file
from iclnuim.errors import InputError
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob, read_recipe, shipped_job

from .. import options
from ..farm import held_out, slurm, tasks
from ..farm.all_sequences import make_all
from ..farm.chunks import numbers_from, own_cores
from ..farm.farm_settings import FarmSettings, SlurmSettings, read_settings
from ..farm.rendering import open_run, report, stop_on_signals
from ..farm.run_plan import RunPlan, find_run, read_plan
from ..outputs import refuse_existing
from ..sequence_options import add_sensor_options, log_settings, sequence_options

#: Two seconds of consecutive frames: enough for odometers, fusion and errors over one second. They
#: are the first frames, so that stamps begin at 1 s.
QUICK_FRAMES = ":60"
_STAGES = {
    "light": "first: write the run folder with its recipe, and bake the light into the cache",
    "frames": "then: render those of the given frames that are missing",
    "dataset": "last: write the clean and the noisy sequence of all frames",
}


def configure_make(parser: argparse.ArgumentParser) -> None:
    out = "folder for clean/, noisy/ and, while frames are rendered, raw/; default: out/SEQUENCE (with `all`: out)"
    add_run_options(parser, "make", out)
    views = (
        "also render novel views into held_out/: 0.5 m or 20 degrees away from all other views, of what these saw; "
        "their number, or their trajectory"
    )
    parser.add_argument("--held-out", metavar="N|TRAJECTORY", help=views)
    _add_farm_options(parser, "iclnuim make kt2 --quick", _begin)


def configure_render(parser: argparse.ArgumentParser) -> None:
    add_run_options(parser, "render", "folder of the run; default: out/SEQUENCE/raw")
    blend = "also save the scene with the animated camera, to play it in Blender"
    parser.add_argument("--blend", type=Path, metavar="FILE", help=blend)
    _add_farm_options(parser, "iclnuim render kt2 --quick", _begin)


def configure_resume(parser: argparse.ArgumentParser) -> None:
    help = "output folder of `iclnuim render` or `make`"
    parser.add_argument("folder", type=Path, metavar="DIR", help=help)
    _add_farm_options(parser, "iclnuim resume out/living_room/kt2", _resume)


def configure_task(parser: argparse.ArgumentParser) -> None:
    actions = options.subcommands(parser, "STAGE")
    for stage, help in _STAGES.items():
        numbers = " --numbers 0-24,30" if stage == "frames" else ""
        one = options.action(
            actions,
            stage,
            help,
            f"iclnuim task {stage} kt2 --out out/kt2{numbers}",
            _task,
            json=False,
        )
        add_run_options(
            one, "make", "folder that all tasks of the run share, for clean/, noisy/ and raw/"
        )
        which = "numbers of the frames, both ends included; default: those of --frames"
        one.add_argument("--numbers", metavar="A-B,C", help=which)
        farm = "print progress in lines that this render farm reads"
        one.add_argument("--progress", choices=("flamenco",), help=farm)


def add_run_options(parser: argparse.ArgumentParser, command: str, out: str) -> None:
    """Add the options of `render` or `make`, except those that distribute the work.

    `out`: the help text of --out.
    """
    parser.set_defaults(command=command)
    add, names = parser.add_argument, ", ".join(shipped.SCENE_NAMES)
    every = ", or all for all eight" if command == "make" else ""
    known = f"kt2, living_room/kt2, office/kt0, or a recipe file (.json){every}"
    add("sequence", nargs="?", metavar="SEQUENCE", help=known)
    add(
        "--scene",
        metavar="NAME|FILE",
        help=f"use another scene: {names}, or a file: {options.SCENE_KINDS}",
    )
    help = "use another trajectory, in any format that `iclnuim trajectory info` reads"
    add("--trajectory", metavar="FILE", help=help)
    options.add_scene_options(parser)
    add(
        "--frames",
        metavar="A:B:S",
        help="only these frames, as a Python slice (B excluded); default: all",
    )
    help = "only the first 60 frames (two seconds): enough for all further commands"
    add("--quick", action="store_true", help=help)
    add(
        "--camera",
        metavar="WxH[,FX,FY,CX,CY]",
        help="resolution and K; default: 640x480 and the paper's K",
    )
    options.add_settings(parser, RenderJob, light="baked, or auto for a file")
    add("-o", "--out", type=Path, metavar="DIR", help=out)
    if command == "make":
        add_sensor_options(parser, "released", ("depth_units", "formats"))
        options.add_settings(parser, LogSettings)
        add(
            "--keep-raw",
            action="store_true",
            help="keep the EXR frames; default: remove them once both sequences are complete",
        )


def _add_farm_options(parser: argparse.ArgumentParser, example: str, run: Callable) -> None:
    """Add the options that distribute the work; none of them changes a pixel."""
    options.add_settings(parser, FarmSettings)
    add = parser.add_argument
    add(
        "--slurm",
        type=Path,
        metavar="FILE",
        help="settings for Slurm in TOML; options take precedence",
    )
    options.add_settings(parser, SlurmSettings)
    add(
        "--print-only",
        action="store_true",
        help="show the job scripts and the estimate; submit nothing",
    )
    options.common(parser, example)
    parser.set_defaults(run=run)


def plan_from(args: argparse.Namespace) -> RunPlan:
    """The plan given by the options. Raises InputError."""
    job = _job(args)
    if args.quick and args.frames:
        raise InputError("{quick} or {frames}, not both")
    frames = args.frames or (QUICK_FRAMES if args.quick else "::")
    numbers = tuple(frame_slice(frames, len(load_trajectory(job))))
    out = args.out or Path("out") / job.sequence
    if args.command == "render":
        return RunPlan(job, args.out or out / "raw", numbers)
    logs = log_settings(args)
    views = _held_out(getattr(args, "held_out", None) or "", job)
    return RunPlan(
        job, out / "raw", numbers, sequence_options(args), args.keep_raw, logs=logs, held_out=views
    )


def _held_out(name: str, job: RenderJob) -> str:
    """The number of views, the full name of a shipped trajectory, or the absolute path of a file.

    Raises InputError.
    """
    if name.isdecimal() and int(name) < 1:
        raise InputError(
            "a number of views of at least 1, or a trajectory", setting="held_out", found=name
        )
    if not name or name.isdecimal():
        return name
    own = name if "/" in name else f"{job.scene}/{name}"
    return own if own in shipped.sequence_names() else str(Path(name).expanduser().resolve())


def every_plan(args: argparse.Namespace) -> list[RunPlan]:
    """The plans of `make all`, each with a folder ROOM/KT below --out. Raises InputError."""
    if args.scene or args.trajectory:
        raise InputError("all without {scene} and {trajectory}, as it makes the built-in sequences")
    every = [
        {"sequence": name, "out": (args.out or Path("out")) / name}
        for name in shipped.paper_sequences()
    ]
    each = [argparse.Namespace(**{**vars(args), **one}) for one in every]
    return [with_farm_options(plan_from(one), one) for one in each]


def _job(args: argparse.Namespace) -> RenderJob:
    """The render job given by the options.

    Raises InputError for an unknown sequence, scene or camera.
    """
    if args.sequence is None and not (args.scene and args.trajectory):
        raise InputError(
            "a SEQUENCE, or {scene} and {trajectory}", hint=", ".join(shipped.sequence_names())
        )
    given: dict[str, Any] = options.given_settings(args, RenderJob)
    for name in ("scene", "trajectory"):
        file = given[name] = getattr(args, name)
        if file is not None and file not in (*shipped.SCENE_NAMES, *shipped.sequence_names()):
            given[name] = str(
                Path(file).expanduser().resolve()
            )  # so that the recipe identifies the file
    if args.sequence is None:
        name = f"{Path(args.scene).stem}/{Path(args.trajectory).stem}"
        job = RenderJob(sequence=name, scene=args.scene, trajectory=args.trajectory)
    else:
        job = (
            read_recipe(args.sequence)
            if args.sequence.endswith(".json")
            else shipped_job(args.sequence)
        )
    if (
        args.scene
        and not (args.sequence or "").endswith(".json")
        and not {"map_size", "map_samples"} & given.keys()
    ):
        given.setdefault("light", "auto")
    if args.camera:
        given["camera"] = PinholeCamera.parse(args.camera)
    return job.changed(reading=options.settings_from(args, job.reading), **given)


def with_farm_options(plan: RunPlan, args: argparse.Namespace) -> RunPlan:
    """The plan with the engine and the settings given by the options. Raises InputError."""
    slurm = read_settings(args.slurm) if args.slurm else plan.slurm
    return replace(
        plan, farm=options.settings_from(args, plan.farm), slurm=options.settings_from(args, slurm)
    )


def _begin(args: argparse.Namespace, console: Console) -> int:
    if args.command == "make" and args.sequence == "all":
        plans = every_plan(args)
        _check_print_only(plans[0], args.print_only)
        return make_all(
            plans, lambda plan, whole: _execute(plan, whole, args.print_only, None), console
        )
    plan = with_farm_options(plan_from(args), args)
    return _execute(
        plan, console, args.print_only, _new_blend(getattr(args, "blend", None), plan, console)
    )


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
    console.note(
        f"{blend} exists already and is not changed; give another name to save the scene again"
    )
    return None


def _resume(args: argparse.Namespace, console: Console) -> int:
    """Execute the recorded plan of the folder again; finished work is skipped."""
    plan = with_farm_options(read_plan(find_run(args.folder)), args)
    console.note(f"resuming: iclnuim {plan.command} {plan.job.sequence}")
    return _execute(plan, console, args.print_only, None)


def _execute(plan: RunPlan, console: Console, print_only: bool, blend: Path | None) -> int:
    """Execute the missing parts of the plan, then those of its held-out views; returns the exit
    code. Raises InputError, WorkError.
    """
    read_as = read_trajectory(trajectory_file(plan.job)).read_as
    if read_as.repeated:
        console.note(f"{plan.job.trajectory}: {read_as.sentence}")
    if not plan.held_out:
        return _run(plan, console, print_only, blend)
    held_out.prepare(plan, console)
    return _run(plan, console, print_only, blend) or _run(
        held_out.views_plan(plan), console, print_only, None
    )


def _check_print_only(plan: RunPlan, print_only: bool) -> None:
    """Raises InputError if job scripts are requested of another engine than Slurm."""
    if print_only and plan.farm.engine != "slurm":
        raise InputError("{print_only} with {engine} slurm", found=f"{plan.farm.engine}")


def _run(plan: RunPlan, console: Console, print_only: bool, blend: Path | None) -> int:
    """Execute the missing parts of the plan; returns the exit code. Raises InputError, WorkError.

    print_only: show the job scripts for Slurm instead. blend: also save the prepared scene to this
    file.
    """
    _check_print_only(plan, print_only)
    plan.variants()  # raises for unknown noise models before any work begins
    if plan.farm.engine == "slurm":
        if blend is not None:
            raise InputError("{blend} only on this machine", hint="{engine} local")
        return slurm.run(plan, print_only, console)
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_signals())
        stage = (
            stack.enter_context(tasks.SequenceStage(plan, len(own_cores())))
            if plan.sequences
            else None
        )
        run = stack.enter_context(open_run(plan, console, stopped))
        if not plan.has_record():
            plan.write_record()
        if stage is not None:
            stage.begin(run.run)
        plan.write_record()  # that of an accepted command
        if stage is None:
            return report(run.render(plan.numbers, blend=blend), console)
        try:  # sequence frames are written from finished frames while others are being rendered
            missing = stage.add_finished(plan.numbers)
            outcome = run.render(missing, stage.add, lambda: stopped() or stage.broken)
        finally:
            stage.close()
        code = report(outcome, console)
        if code == 0:
            stage.complete(console.note)
            console.note(
                f"{' and '.join(map(str, plan.variants()))}: all {len(plan.numbers)} requested frames are complete"
            )
        return code


def _task(args: argparse.Namespace, console: Console) -> int:
    """Run one task of a render farm, as called by a scheduler.

    Tasks on many machines may share a folder.
    """
    if args.out is None:
        raise InputError("a folder that all tasks of the run share", setting="out")
    plan = plan_from(args)
    if args.numbers is not None:
        numbers, planned = numbers_from(args.numbers), plan.numbers
        if not set(numbers) <= set(planned):
            expected = f"some of the {len(planned)} frames {planned[0]}..{planned[-1]}"
            raise InputError(expected, setting="numbers", found=args.numbers)
        plan = replace(plan, numbers=numbers)
    progress = console.progress(len(plan.numbers), plan.job.sequence)
    on_frame = (
        _flamenco(args.action, console, plan)
        if args.progress == "flamenco"
        else lambda number: progress.advance()
    )
    if args.action == "dataset":
        return tasks.run(args.action, plan, console, on_frame)
    with stop_on_signals() as stopped:
        return tasks.run(args.action, plan, console, on_frame, stopped)


def _flamenco(stage: str, console: Console, plan: RunPlan) -> Callable[[int], None]:
    """Returns a callback that prints the lines which Flamenco's worker parses, as Blender prints
    them: `Time:` and `skipping` count as a step, `Saved:` names a picture to show.
    """
    last, images = time.monotonic(), plan.out / "clean/rgb"

    def on_frame(number: int) -> None:
        nonlocal last
        seconds, last = time.monotonic() - last, time.monotonic()
        console.result({}, f"Time: {int(seconds // 60):02}:{seconds % 60:05.2f} (frame {number})")
        image = images / f"{number:06}.png"
        if stage == "dataset" and image.is_file():  # only in the format tum
            console.result({}, f"Saved: '{image}'")

    if stage == "frames":
        for number in sorted(set(plan.numbers).difference(plan.missing())):
            console.result({}, f"skipping existing frame {number}")
    return on_frame
