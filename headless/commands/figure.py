"""`iclnuim figure N`: draws a figure of the paper from our rooms, our sequences and the cells of a
benchmark.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.benchmark.experiments.recipes.paper.keys import PRESETS
from iclnuim.console import Console
from iclnuim.formats.files import check_picture

from ..method_options import require
from ..options import common
from ..outputs import refuse_existing
from .benchmark_cells import DEFAULT, cells_or_shipped

#: The first figure that is drawn from cells.
_OF_CELLS = 5


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = (
        "1: the living room in clay; 2, 3: frames; 4: noise; 5, 7: surfaces; 6, 9: heat maps; 8: "
        "trajectories"
    )
    add("number", type=int, choices=range(1, 10), metavar="N", help=help)
    add(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="picture (.png, .pdf, .svg); default: figure_N.png",
    )
    add(
        "--data",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="sequences, for 2 to 4; default: out",
    )
    help = (
        "folder of `iclnuim benchmark`, for 5 to 9; default: out/benchmark, and the shipped cells "
        "of a checkout, which have no pictures, if it has none"
    )
    add("--benchmark", type=Path, metavar="DIR", help=help)
    add("--preset", choices=PRESETS, default="best", help="preset of the cells; default: best")
    common(parser, "iclnuim figure 6 -o figure_6.png", json=False)


def run(args: Namespace, console: Console) -> None:
    target = args.out or Path(f"figure_{args.number}.png")
    if not args.out:
        refuse_existing(target, "-o FILE")
    check_picture(target)
    require(console, "figure", "numba", "cv2", "embreex")
    from iclnuim.benchmark.experiments.recipes.paper.charts import Material, draw
    from iclnuim.benchmark.experiments.recipes.paper.sources import Sources
    from iclnuim.report.charts import save

    results = cells_or_shipped(args.benchmark, console) if args.number >= _OF_CELLS else []
    sources = Sources(args.data, args.benchmark or DEFAULT)
    material = Material(sources, results, args.preset)
    save(draw(args.number, material), target)
    console.result({}, f"{target} written")
