"""An experiment in one class: its settings, what is measured on a sequence, and tables of the
figures. The engine makes cells of it, measures those that are missing, and writes tables and page.

OUT/cells/SEQUENCE/VARIANT.cell.json   a cell
OUT/tables/, OUT/NAME.html, NAME.png   made from the cells alone
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.settings import Settings, plain

from .cell import Cell, Measured
from .code_version import code_of
from .inputs import Input
from .page import Page, Section, png_uri
from .pool import Advance, Job, run_jobs
from .store import Store
from .table import ResultTable, write_tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SequenceKey:
    """One of several variants of a measurement on a sequence."""

    sequence: str
    variant: str

    @property
    def place(self) -> str:
        return f"{self.sequence}/{self.variant}".replace(":", "_")


@dataclass(frozen=True)
class Experiment(Settings):
    """Base of experiments. The fields of a subclass, declared by `parameter`, are what decides the
    figures besides the sequence and the code. The first line of its docstring describes it.
    """

    group = "settings of the experiment"

    def variants(self) -> Sequence[str]:
        """Names of what is measured on each sequence, such as methods."""
        return ("all",)

    def measure(self, variant: str, one: Input) -> Mapping[str, Any]:
        """The figures of a variant on a sequence, ready for JSON."""
        raise NotImplementedError

    def tables(self, results: Sequence[Measured]) -> list[ResultTable]:
        """The tables of what is measured, sequence by sequence; by default one with a row for each
        cell. Its code does not count in the identity of a cell.
        """
        names = list(dict.fromkeys(chain.from_iterable(one.figures for one in results)))
        rows = []
        for one in results:
            figures = (one.figures.get(name, "") for name in names)
            rows.append((one.key.sequence, one.key.variant, *map(plain, figures)))
        columns = ("sequence", "variant", *names)
        return [ResultTable("cells", self.about(), columns, tuple(rows))]

    def chart(self, results: Sequence[Measured]) -> "Figure | None":
        """A chart of what is measured, before the tables of the page; by default none."""
        return None

    @classmethod
    def about(cls) -> str:
        return (cls.__doc__ or "").strip().partition("\n")[0]

    def cells(self, inputs: Sequence[Input]) -> list[Cell]:
        kind = type(self)
        found = []
        for one in inputs:
            pairs = one.sequence.pairs
            camera = one.sequence.camera
            identity = {
                "settings": self.to_dict(),
                "code": code_of(f"{kind.__module__}:{kind.__qualname__}", without=(Experiment,)),
                "input": one.sha256,
                "frames": [pairs[0].number, pairs[-1].number, len(pairs)],
                "camera": camera.pinhole.to_dict(),
                "depth_units_per_metre": camera.depth_units_per_metre,
            }
            for variant in self.variants():
                found.append(Cell(SequenceKey(one.name, variant), identity))
        return found

    def run(
        self, inputs: Sequence[Input], store: Store, workers: int, console: Console
    ) -> list[str]:
        """Measure the missing cells; returns a sentence for each one that cannot be measured."""
        by_name = {one.name: one for one in inputs}
        store.open(
            {}, {"sequences": {name: str(one.sequence.folder) for name, one in by_name.items()}}
        )
        problems: list[str] = []
        jobs = []
        for cell in store.missing(self.cells(inputs)):
            measure = partial(self._measure, cell, by_name[cell.key.sequence], store)
            jobs.append(Job(cell.key.place, measure, 1))
        progress = console.progress(len(jobs), store.kind, "cells")
        run_jobs(jobs, workers, progress.advance, problems.append)
        return problems

    def _measure(self, cell: Cell, one: Input, store: Store, advance: Advance) -> None:
        store.write(cell, self.measure(cell.key.variant, one))
        advance(1)

    def write(self, store: Store, results: Sequence[Measured]) -> Path:
        """Write the tables in every format, and the page; returns its path."""
        tables = self.tables(results)
        write_tables(store.out / "tables", tables)
        sections = [Section(table.name, table.title, tables=[table]) for table in tables]
        if (chart := self.chart(results)) is not None:
            chart.savefig(store.out / f"{store.kind}.png", dpi=110)
            sections.insert(0, Section("chart", "At a glance", picture=png_uri(chart)))
        page = Page(f"ICL-NUIM: {store.kind}", self.about(), sections)
        return page.write(store.out / f"{store.kind}.html")


def experiment_in(module: ModuleType) -> type[Experiment] | None:
    """The experiment that a module defines, or imports from the modules of its folder."""
    for value in vars(module).values():
        is_own = f"{getattr(value, '__module__', '')}.".startswith(f"{module.__name__}.")
        if is_own and isinstance(value, type) and issubclass(value, Experiment):
            return value
    return None


def own_experiment(path: Path) -> type[Experiment]:
    """The experiment of a Python file, or of a folder with __init__.py. Raises InputError."""
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        found = experiment_in(import_module(path.stem))
    except ImportError as error:
        raise InputError("an experiment", path=path, found=error) from None
    if found is None:
        raise InputError("a class derived from Experiment", path=path, found="none")
    return found
