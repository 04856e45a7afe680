"""The file of all cells: what was written is read back."""

from dataclasses import asdict

from iclnuim.benchmark.experiments.outcome import Outcome
from iclnuim.benchmark.experiments.recipes.stress.cells_file import read_cells, write_cells
from iclnuim.benchmark.experiments.recipes.stress.recipe import StressKey


def test_cells_come_back_whatever_their_names(tmp_path):
    cell = asdict(
        Outcome(30, 1.0, 0.25, True, None, 0.5, 1, 0, 0, 2, None, None, "", 0.125, None, 3.0)
    )
    separators = "/\n\x85\u2028\x0c,"
    cells = {StressKey(f"room{c}kt0", 0, "blur", 3, f"a{c}b"): cell for c in separators}
    write_cells(cells, tmp_path / "cells.csv")
    del cell["seconds"]
    assert read_cells(tmp_path / "cells.csv") == dict.fromkeys(cells, cell)
