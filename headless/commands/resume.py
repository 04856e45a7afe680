"""`iclnuim resume DIR`: executes the recorded plan of a folder again; finished work is skipped."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.geometry.scene_axes import SceneReading

from ..farm.estimate import local_work
from ..farm.execution import execute
from ..farm.run_plan import find_run, read_plan
from ..options import add_settings
from ..planned_work import announce
from .run_options import RunOptions, add_farm_options


def configure(parser: ArgumentParser) -> None:
    help = "output folder of `iclnuim render` or `make`"
    parser.add_argument("folder", type=Path, metavar="DIR", help=help)
    add_settings(parser, SceneReading, ["allow_outside"])
    add_farm_options(parser, "iclnuim resume out/living_room/kt2")


def run(args: Namespace, console: Console) -> int:
    plan = RunOptions.of(args).resumed(read_plan(find_run(args.folder)), args.folder)
    console.note(f"resuming: iclnuim {plan.command} {plan.job.sequence}")
    if plan.farm.engine == "local":
        announce(local_work([plan]), args, console)
    return execute(plan, console, args.print_only)
