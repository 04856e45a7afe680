"""`iclnuim make`: render, clean and noisy TUM sequence in one command, resumable at any point."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.dataset import sequence as sequences
from iclnuim.dataset.run_folder import open_run
from iclnuim.errors import WorkError
from iclnuim.geometry.trajectory import frame_slice

from ..console import Console
from ..options import common
from . import dataset, render

CLEAN = {"depth_noise": "none", "rgb_noise": "none"}


def configure(parser: argparse.ArgumentParser) -> None:
    render.add_job_options(parser)
    dataset.add_sensor_options(parser, "released")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: out/SEQUENCE; holds clean/, noisy/ and, meanwhile, raw/")
    parser.add_argument("--keep-raw", action="store_true", help="keep the EXR frames; default: they go once both sequences stand")
    common(parser, "iclnuim make kt2 --quick", json=False)


def run(args: argparse.Namespace, console: Console) -> int:
    sensor, frames = dataset.sensor_from(args), render.frames_from(args)
    try:
        from iclnuim.blender import worker
    except ImportError:
        raise WorkError("make needs the bpy package; try: pip install bpy, or `iclnuim doctor`") from None
    job = render.usable_here(render.job_from(args), args, console)
    out = args.out or Path("out") / job.sequence
    trajectory = worker.load_trajectory(job)
    numbers = list(frame_slice(frames, len(trajectory)))
    raw = open_run(out / "raw", worker.recipe(job), trajectory)
    wanted = {"clean": sequences.SensorSettings(**CLEAN, seed=sensor.seed), "noisy": sensor}
    size = (job.camera.height, job.camera.width)
    finished = [set(sequences.open_sequence(out / name, raw, settings).finished(numbers, size)) for name, settings in wanted.items()]
    unfinished = sorted(set(numbers) - set.intersection(*finished))
    if unfinished and not render.render_here(job, raw.path, unfinished, console):
        return 130
    for name, settings in wanted.items():
        dataset.fill(raw, out / name, settings, numbers, console)
    if not args.keep_raw:
        for number in numbers:
            raw.frame_file(number).unlink(missing_ok=True)
    console.note(f"{out}/clean and {out}/noisy hold {len(numbers)} frames each")
    return 0
