"""`iclnuim make`: render, clean and noisy TUM sequence in one command, resumable at any point."""

from __future__ import annotations

import argparse
from pathlib import Path

from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import load_trajectory
from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter
from iclnuim.geometry.trajectory import frame_slice

from ..console import Console
from ..farm import record, rendering, slurm_command
from ..farm.cores import own_cores
from ..farm.sequences import SequenceStage
from ..farm.tasks import RunPlan
from ..options import common
from ..sensor_options import add_sensor_options, sensor_from
from . import render


def configure(parser: argparse.ArgumentParser) -> None:
    render.add_job_options(parser)
    add_sensor_options(parser, "released", ("depth_units",))
    parser.add_argument(
        "-o", "--out", type=Path, metavar="DIR", help="default: out/SEQUENCE; holds clean/, noisy/ and, meanwhile, raw/"
    )
    parser.add_argument(
        "--keep-raw", action="store_true", help="keep the EXR frames; default: they go once both sequences stand"
    )
    render.add_farm_options(parser)
    common(parser, "iclnuim make kt2 --quick")


def run(args: argparse.Namespace, console: Console) -> int:
    if slurm_command.asked(args):
        return slurm_command.run("make", plan(args), args, console)
    sensor, frames = sensor_from(args), render.frames_from(args)
    job = render.job_from(args)
    out = args.out or Path("out") / job.sequence
    trajectory = load_trajectory(job)
    numbers = list(frame_slice(frames, len(trajectory)))
    variants = {out / "clean": SequenceSettings(seed=sensor.seed), out / "noisy": sensor}
    with (
        render.stop_on_signals() as stopped,
        rendering.taken_up(job, out / "raw", console, stopped, args.workers, render.care_from(args)) as held,
    ):
        record.write(record.of("make", args), out / "raw")
        writer = SequenceWriter(frames_of_run(held.run, trajectory, numbers), variants)
        code = _frames_and_sequences(held, writer, numbers, args.keep_raw)
    if code == 0:
        console.note(f"{out}/clean and {out}/noisy hold {len(numbers)} frames each")
    return code


def plan(args: argparse.Namespace) -> RunPlan:
    """What the options ask for, for tasks on other machines. Raises InputError."""
    sensor, job = sensor_from(args), render.job_from(args)
    numbers = tuple(frame_slice(render.frames_from(args), len(load_trajectory(job))))
    out = args.out or Path("out") / job.sequence
    return RunPlan(job, out / "raw", numbers, sensor, args.keep_raw)


def _frames_and_sequences(held: rendering.LocalRun, writer: SequenceWriter, numbers: list[int], keep_raw: bool) -> int:
    """Pairs are made of finished frames while others are being rendered."""
    stage = SequenceStage(writer, held.run, len(own_cores()), keep_raw)
    asked = held.should_stop
    held.should_stop = lambda: asked() or stage.broken
    try:
        there = set(held.run.frame_numbers()).intersection(numbers)
        finished = there.difference(held.run.missing(sorted(there)))
        for number in sorted(finished):
            stage.add(number)
        outcome = held.render([n for n in writer.missing if n not in finished], stage.add)
    finally:
        stage.close()
    code = rendering.report(outcome, held.console)
    if code == 0:
        stage.complete()
    return code
