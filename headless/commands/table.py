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


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "1: trajectories; 2, 7: surfaces; 3 to 6: ATE"
    add("number", type=int, choices=range(1, 8), metavar="N", help=help)
    help = "folder of `iclnuim benchmark`, for tables 2 to 7; default: out/benchmark"
    add("--out", "-o", type=Path, default=Path("out/benchmark"), metavar="DIR", help=help)
    add("--preset", choices=PRESETS, default="best", help="default: best")
    add("--format", choices=tuple(FORMATS), default="text", help="default: text")
    common(parser, "iclnuim table 1")


def run(args: Namespace, console: Console) -> None:
    written = FORMATS[args.format][1]
    if args.number == 1:
        rows = {row["sequence"]: row for row in trajectory_rows()}
        console.result(rows, written(table_1()))
        return
    from iclnuim.benchmark.experiments.recipes.paper.recipe import measured_cells

    results = measured_cells(args.out)
    suffix = "" if args.preset == "best" else f"_{args.preset}"
    tables = {table.name: table for table in preset_tables(results, args.preset)}
    table = tables[f"table_{args.number}{suffix}"]
    console.result({"columns": table.columns, "rows": table.rows}, written(table))
