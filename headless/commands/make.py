"""`iclnuim make`: render, clean and noisy sequence in one command, resumable at any point."""

import argparse

from ..console import Console
from ..farm.execute import execute
from ..options import common
from .run_options import add_farm_options, add_run_options, plan_from, with_farm_options


def configure(parser: argparse.ArgumentParser) -> None:
    add_run_options(parser, "make")
    add_farm_options(parser)
    common(parser, "iclnuim make kt2 --quick")


def run(args: argparse.Namespace, console: Console) -> int:
    return execute(with_farm_options(plan_from(args, "make"), args), console, args.print_only)
