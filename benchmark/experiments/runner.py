"""Measures the cells of a benchmark on all cores, with one process per cell. Measured cells are
kept, so the same call resumes.

OUT/recipe.json                      the settings of the benchmark, its versions and machine
OUT/cells/ROOM/TRAJECTORY/NOISE/CELL/  recipe.json, result.json, times.json, trajectory.txt,
path.json, surface.jpg, heat.jpg: written by measure.py
OUT/tables/, OUT/report.html         made from the cells alone
OUT/work/                            data shared by cells while they are measured
"""

import platform
import subprocess
import sys
import tempfile
import threading
from collections.abc import Container, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import IO

from iclnuim.benchmark.fusion.settings import QualitySettings
from iclnuim.console import Console, Progress
from iclnuim.dataset.record import Record
from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write_text, make_folder, read_json, sha256, write_json
from iclnuim.shipped import source_commit, versions
from iclnuim.version import __version__

from .cells import Cell
from .measure import HEAT_MM, Task, fuse_settings
from .sources import Sources, environment, task_text

_SCHEMA_VERSION = 1
#: Libraries whose versions the recipes record.
_LIBRARIES = ("numpy", "numba", "scipy", "embreex", "libigl")


@dataclass(eq=False)
class Benchmark:
    """cells: those to measure. systems: cells of external systems -> their trajectories. first: use
    only the first N frames of every sequence.
    surfaces: False measures trajectories only; a cell that also has a measured surface then counts
    as measured.
    """

    sources: Sources
    cells: list[Cell]
    systems: Mapping[Cell, Path]
    first: int | None
    workers: int
    console: Console
    surfaces: bool = True
    _stopped: bool = False
    _processes: set[subprocess.Popen] = field(default_factory=set)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @cached_property
    def _made_by(self) -> dict:
        """Versions and commit for all recipes; git and the packages are queried once."""
        return {
            "versions": {"iclnuim": __version__, **versions(*_LIBRARIES)},
            "source_commit": source_commit(),
        }

    def open(self) -> None:
        """Make the folder, or open the existing benchmark.

        Raises InputError if that has another number of frames.
        """
        out, path = self.sources.out, self.sources.out / "recipe.json"
        requested = {"schema_version": _SCHEMA_VERSION, "kind": "benchmark", "first": self.first}
        if Record("benchmark", path, requested).is_begun():
            return
        make_folder(out, hint="another {out}")
        write_json(path, {**requested, **self._made_by, "machine": _machine()})

    def run(self) -> list[str]:
        """Measure the missing cells; returns a sentence for each cell that could not be measured.

        An interruption kills its processes.
        """
        missing = self._missing()
        measured_before = len(self.cells) - len(missing)
        self.console.note(
            f"benchmark: {len(self.cells)} cells, {measured_before} of them already measured"
        )
        if others := self._by_other_code(missing):
            self.console.note(
                f"benchmark: {len(others)} of these were measured by another version or commit of iclnuim or its libraries, "
                f"the first is {others[0]}; to measure cells again, remove their folders"
            )
        made = {task.cell.sequence: task.cell for task in missing if task.cell.seed}
        frames = sum(map(self._frames, missing)) + sum(
            self.sources.frames(cell, self.first) for cell in made.values()
        )
        progress, problems = self.console.progress(frames, "benchmark"), list[str]()
        for cell in self.cells:  # a killed run may have left the noisy sequences of measured cells
            if cell.seed and cell.sequence not in made:
                self.sources.remove_noise(cell)
        with ThreadPoolExecutor(self.workers) as pool:
            pending: set[Future] = set()
            try:
                for sequence, tasks in _by_sequence(missing).items():
                    if noisy := made.get(sequence):
                        self.sources.make_noise(
                            noisy, self.first, lambda number: self._advance(progress, 1)
                        )
                    for task in tasks:
                        self._collect(pending, self.workers - 1, problems)
                        pending.add(pool.submit(self._measure, task, progress))
                    if noisy:
                        self._collect(pending, 0, problems)
                        self.sources.remove_noise(noisy)
                self._collect(pending, 0, problems)
            except BaseException:
                self._stop()
                raise
        if not problems:
            self.sources.remove_work()
        return problems

    def _missing(self) -> list[Task]:
        """Tasks of the cells that are not measured, with the model files of their rooms, if these
        can be made.
        """
        ignored = _IGNORED if self.surfaces else (*_IGNORED, "model")
        tasks = [task for task in map(self._task, self.cells) if not _is_done(task, ignored)]
        files = {
            name: self._model(name) for name in dict.fromkeys(task.model for task in tasks) if name
        }
        return [_with_model(task, files[task.model]) if task.model else task for task in tasks]

    def _by_other_code(self, missing: list[Task]) -> list[Path]:
        """Folders of the measured cells whose recipes have other versions or another commit."""
        left = {task.cell for task in missing}
        folders = [
            self.sources.out / "cells" / cell.name for cell in self.cells if cell not in left
        ]
        return [
            f
            for f in folders
            if any((_recipe(f) or {}).get(key) != self._made_by[key] for key in _IGNORED)
        ]

    def _frames(self, task: Task) -> int:
        """Number of progress steps of a cell: its frames are tracked, and fused."""
        return self.sources.frames(task.cell, self.first) * (
            bool(task.model) + (not task.trajectory)
        )

    def _collect(self, pending: set[Future], left: int, problems: list[str]) -> None:
        """Wait until no more than `left` cells are being measured."""
        while len(pending) > left:
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            pending -= done
            for problem in filter(None, (future.result() for future in done)):
                problems.append(problem)
                self.console.note(problem)

    def _stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in self._processes:
                process.kill()

    def _measure(self, task: Task, progress: Progress) -> str:
        """Measure one cell in a process; returns the reason of a failure, or an empty text."""
        frames, done = self._frames(task), 0
        with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryFile("w+") as errors:
            file = Path(scratch) / "task.json"
            atomic_write_text(file, task_text(asdict(task)))
            process = self._begun(
                [sys.executable, "-m", f"{__package__}.measure", str(file)], errors
            )
            if process is None:
                return ""
            assert process.stdout and process.stdin
            for line in process.stdout:
                count = min(int(line), frames - done) if line.strip().isdigit() else 0
                done += count
                self._advance(progress, count)
            code = process.wait()
            process.stdin.close()
            with self._lock:
                self._processes.discard(process)
            self._advance(progress, frames - done)
            errors.seek(0)
            last = [line.strip() for line in errors if line.strip()][-1:]
        if code == 0:
            return ""
        how = f"was ended by signal {-code}" if code < 0 else f"failed: {' '.join(last)}"
        return f"{task.cell.name} {how}"

    def _begun(self, command: list[str], errors: IO[str]) -> "subprocess.Popen[str] | None":
        """Start a process; None if the benchmark was stopped in the meantime."""
        with self._lock:
            if self._stopped:
                return None
            pipe = subprocess.PIPE
            process = subprocess.Popen(
                command,
                env=environment(),
                text=True,
                stdin=pipe,
                stdout=pipe,
                stderr=errors,
                bufsize=1,
            )
            self._processes.add(process)
            return process

    def _advance(self, progress: Progress, count: int) -> None:
        with self._lock:
            progress.advance(count)

    def _task(self, cell: Cell) -> Task:
        """The task of a cell.

        Its model is the name of the room; `_missing` replaces it by the file, which is made only if
        needed.
        """
        out, path = self.sources.out / "cells" / cell.name, self.systems.get(cell)
        task = Task(
            cell,
            str(self.sources.folder(cell)),
            str(out),
            self.first,
            self.sources.model_name(cell) if self.surfaces else None,
            str(path) if path else None,
            {},
            str(self.sources.work),
        )
        recipe = {
            "schema_version": _SCHEMA_VERSION,
            "kind": "benchmark cell",
            "cell": asdict(cell),
            "first": self.first,
            "sequence": self.sources.identity(cell),
            "trajectory": sha256(path.read_bytes()) if path else None,
            "model": task.model,
            "fusion": asdict(fuse_settings(task)),
            "quality": QualitySettings().to_dict(),
            "heat_mm": list(HEAT_MM),
        }
        return replace(task, recipe={**recipe, **self._made_by})

    def _model(self, name: str) -> str | None:
        try:
            return str(self.sources.model(name))
        except WorkError as error:
            self.console.note(f"surfaces of {name} are not measured: {error}")
            return None


#: Keys of a cell's recipe that do not decide its result.
_IGNORED = ("versions", "source_commit")


def _is_done(task: Task, ignored: Container[str]) -> bool:
    """Whether the cell was measured with the same recipe, except for the ignored keys.

    Otherwise it is measured again.
    """
    existing = _recipe(Path(task.out))
    return existing is not None and all(
        existing.get(k) == value for k, value in task.recipe.items() if k not in ignored
    )


def _recipe(folder: Path) -> dict | None:
    """The recipe of a cell; None if it is not measured."""
    path = folder / "recipe.json"
    return read_json(path) if path.is_file() else None


def _with_model(task: Task, file: str | None) -> Task:
    """The task with its model file.

    Without a file no surface is measured; the recipe records this, so that a later call measures
    it.
    """
    return replace(task, model=file, recipe=task.recipe if file else {**task.recipe, "model": None})


def _by_sequence(tasks: Iterable[Task]) -> dict[str, list[Task]]:
    found: dict[str, list[Task]] = {}
    for task in tasks:
        found.setdefault(task.cell.sequence, []).append(task)
    return found


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"


def measured(out: Path) -> list[dict]:
    """Results of all measured cells, with `cell`, `folder` and `times`, in the order of their
    names.
    """
    found = []
    for path in sorted((out / "cells").glob("*/*/*/*/result.json")):
        content, times = read_json(path), read_json(path.with_name("times.json"))
        found.append(
            {**content, "cell": Cell(**content["cell"]), "folder": path.parent, "times": times}
        )
    return found
