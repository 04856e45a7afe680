"""`iclnuim table N`: prints a table of the paper with our figures: Table I from the shipped
trajectories, the others from a benchmark.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.benchmark.experiments.recipes.paper.keys import PRESETS
from iclnuim.benchmark.experiments.recipes.paper.tables import (
    preset_tables,
    table_1,
    trajectory_rows,
)
from iclnuim.benchmark.experiments.table import FORMATS
from iclnuim.console import Console

from ..options import common
from .benchmark_cells import DEFAULT, cells_or_shipped


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "1: trajectories; 2, 7: surfaces; 3 to 6: ATE"
    add("number", type=int, choices=range(1, 8), metavar="N", help=help)
    help = (
        "folder of `iclnuim benchmark`, for tables 2 to 7; default: out/benchmark, and the shipped "
        "cells of a checkout if it has none"
    )
    add("--out", "-o", type=Path, metavar="DIR", help=help)
    add("--preset", choices=PRESETS, default="best", help="default: best")
    add("--format", choices=tuple(FORMATS), default="text", help="default: text")
    common(parser, "iclnuim table 1")


def run(args: Namespace, console: Console) -> None:
    written = FORMATS[args.format][1]
    if args.number == 1:
        rows = {row["sequence"]: row for row in trajectory_rows()}
        console.result(rows, written(table_1()))
        return
    from iclnuim.benchmark.experiments.recipes.paper.recipe import no_cells

    results = cells_or_shipped(args.out, console)
    if not results:
        raise no_cells(args.out or DEFAULT)
    suffix = "" if args.preset == "best" else f"_{args.preset}"
    tables = {table.name: table for table in preset_tables(results, args.preset)}
    table = tables[f"table_{args.number}{suffix}"]
    console.result({"columns": table.columns, "rows": table.rows}, written(table))
