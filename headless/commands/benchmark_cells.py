"""The cells that `iclnuim table` and `iclnuim figure` show: those of a benchmark, or the shipped ones
of a checkout.
"""

from pathlib import Path

from iclnuim import checkout
from iclnuim.benchmark.experiments.cell import Measured
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey
from iclnuim.console import Console

DEFAULT = Path("out/benchmark")
_SHIPPED = Path("docs/measured/cells.jsonl")


def cells_or_shipped(folder: Path | None, console: Console) -> list[Measured]:
    """The measured cells in the folder; without one, those in DEFAULT, or else the shipped ones.

    An installation has no shipped cells: then empty.
    """
    from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND
    from iclnuim.benchmark.experiments.store import Store

    results = Store(folder or DEFAULT, KIND).read_all(PaperKey)
    shipped = checkout.ROOT / _SHIPPED
    if results or folder is not None or not shipped.is_file():
        return results
    checkout.load("iclnuim.tools", "the shipped cells")
    from iclnuim.tools.measured_cells import PublishedCells

    console.note(f"no cells in {DEFAULT}: these are the shipped ones of {_SHIPPED}")
    return PublishedCells.read(shipped).benchmark()
