"""The cells of `iclnuim stress` in one CSV file, one row per cell: for data analysis, and to report
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
from iclnuim.formats.files import atomic_write_text, csv_text, read_text

from ....perturbations.plan import CLEAN
from ...outcome import Outcome
from .recipe import StressKey

#: The figures of cells by key.
Cells = Mapping[StressKey, Mapping[str, Any]]
_BASE = "base"
_KEY = tuple(field.name for field in fields(StressKey) if field.name not in ("preset", _BASE))
#: Without the time, which differs in every run: the same cells give the same file.
_FIGURES = {field.name: field.type for field in fields(Outcome) if field.name != "seconds"}
_COLUMNS = [*_KEY, *_FIGURES, _BASE]


def write_cells(cells: Cells, file: Path) -> None:
    """Write the cells, sorted. Figures have six significant digits; one that is None is empty."""
    rows = [_COLUMNS]
    for key in sorted(cells):
        figures = [_word(cells[key][name]) for name in _FIGURES]
        rows.append([*astuple(key)[: len(_KEY)], *figures, key.base])
    atomic_write_text(file, csv_text(rows))


def read_cells(file: Path) -> dict[StressKey, dict[str, Any]]:
    """Read the cells of a file by write_cells(); those of a file without the column of the base
    have clean frames. Raises InputError with the line of a bad row.
    """
    rows = list(csv.reader(io.StringIO(read_text(file), newline="")))
    if rows[0] == _COLUMNS[:-1]:
        rows = [_COLUMNS, *([*row, CLEAN] for row in rows[1:])]
    if rows[0] != _COLUMNS:
        expected = f"the columns {','.join(_COLUMNS)}"
        raise InputError(expected, path=file, line=1, found=",".join(rows[0]))
    found = {}
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(_COLUMNS):
            raise InputError(f"{len(_COLUMNS)} values", path=file, line=line, found=len(row))
        words = dict(zip(_COLUMNS, row, strict=True))
        try:
            key = StressKey(
                sequence=words["sequence"],
                start=int(words["start"]),
                perturbation=words["perturbation"],
                severity=int(words["severity"]),
                method=words["method"],
                base=words[_BASE],
            )
            figures = {name: _value(words[name], kind) for name, kind in _FIGURES.items()}
        except ValueError as error:
            raise InputError("figures of a cell", path=file, line=line, found=error) from None
        found[key] = figures
    return found


def chosen(
    cells: Cells,
    methods: tuple[str, ...],
    perturbations: tuple[str, ...],
    severities: tuple[int, ...],
    starts: int | None,
    base: str,
) -> dict[StressKey, Mapping[str, Any]]:
    """The cells of some methods, perturbations and severities of a base, with the unperturbed ones;
    on the first `starts` segments of each sequence (None: all).
    """
    places: dict[str, set[int]] = {}
    for key in cells:
        places.setdefault(key.sequence, set()).add(key.start)
    first = {name: sorted(found)[:starts] for name, found in places.items()}

    def wanted(key: StressKey) -> bool:
        perturbed = key.perturbation in perturbations and key.severity in severities
        there = key.method in methods and key.start in first[key.sequence] and key.base == base
        return there and (perturbed or not key.severity)

    return {key: figures for key, figures in cells.items() if wanted(key)}


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
