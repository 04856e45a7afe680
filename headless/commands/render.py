"""`iclnuim render`: renders a sequence as EXR frames."""

import os
from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console

from ..farm.estimate import local_work
from ..farm.execution import execute
from ..farm.run_plan import RunPlan
from ..outputs import refuse_existing
from ..planned_work import add_dry_run, announce
from .run_options import RunOptions, add_farm_options, add_run_options


def configure(parser: ArgumentParser) -> None:
    add_run_options(parser, "render", "folder of the run; default: out/SEQUENCE/raw")
    blend = "also save the scene with the animated camera, to play it in Blender"
    parser.add_argument("--blend", type=Path, metavar="FILE", help=blend)
    add_dry_run(parser)
    add_farm_options(parser, "iclnuim render kt2 --quick")


def run(args: Namespace, console: Console) -> int:
    plan = RunOptions.of(args).plan(args.sequence)
    if plan.farm.engine == "local" and announce(local_work([plan]), args, console):
        return 0
    blend = _new_blend(args.blend, plan, console)
    return execute(plan, console, args.print_only or args.dry_run, blend)


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
