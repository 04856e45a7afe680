"""`iclnuim task`: runs one task of a render farm, as a scheduler calls it."""

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import replace

from iclnuim.console import Console
from iclnuim.errors import InputError

from .. import options
from ..farm import tasks
from ..farm.chunks import numbers_from
from ..farm.rendering import stop_on_signals
from ..farm.run_plan import RunPlan
from .run_options import RunOptions, add_run_options

_STAGES = {
    "simulations": "first: write the run folder, and bake the simulations of a .blend that has any",
    "light": "then: write the run folder with its recipe, and bake the light into the cache",
    "frames": "then: render those of the given frames that are missing",
    "dataset": "last: write the clean and the noisy sequence of all frames",
}


def configure(parser: ArgumentParser) -> None:
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


def _task(args: Namespace, console: Console) -> int:
    """Run one task of a render farm, as called by a scheduler.

    Tasks on many machines may share a folder.
    """
    if args.out is None:
        raise InputError("a folder that all tasks of the run share", setting="out")
    plan = RunOptions.of(args).plan(args.sequence)
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
