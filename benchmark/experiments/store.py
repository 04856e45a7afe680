"""The folder of an experiment: a file for each cell, by which a killed experiment resumes.

OUT/recipe.json             format, kind and settings of the experiment, versions, machine
OUT/cells/PLACE.cell.json   a cell: its key, its identity and its figures
OUT/cells/PLACE/            further files of a cell, such as its trajectory
"""

import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from iclnuim.errors import InputError
from iclnuim.formats.files import is_file, make_folder, read_json, whole_folder, write_json
from iclnuim.sequences.record import Record
from iclnuim.shipped import source_commit, versions
from iclnuim.version import __version__

from .cell import Cell, Key, Measured

#: Increased when the content of a cell changes: cells of another format are refused.
FORMAT = 2
_ENDING = ".cell.json"
#: Libraries whose versions a recipe records.
_LIBRARIES = (
    "numpy", "scipy", "numba", "opencv-contrib-python-headless", "open3d-cpu", "embreex", "libigl",
)  # fmt: skip


@cache
def made_by() -> dict[str, Any]:
    """Versions, commit and machine for a recipe; git and the packages are asked once."""
    return {
        "versions": {"iclnuim": __version__, **versions(*_LIBRARIES)},
        "source_commit": source_commit(),
        "machine": {"system": platform.platform(), "cores": os.cpu_count()},
    }


@dataclass(frozen=True)
class Store:
    """The cells of experiments of one kind in the folder `out`. keeps: a cell with another identity
    is refused instead of being measured again.
    """

    out: Path
    kind: str
    keeps: bool = False

    def open(self, settings: Mapping[str, Any], about: Mapping[str, Any] | None = None) -> None:
        """Make the folder, or open the existing one. about: what the recipe records besides.

        Raises InputError if the folder has cells of another kind, format or setting.
        """
        path = self.out / "recipe.json"
        requested = {"kind": self.kind, **settings}
        if is_file(path):
            existing = self._recipe()
            there = {key: existing.get(key) for key in requested}
            Record(self.kind, path, requested).refuse_other(there)
        make_folder(self.out, hint="another {out}")
        write_json(path, {"format": FORMAT, **requested, **(about or {}), **made_by()})

    def _recipe(self) -> dict[str, Any]:
        path = self.out / "recipe.json"
        existing = read_json(path)
        if existing.get("format") != FORMAT:
            hint = "another {out}: run it again"
            raise InputError(f"cells of format {FORMAT}", path=path, found="older ones", hint=hint)
        return existing

    def file(self, key: Key) -> Path:
        """The file of a cell."""
        return self.out / "cells" / f"{key.place}{_ENDING}"

    def folder(self, key: Key) -> Path:
        """The folder of a cell's further files."""
        return self.out / "cells" / key.place

    def has(self, cell: Cell) -> bool:
        """Whether a cell is measured with this identity; what the stored identity has besides does
        not count.

        Raises InputError if it has another identity and the store keeps its cells.
        """
        file = self.file(cell.key)
        if not is_file(file):
            return False
        stored = read_json(file).get("identity", {})
        requested = json.loads(json.dumps(cell.identity))
        there = {name: stored.get(name) for name in requested}
        if self.keeps:
            Record("experiment", file, requested).refuse_other(there)
        return there == requested

    def missing(self, cells: Iterable[Cell]) -> list[Cell]:
        """The cells to measure."""
        return [cell for cell in cells if not self.has(cell)]

    def write(self, cell: Cell, figures: Mapping[str, Any]) -> None:
        """Store the figures of a cell."""
        file = self.file(cell.key)
        make_folder(file.parent)
        content = {"key": asdict(cell.key), "identity": cell.identity, "figures": figures}
        write_json(file, content)

    @contextmanager
    def files(self, cell: Cell) -> Iterator[Path]:
        """A new folder for a cell's further files, which replaces the existing one at the end; the
        figures are stored after it.
        """
        self.file(cell.key).unlink(missing_ok=True)
        with whole_folder(self.folder(cell.key)) as folder:
            yield folder

    def read(self, cells: Iterable[Cell]) -> list[Measured]:
        """Those of the cells that are measured with their identity."""
        return [self._measured(cell.key) for cell in cells if self.has(cell)]

    def read_all(self, key_type: type) -> list[Measured]:
        """All measured cells, whatever their identity, in the order of their places."""
        if not is_file(self.out / "recipe.json"):
            return []
        recipe = self._recipe()
        requested = {"kind": self.kind}
        there = {"kind": recipe.get("kind")}
        Record(self.kind, self.out / "recipe.json", requested).refuse_other(there)
        files = sorted((self.out / "cells").rglob(f"*{_ENDING}"))
        return [self._measured(key_type(**read_json(file)["key"])) for file in files]

    def _measured(self, key: Key) -> Measured:
        content = read_json(self.file(key))
        return Measured(key, content["identity"], content["figures"], self.folder(key))
