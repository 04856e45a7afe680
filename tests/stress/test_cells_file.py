"""The file of all cells: what was written is read back."""

from iclnuim.benchmark.experiments.cell import Cell
from iclnuim.benchmark.experiments.cells_file import read_cells, write_cells
from iclnuim.benchmark.experiments.matrix import Task


def test_cells_come_back_whatever_their_names(tmp_path):
    cell = Cell(
        30, 1.0, 0.25, True, None, 0.5, 1, 0, 0, 2, None, None, "", 0.125, None, 3.0
    ).to_dict()
    cells = {(Task(f"room{c}kt0", 0, "blur", 3), f"a{c}b"): cell for c in "/\n\x85\u2028\x0c,"}
    write_cells(cells, tmp_path / "cells.csv")
    del cell["seconds"]
    assert read_cells(tmp_path / "cells.csv") == dict.fromkeys(cells, cell)
