"""`iclnuim task STAGE SEQUENCE`: one task of a render farm, as a scheduler calls it; many may share a folder, on many machines."""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

from iclnuim.errors import InputError

from ..console import Console
from ..farm import tasks
from ..farm.chunks import numbers_from
from ..farm.rendering import report, stop_on_signals
from ..farm.run_plan import RunPlan
from ..options import action, subcommands
from .run_options import add_run_options, plan_from

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
        add_run_options(one, "make")
        which = "which frames, both ends included; default: those of --frames"
        one.add_argument("--numbers", metavar="A-B,C", help=which)
        one.add_argument("--say", choices=("flamenco",), help="progress in lines that this render farm understands")


def _run(args: argparse.Namespace, console: Console) -> int:
    if args.out is None:
        raise InputError("a folder that all tasks of the run share", setting="out")
    plan = plan_from(args, "make")
    if args.numbers is not None:
        plan = replace(plan, numbers=_chosen(args.numbers, plan.numbers))
    progress = console.progress(len(plan.numbers), plan.job.sequence)
    tell = _flamenco(args.action, console, plan) if args.say == "flamenco" else lambda number: progress.advance()
    if args.action == "dataset":
        tasks.dataset(plan, tell)
        return 0
    with stop_on_signals() as stopped:
        if args.action == "light":
            tasks.light(plan, console, stopped)
            return 0
        return report(tasks.frames(plan, plan.numbers, console, tell, stopped), console)


def _chosen(text: str, asked: tuple[int, ...]) -> tuple[int, ...]:
    """Of the frames that are asked for. Raises InputError."""
    numbers = numbers_from(text)
    if not set(numbers) <= set(asked):
        raise InputError(f"some of the {len(asked)} frames {asked[0]}..{asked[-1]}", setting="numbers", found=text)
    return numbers


def _flamenco(stage: str, console: Console, plan: RunPlan) -> Callable[[int], None]:
    """Flamenco's worker looks for lines of Blender's: `Time:` and `skipping` are a step, `Saved:` a picture to show."""
    last, images = time.monotonic(), plan.out / "clean/rgb"

    def tell(number: int) -> None:
        nonlocal last
        seconds, last = time.monotonic() - last, time.monotonic()
        console.result({}, f"Time: {int(seconds // 60):02}:{seconds % 60:05.2f} (frame {number})")
        image = images / f"{number:06}.png"
        if stage == "dataset" and image.is_file():  # in the format tum alone
            console.result({}, f"Saved: '{image}'")

    if stage == "frames":
        for number in sorted(set(plan.numbers).difference(plan.missing())):
            console.result({}, f"skipping existing frame {number}")
    return tell
