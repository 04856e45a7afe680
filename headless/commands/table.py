"""`iclnuim table N`: a table of the paper from our own files, beside the printed figures."""

import argparse
from dataclasses import asdict

from ..benchmark import table_1
from ..console import Console
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "number", type=int, choices=(1,), metavar="N", help="1: frames, lengths and speeds of the trajectories"
    )
    common(parser, "iclnuim table 1")


def run(args: argparse.Namespace, console: Console) -> int:
    table = table_1.rows()
    console.result({row.sequence: asdict(row) for row in table}, table_1.text(table))
    return 0
