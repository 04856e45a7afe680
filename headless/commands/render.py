"""`iclnuim render`: EXR frames with RGB and exact depth, by worker processes on all cores."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from iclnuim import job as jobs
from iclnuim import shipped
from iclnuim import worker_events as events
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import frame_slice

from ..console import Console
from ..farm import record, rendering, slurm_command, slurm_settings
from ..farm.local import Care
from ..farm.tasks import RunPlan
from ..options import add_settings, common, given_settings
from ..scene_options import KINDS, add_scene_options, reading_from


def configure(parser: argparse.ArgumentParser) -> None:
    add_job_options(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="folder of the run; default: out/SEQUENCE/raw")
    parser.add_argument(
        "--blend", type=Path, metavar="FILE", help="also save the scene with the keyed camera, to play in Blender"
    )
    add_farm_options(parser)
    common(parser, "iclnuim render kt2 --quick")


def add_farm_options(parser: argparse.ArgumentParser) -> None:
    """How the work is shared: nothing here changes a pixel."""
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes that render, two cores or more for each; default: all cores, two each",
    )
    parser.add_argument(
        "--stuck-after",
        type=float,
        metavar="S",
        help="seconds without any sign of life until a worker is replaced; default: 120",
    )
    slurm_settings.add_options(parser)


def add_job_options(parser: argparse.ArgumentParser) -> None:
    """What is rendered, and how: shared with `iclnuim make`."""
    parser.add_argument(
        "sequence", nargs="?", metavar="SEQUENCE", help="kt2, living_room/kt2, office/kt0, or a recipe file (.json)"
    )
    parser.add_argument("--scene", metavar="NAME|FILE", help=f"another scene: living_room, office, or a file: {KINDS}")
    parser.add_argument(
        "--trajectory", metavar="FILE", help="another trajectory, in any format that `iclnuim trajectory info` reads"
    )
    add_scene_options(parser)
    parser.add_argument("--frames", metavar="A:B:S", help="which frames, as a Python slice (B excluded); default: all")
    parser.add_argument("--quick", action="store_true", help="every 30th frame")
    parser.add_argument(
        "--camera", metavar="WxH[,FX,FY,CX,CY]", help="resolution and K; default: 640x480 and the paper's K"
    )
    add_settings(parser, jobs.RenderJob)


def run(args: argparse.Namespace, console: Console) -> int:
    if slurm_command.asked(args):
        return slurm_command.run("render", plan(args), args, console)
    job, out, frames = job_from(args), args.out, frames_from(args)
    out = out or Path("out") / job.sequence / "raw"
    if args.blend is not None:
        finished = render_here(usable_here(job, args, console), out, frames, console, args.blend)
        return 0 if finished else 130
    numbers = frame_slice(frames, len(load_trajectory(job)))
    with (
        stop_on_signals() as stopped,
        rendering.taken_up(job, out, console, stopped, args.workers, care_from(args)) as held,
    ):
        record.write(record.of("render", args), out)
        return rendering.report(held.render(numbers), console)


def plan(args: argparse.Namespace) -> RunPlan:
    """What the options ask for, for tasks on other machines. Raises InputError."""
    if args.blend is not None:
        raise InputError("--blend on this machine alone", hint="--engine local")
    job = job_from(args)
    numbers = tuple(frame_slice(frames_from(args), len(load_trajectory(job))))
    return RunPlan(job, args.out or Path("out") / job.sequence / "raw", numbers)


def care_from(args: argparse.Namespace) -> Care:
    """How long a worker may say nothing."""
    if args.stuck_after is not None and args.stuck_after < 5:
        raise InputError("--stuck-after of at least 5 s", found=args.stuck_after)
    return Care() if args.stuck_after is None else Care(silent_s=args.stuck_after)


def job_from(args: argparse.Namespace) -> jobs.RenderJob:
    """The job of the options. Raises InputError for a sequence, scene or camera that is not there."""
    if args.sequence is None and not (args.scene and args.trajectory):
        raise InputError("a SEQUENCE, or --scene and --trajectory", hint=", ".join(shipped.sequence_names()))
    if args.sequence is None:
        name = f"{Path(args.scene).stem}/{Path(args.trajectory).stem}"
        job = jobs.RenderJob(sequence=name, scene=args.scene, trajectory=args.trajectory)
    else:
        job = jobs.read_recipe(args.sequence) if args.sequence.endswith(".json") else jobs.shipped_job(args.sequence)
    camera = PinholeCamera.parse(args.camera) if args.camera else None
    files = {name: _absolute(getattr(args, name)) for name in ("scene", "trajectory")}
    job = job.changed(camera=camera, **files, **given_settings(args, jobs.RenderJob))
    return replace(job, reading=reading_from(args, job.reading))


def frames_from(args: argparse.Namespace) -> str:
    """--frames, or every 30th with --quick."""
    if args.quick and args.frames:
        raise InputError("--quick or --frames, not both")
    return args.frames or ("::30" if args.quick else "::")


def _absolute(name: str | None) -> str | None:
    """A file's full path, so that the recipe says which; shipped names stay."""
    if name is None or name in (*shipped.SCENE_NAMES, *shipped.sequence_names()):
        return name
    return str(Path(name).expanduser().resolve())


def usable_here(job: jobs.RenderJob, args: argparse.Namespace, console: Console) -> jobs.RenderJob:
    """Denoising is the default of path tracing only where this Blender can."""
    from iclnuim.blender import compat

    if job.denoise and args.denoise is None and not compat.has_denoiser():
        console.note("this Blender has no OpenImageDenoise: rendering without")
        return job.changed(denoise=False)
    return job


def render_here(
    job: jobs.RenderJob, out: Path, frames: str | list[int], console: Console, blend: Path | None = None
) -> bool:
    """Render in this process with progress; False when a signal stopped it."""
    from iclnuim.blender import worker

    progress, missing = None, 0

    def emit(event: events.Event) -> None:
        nonlocal progress, missing
        if isinstance(event, events.Note):
            console.note(f"note: {event.text}")
        elif isinstance(event, events.Started):
            missing = event.missing
            console.note(f"{job.sequence}: {missing} of {event.frames} frames to render, in {out}")
        elif isinstance(event, events.Ready):
            progress = console.progress(missing, job.sequence)
        elif isinstance(event, events.FrameDone):
            progress.advance()

    with stop_on_signals() as stopped:
        finished = worker.render_run(job, out, frames, emit, stopped, blend)
    if not finished:
        console.note("stopped: the frames so far are valid; the same command goes on from here")
    return finished


@contextmanager
def stop_on_signals() -> Iterator:
    """Ctrl-C and SIGTERM ask for a stop after the current frame; a second one ends the process at once, frames stay valid."""
    received = []

    def note(number: int, _frame: object) -> None:
        received.append(number)
        if len(received) > 1:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
