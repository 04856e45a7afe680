"""`iclnuim task STAGE SEQUENCE`: one task of a render farm, as a scheduler calls it; many may share a folder, on many machines."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from iclnuim.errors import InputError

from ..console import Console
from ..farm import tasks
from ..farm.rendering import report
from ..options import action, subcommands
from ..sensor_options import add_sensor_options
from . import make, render

HELP = {
    "light": "first: the run folder with its recipe, and the light in the cache",
    "frames": "then: some frames, those that are missing",
    "dataset": "last: the clean and the noisy sequence of all frames",
}


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser, "STAGE")
    for stage in tasks.STAGES:
        numbers = " --numbers 0-24,30" if stage == "frames" else ""
        one = action(actions, stage, HELP[stage], f"iclnuim task {stage} kt2 --out out/kt2{numbers}", _run, json=False)
        render.add_job_options(one)
        add_sensor_options(one, "released", ("depth_units",))
        one.add_argument("--out", type=Path, required=True, metavar="DIR", help="as of `make`: frames lie in DIR/raw")
        one.add_argument("--keep-raw", action="store_true", help="as of `make`")
        one.add_argument(
            "--numbers", metavar="A-B,C", help="which frames, both ends included; default: those of --frames"
        )
        one.add_argument("--say", choices=("flamenco",), help="progress in lines that this render farm understands")


def _run(args: argparse.Namespace, console: Console) -> int:
    plan = make.plan(args)
    if args.numbers is not None:
        plan = replace(plan, numbers=numbers_from(args.numbers, plan.numbers))
    tell = _flamenco(args, console, plan) if args.say == "flamenco" else _progress(console, plan)
    if args.action == "dataset":
        tasks.dataset(plan, tell)
        return 0
    with render.stop_on_signals() as stopped:
        if args.action == "light":
            tasks.light(plan, console, stopped)
            return 0
        return report(tasks.frames(plan, plan.numbers, console, stopped, tell), console)


def numbers_from(text: str, asked: tuple[int, ...]) -> tuple[int, ...]:
    """`0-24,30`, of the frames that are asked for. Raises InputError."""
    numbers: list[int] = []
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if found is None:
            raise InputError("--numbers such as 0-24,30", found=text)
        numbers += range(int(found[1]), int(found[2] or found[1]) + 1)
    if not numbers or not set(numbers) <= set(asked):
        raise InputError(f"--numbers of the {len(asked)} frames {asked[0]}..{asked[-1]}", found=text)
    return tuple(sorted(set(numbers)))


def _progress(console: Console, plan: tasks.RunPlan) -> Callable[[int], None]:
    progress = console.progress(len(plan.numbers), plan.job.sequence)
    return lambda number: progress.advance()


def _flamenco(args: argparse.Namespace, console: Console, plan: tasks.RunPlan) -> Callable[[int], None]:
    """Flamenco's worker looks for lines of Blender's: `Time:` and `skipping` are a step, `Saved:` a picture to show."""
    last, images = time.monotonic(), plan.raw.parent / "clean/rgb"

    def tell(number: int) -> None:
        nonlocal last
        seconds, last = time.monotonic() - last, time.monotonic()
        console.result({}, f"Time: {int(seconds // 60):02}:{seconds % 60:05.2f} (frame {number})")
        if args.action == "dataset":
            console.result({}, f"Saved: '{images / f'{number:06}.png'}'")

    if args.action == "frames":
        for number in sorted(set(plan.numbers).difference(plan.missing())):
            console.result({}, f"skipping existing frame {number}")
    return tell
