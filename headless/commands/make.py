"""`iclnuim make`: render, clean and noisy TUM sequence in one command, resumable at any point."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import open_run
from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter
from iclnuim.errors import WorkError
from iclnuim.geometry.trajectory import frame_slice

from ..console import Console
from ..options import common
from ..sensor_options import add_sensor_options, sensor_from
from . import render


def configure(parser: argparse.ArgumentParser) -> None:
    render.add_job_options(parser)
    add_sensor_options(parser, "released", seed=False)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="default: out/SEQUENCE; holds clean/, noisy/ and, meanwhile, raw/"
    )
    parser.add_argument(
        "--keep-raw", action="store_true", help="keep the EXR frames; default: they go once both sequences stand"
    )
    common(parser, "iclnuim make kt2 --quick", json=False)


def run(args: argparse.Namespace, console: Console) -> int:
    sensor, frames = sensor_from(args), render.frames_from(args)
    try:
        from iclnuim.blender import worker
    except ImportError:
        raise WorkError("make needs the bpy package; try: pip install bpy, or `iclnuim doctor`") from None
    job = render.usable_here(render.job_from(args), args, console)
    out = args.out or Path("out") / job.sequence
    trajectory = worker.load_trajectory(job)
    numbers = list(frame_slice(frames, len(trajectory)))
    raw = open_run(out / "raw", worker.recipe(job), trajectory)
    variants = {out / "clean": SequenceSettings(seed=sensor.seed), out / "noisy": sensor}
    writer = SequenceWriter(frames_of_run(raw, trajectory, numbers), variants)
    if writer.missing and not render.render_here(job, raw.path, writer.missing, console):
        return 130
    progress = console.progress(len(writer.missing), "sequences")
    writer.write(on_frame=lambda number: progress.advance())
    if not args.keep_raw:
        for number in numbers:
            raw.frame_file(number).unlink(missing_ok=True)
    console.note(f"{out}/clean and {out}/noisy hold {len(numbers)} frames each")
    return 0
