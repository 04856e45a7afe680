"""`iclnuim make`: renders a sequence, or all of them, and writes each clean and noisy."""

from argparse import ArgumentParser, Namespace
from functools import partial

from iclnuim.console import Console

from ..farm.all_sequences import make_all
from ..farm.estimate import local_work
from ..farm.execution import execute, refuse_print_only
from ..planned_work import add_dry_run, announce
from .run_options import RunOptions, add_farm_options, add_run_options


def configure(parser: ArgumentParser) -> None:
    out = (
        "folder for clean/, noisy/ and, while frames are rendered, raw/; "
        "default: out/SEQUENCE (with `all`: out)"
    )
    add_run_options(parser, "make", out)
    views = (
        "also render novel views into held_out/: 0.5 m or 20 degrees away from all other views, "
        "of what these saw; their number, or their trajectory"
    )
    parser.add_argument("--held-out", metavar="N|TRAJECTORY", help=views)
    add_dry_run(parser)
    add_farm_options(parser, "iclnuim make kt2 --quick")


def run(args: Namespace, console: Console) -> int:
    asked = RunOptions.of(args)
    if args.sequence == "all":
        plans = asked.every_plan()
        refuse_print_only(plans[0], args.print_only)
        if announce(local_work(plans), args, console):
            return 0
        return make_all(plans, partial(execute, print_only=args.print_only), console)
    plan = asked.plan(args.sequence)
    if plan.farm.engine == "local" and announce(local_work([plan]), args, console):
        return 0
    return execute(plan, console, args.print_only or args.dry_run)
