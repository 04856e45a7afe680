"""The recipe of `iclnuim benchmark`: the paper's experiments. A cell is an odometer on a sequence,
against a reference.

OUT/cells/ROOM/TRAJECTORY/NOISE/ODOMETER_PRESET_REFERENCE   a cell; its folder has trajectory.txt,
                                                            surface.jpg and heat.jpg
OUT/tables/, OUT/report.html         made from the cells alone
OUT/models/, OUT/noise/, OUT/work/   data shared by cells while they are measured
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from iclnuim.benchmark.fusion.settings import QualitySettings
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import is_file, sha256

from ...cell import Cell, Measured
from ...code_version import code_of, method_code
from ...pool import Advance, Job, compile_first, run_jobs
from ...store import Store
from .keys import PaperKey, PaperTask, core_seconds, fuse_settings
from .measure import TRAJECTORY, measure, measure_only_surface
from .sources import Sources

KIND = "benchmark"
#: What only surfaces depend on, and what only an alignment with a model depends on.
_SURFACE = "iclnuim.benchmark.experiments.recipes.paper.surface:measure_surface"
_REFERENCE = "iclnuim.benchmark.fusion.reference:make_reference"


def code_of_trajectory(key: PaperKey) -> dict[str, str | None]:
    """The hashes of the code on which a cell's trajectory and its errors depend."""
    found: dict[str, str | None] = {}
    found["code"] = code_of(measure, without=(_SURFACE, _REFERENCE))
    if not key.external:
        found["method_code"] = method_code(key.odometer)
    if key.against_model:
        found["reference_code"] = code_of(_REFERENCE)
    return found


def measured_cells(out: Path) -> list[Measured]:
    """All measured cells of a benchmark. Raises InputError if there are none."""
    results = Store(out, KIND).read_all(PaperKey)
    if not results:
        raise no_cells(out)
    return results


def no_cells(out: Path) -> InputError:
    """The error of a folder without measured cells."""
    hint = "iclnuim benchmark, or another {out}"
    return InputError("a benchmark with measured cells", path=out, found="none", hint=hint)


@dataclass(frozen=True, eq=False)
class Paper:
    """The experiment. systems: keys of external systems -> their trajectories. first: use only the
    first N frames of every sequence. surfaces: False measures trajectories only; a cell that also
    has a measured surface then counts as measured.
    """

    sources: Sources
    keys: Sequence[PaperKey]
    systems: Mapping[PaperKey, Path]
    first: int | None = None
    surfaces: bool = True

    def cells(self) -> list[Cell]:
        """All cells, those of external systems last."""
        return [self._cell(key) for key in (*self.keys, *self.systems)]

    def _cell(self, key: PaperKey) -> Cell:
        path = self.systems.get(key)
        identity: dict[str, Any] = {
            "first": self.first,
            "input": self.sources.identity(key),
            **code_of_trajectory(key),
        }
        if path:
            identity["trajectory"] = sha256(path.read_bytes())
        if self.surfaces:
            identity |= {
                "model": self.sources.model_name(key),
                "fusion": asdict(fuse_settings(key, self.first)),
                "quality": QualitySettings().to_dict(),
                "surface_code": code_of(_SURFACE),
            }
        return Cell(key, identity)

    def run(self, store: Store, workers: int, console: Console) -> list[str]:
        """Measure the missing cells; returns a sentence for each one that cannot be measured."""
        store.open({"first": self.first})
        cells = self.cells()
        missing = store.missing(cells)
        measured = len(cells) - len(missing)
        text = f"benchmark: {len(cells)} cells, {measured} of them already measured"
        if tracked := sum(self.tracked(cell, store) is not None for cell in missing):
            text += f"; of {tracked} only the surface is missing"
        if self.systems:
            text += f"; {len(self.systems)} of iclnuim run"
        console.note(text)
        problems: list[str] = []

        def on_problem(problem: str) -> None:
            problems.append(problem)
            console.note(problem)

        missing = self._with_models(missing, console)
        jobs = [self._job(cell, store) for cell in missing]
        noisy = {cell.key.sequence: cell.key for cell in missing if cell.key.seed}
        compile_first(list(self._short_jobs(missing)), min(workers, len(jobs)))
        total = sum(job.steps for job in jobs)
        total += sum(self.sources.frames(key, self.first) for key in noisy.values())
        advance = console.progress(total, "benchmark").advance

        def on_frame(number: int) -> None:
            advance(1)

        existing = [job for job, cell in zip(jobs, missing, strict=True) if not cell.key.seed]
        run_jobs(existing, workers, advance, on_problem)
        for sequence, key in noisy.items():
            self.sources.make_noise(key, self.first, on_frame)
            own = [job for job in jobs if job.name.startswith(f"{sequence}/")]
            run_jobs(own, workers, advance, on_problem)
            self.sources.remove_noise(key)
        if not problems:
            self.sources.remove_work()
        return problems

    def tracked(self, cell: Cell, store: Store) -> Measured | None:
        """The same cell as it was measured without a surface: its trajectory need not be estimated
        again.
        """
        found = store.read([replace(self, surfaces=False)._cell(cell.key)])
        if not found or not is_file(found[0].folder / TRAJECTORY) or "failed" in found[0].figures:
            return None
        return found[0]

    def core_seconds(self, cell: Cell, store: Store) -> float:
        """Expected core-seconds of a missing cell."""
        tracks = self.tracked(cell, store) is None
        return self.sources.frames(cell.key, self.first) * core_seconds(
            cell.key, tracks, self.surfaces
        )

    def _with_models(self, cells: Sequence[Cell], console: Console) -> list[Cell]:
        """The cells, without a model where its triangles cannot be read: no surface is measured,
        and a later call measures it.
        """
        rooms = dict.fromkeys(cell.identity["model"] for cell in cells if self.surfaces)
        failed = set()
        for room in filter(None, rooms):
            try:
                self.sources.model(room)
            except WorkError as error:
                failed.add(room)
                console.note(f"surfaces of {room} are not measured: {error}")
        found = []
        for cell in cells:
            if cell.identity.get("model") in failed:
                cell = replace(cell, identity={**cell.identity, "model": None})
            found.append(cell)
        return found

    def _job(self, cell: Cell, store: Store) -> Job:
        """The frames of a cell are tracked, if they are not yet, and fused."""
        task = self._task(cell)
        tracked = self.tracked(cell, store)

        def measure_cell(advance: Advance) -> None:
            if tracked:
                figures = measure_only_surface(task, tracked, advance)
            else:
                with store.files(cell) as folder:
                    figures = measure(task, folder, advance)
            store.write(cell, figures)

        tracks = tracked is None and task.trajectory is None
        passes = (task.model is not None) + tracks
        return Job(cell.key.place, measure_cell, passes * self.sources.frames(cell.key, self.first))

    def _task(self, cell: Cell) -> PaperTask:
        room = cell.identity.get("model")
        return PaperTask(
            key=cell.key,
            folder=self.sources.folder(cell.key),
            first=self.first,
            model=self.sources.model(room) if room else None,
            trajectory=self.systems.get(cell.key),
            work=self.sources.work,
        )

    def _short_jobs(self, cells: Sequence[Cell]) -> Iterator[Job]:
        """Three frames of one cell for each odometer, the first of which are also fused; nothing is
        kept.
        """
        first: dict[tuple, Cell] = {}
        for cell in cells:
            key = cell.key
            first.setdefault((key.odometer, key.preset, key.reference), cell)
        for cell in first.values():
            task = replace(self._task(cell), first=3)
            if cell is not next(iter(first.values())):
                task = replace(task, model=None)

            def try_cell(advance: Advance, task: PaperTask = task) -> None:
                with TemporaryDirectory() as folder:
                    measure(replace(task, work=Path(folder)), Path(folder), advance)

            yield Job(cell.key.place, try_cell, 1)
