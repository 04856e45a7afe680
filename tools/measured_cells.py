"""The measured cells of docs/measured, in one file of lines: the runs, then the cells, sorted.

    {"run": "a", "commit": "75405c27", "machine": "2 cores", "command": "iclnuim benchmark"}
    {"key": ["benchmark", "office", "kt0", ...], "run": "a", "figures": {...}, "code": "5e1f..."}

The first word of a key is the kind of the cell: `benchmark` and `stress` are those of the
experiments, and the further words are their keys; `table` is a table of a command, named by its
mark; `fact` is one row of a page.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

from iclnuim.benchmark.experiments.cell import Measured
from iclnuim.benchmark.experiments.outcome import Outcome
from iclnuim.benchmark.experiments.recipes.paper.keys import PaperKey
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND as BENCHMARK
from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND as STRESS
from iclnuim.benchmark.experiments.recipes.stress.recipe import StressKey, system_name
from iclnuim.benchmark.odometry.registry import BASELINES
from iclnuim.errors import InputError
from iclnuim.formats.files import atomic_write_text, read_text, sha256
from iclnuim.shipped import folder, paper_scenes
from iclnuim.tools.measured_tables import Rows

TABLE = "table"
FACT = "fact"
Key = tuple[Any, ...]
#: What the cells of a benchmark have besides and no page shows.
_LEFT_OUT = ("path", "not_fitted")
_DIGITS = 6
#: Words of an identity that are of the method's own code; that of the evaluation does not count.
_CODE = ("method_code", "reference_code")
#: Methods -> their words in keys, where these differ: a key stays when a method is renamed.
_KEY_WORDS = {
    **{name: f"baseline:{name}" for name in BASELINES},
    **{
        system_name(name): system_name(word)
        for name, word in (("libfovis", "fovis"), ("dvo_core", "dvo"))
    },
    "libfovis": "FOVIS (libfovis)",
    "dvo_core": "DVO (dvo_core)",
}
_METHODS = {word: name for name, word in _KEY_WORDS.items()}


@dataclass(frozen=True)
class Run:
    """How cells were measured. commit: the one whose code it was; of cells older than this file,
    the one that recorded their figures.
    """

    commit: str
    machine: str
    command: str

    @property
    def name(self) -> str:
        """Eight digits of its hash: another run does not change the lines of this one's cells."""
        return sha256(json.dumps(astuple(self)).encode())[:8]


@dataclass(frozen=True)
class PublishedCell:
    """code: hash of the method's code, if the cell has one; input: hash of its input."""

    run: Run
    figures: Mapping[str, Any]
    code: str = ""
    input: str = ""


@dataclass(eq=False)
class PublishedCells:
    """All cells by key. used: the runs of the cells that were asked for since it was cleared."""

    cells: dict[Key, PublishedCell] = field(default_factory=dict)
    used: dict[Run, None] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "PublishedCells":
        """Raises InputError with the line that is no cell."""
        runs: dict[str, Run] = {}
        found = cls()
        for number, line in enumerate(read_text(path).splitlines(), 1):
            try:
                words = json.loads(line)
                run = words.pop("run")
                if "key" in words:
                    key = tuple(words.pop("key"))
                    found.cells[key] = PublishedCell(runs[run], **words)
                else:
                    runs[run] = Run(**words)
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise InputError("a run or a cell", path=path, line=number, found=error) from None
        return found

    def write(self, path: Path) -> None:
        """Write the runs that have cells, and the cells, each in one line."""
        runs = sorted({cell.run for cell in self.cells.values()}, key=astuple)
        lines: list[dict[str, Any]] = [{"run": run.name, **vars(run)} for run in runs]
        for key in sorted(self.cells, key=lambda key: [str(word) for word in key]):
            cell = self.cells[key]
            line: dict[str, Any] = {"key": key, "run": cell.run.name, "figures": cell.figures}
            hashes = {"code": cell.code, "input": cell.input}
            lines.append(line | {name: text for name, text in hashes.items() if text})
        texts = [json.dumps(line, ensure_ascii=False) for line in lines]
        atomic_write_text(path, "\n".join(texts) + "\n")

    def of_kind(self, kind: str) -> Iterator[tuple[Key, PublishedCell]]:
        """The cells of a kind, with the further words of their keys."""
        for key, cell in self.cells.items():
            if key[0] == kind:
                self.used[cell.run] = None
                yield tuple(_METHODS.get(word, word) for word in key[1:]), cell

    def benchmark(self) -> list[Measured]:
        """The cells of `iclnuim benchmark`."""
        found = []
        for words, cell in self.of_kind(BENCHMARK):
            found.append(Measured(PaperKey(*words), {}, cell.figures))
        return found

    def stress(self) -> dict[StressKey, Outcome]:
        """The cells of `iclnuim stress`."""
        found = {}
        for words, cell in self.of_kind(STRESS):
            found[StressKey(*words)] = Outcome(**cell.figures)
        return found

    def table(self, mark: str) -> Rows | None:
        """The stored table; None if it was not measured."""
        cell = self.cells.get((TABLE, mark))
        if cell is None:
            return None
        self.used[cell.run] = None
        return list(cell.figures["rows"])

    def facts(self, page: str) -> Rows:
        """The single figures of a page: what was measured, the result, command and commit."""
        found = []
        for key, cell in self.cells.items():
            if key[:2] == (FACT, page):
                found.append(
                    [key[2], cell.figures["result"], f"`{cell.run.command}`", cell.run.commit]
                )
        return found

    def add(self, results: Iterable[Measured], kind: str, run: Run) -> None:
        """Put in measured cells of a store, in place of those that have their keys."""
        for result in results:
            code = {name: result.identity.get(name) for name in _CODE}
            key = result.key
            words = key.words if isinstance(key, StressKey) else astuple(key)
            words = tuple(_KEY_WORDS.get(word, word) for word in words)
            self.cells[kind, *words] = PublishedCell(
                run,
                short(result.figures),
                code=code_hash(code),
                input=sha256(json.dumps(result.identity["input"]).encode())[:12],
            )


def rooms_hash() -> str:
    """Twelve digits of the hash of the shipped rooms, the input of what commands measure."""
    files = [folder("blend") / f"{name}.blend" for name in paper_scenes()]
    return sha256(" ".join(sha256(file.read_bytes()) for file in files).encode())[:12]


def code_hash(code: Mapping[str, Any]) -> str:
    """Twelve digits of the hash of the parts of an identity that are of code."""
    there = {name: code[name] for name in _CODE if code.get(name)}
    return sha256(json.dumps(there, sort_keys=True).encode())[:12]


def short(figures: Any) -> Any:
    """The figures with six significant digits."""
    if isinstance(figures, float):
        return float(f"{figures:.{_DIGITS}g}")
    if isinstance(figures, Mapping):
        return {name: short(one) for name, one in figures.items() if name not in _LEFT_OUT}
    if isinstance(figures, list):
        return [short(one) for one in figures]
    return figures
