"""`iclnuim resume DIR`: what was asked for when a folder was begun, again; what is finished is skipped."""

import argparse
from pathlib import Path

from ..console import Console
from ..farm.execute import execute
from ..farm.run_plan import find_run, read_plan
from ..options import common
from .run_options import add_farm_options, with_farm_options


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what --out of `iclnuim render` or `make` was")
    add_farm_options(parser)
    common(parser, "iclnuim resume out/living_room/kt2")


def run(args: argparse.Namespace, console: Console) -> int:
    plan = with_farm_options(read_plan(find_run(args.folder)), args)
    console.note(f"resuming: iclnuim {plan.command} {plan.job.sequence}")
    return execute(plan, console, args.print_only)
