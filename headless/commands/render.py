"""`iclnuim render`: EXR frames with RGB and exact depth, by worker processes on all cores."""

import argparse
from pathlib import Path

from ..console import Console
from ..farm.execute import execute
from ..options import common
from .run_options import add_farm_options, add_run_options, plan_from, with_farm_options


def configure(parser: argparse.ArgumentParser) -> None:
    add_run_options(parser, "render")
    parser.add_argument(
        "--blend", type=Path, metavar="FILE", help="also save the scene with the keyed camera, to play in Blender"
    )
    add_farm_options(parser)
    common(parser, "iclnuim render kt2 --quick")


def run(args: argparse.Namespace, console: Console) -> int:
    plan = with_farm_options(plan_from(args, "render"), args)
    return execute(plan, console, args.print_only, args.blend)
