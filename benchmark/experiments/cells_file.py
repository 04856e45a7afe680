"""All cells of the matrix in one CSV file, one row per cell: for data analysis, and to report
measured cells without measuring them again.
"""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, get_args

from iclnuim.errors import InputError
from iclnuim.formats.files import atomic_write_text, read_text

from .cell import Cell
from .matrix import Task

#: (task, name of the method) -> the figures of its cell.
Cells = Mapping[tuple[Task, str], dict[str, Any]]
_KEY = (*(field.name for field in fields(Task)), "method")
#: Without the time, which differs in every run: the same cells give the same file.
_FIGURES = {field.name: field.type for field in fields(Cell) if field.name != "seconds"}
_COLUMNS = [*_KEY, *_FIGURES]


def write_cells(cells: Cells, file: Path) -> None:
    """Write the cells, sorted. Figures have six significant digits; one that is None is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for (task, method), figures in sorted(
        cells.items(), key=lambda one: (*astuple(one[0][0]), one[0][1])
    ):
        writer.writerow([*astuple(task), method, *(_word(figures[name]) for name in _FIGURES)])
    atomic_write_text(file, text.getvalue())


def read_cells(file: Path) -> dict[tuple[Task, str], dict[str, Any]]:
    """Read the cells of a file by write_cells(). Raises InputError with the line of a bad row."""
    rows = list(csv.reader(io.StringIO(read_text(file), newline="")))
    if rows[0] != _COLUMNS:
        raise InputError(
            f"the columns {','.join(_COLUMNS)}", path=file, line=1, found=",".join(rows[0])
        )
    found: dict[tuple[Task, str], dict[str, Any]] = {}
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(_COLUMNS):
            raise InputError(f"{len(_COLUMNS)} values", path=file, line=line, found=len(row))
        words = dict(zip(_COLUMNS, row, strict=True))
        try:
            task = Task(
                words["sequence"],
                int(words["start"]),
                words["perturbation"],
                int(words["severity"]),
            )
            found[task, words["method"]] = {
                name: _value(words[name], kind) for name, kind in _FIGURES.items()
            }
        except ValueError as error:
            raise InputError("figures of a cell", path=file, line=line, found=error) from None
    return found


def chosen(
    cells: Cells,
    methods: tuple[str, ...],
    perturbations: tuple[str, ...],
    severities: tuple[int, ...],
    starts: int | None,
) -> dict[tuple[Task, str], dict[str, Any]]:
    """The cells of some methods, perturbations and severities, with the unperturbed ones; on the
    first `starts` segments of each sequence (None: all).
    """
    places: dict[str, set[int]] = {}
    for task, _ in cells:
        places.setdefault(task.sequence, set()).add(task.start)
    first = {name: sorted(found)[:starts] for name, found in places.items()}

    def wanted(task: Task, method: str) -> bool:
        perturbed = task.perturbation in perturbations and task.severity in severities
        return (
            method in methods
            and task.start in first[task.sequence]
            and (perturbed or not task.severity)
        )

    return {key: figures for key, figures in cells.items() if wanted(*key)}


def _word(value: float | str | None) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _value(word: str, kind: Any) -> float | str | None:
    """The value of a word in a column of type `kind`. Raises ValueError."""
    if kind is str:
        return word
    if kind is bool:
        return bool(("False", "True").index(word))
    if not word and type(None) in get_args(kind):
        return None
    if int in (kind, *get_args(kind)):
        return int(word)
    if not math.isfinite(value := float(word)):
        raise ValueError(word)
    return value
