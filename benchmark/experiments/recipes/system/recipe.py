"""The recipe of `iclnuim run`: a system on a sequence, several times.

OUT/results.json                        the rows of all systems and sequences, as read by
                                        `bench odometry`
OUT/cells/SYSTEM/SEQUENCE/stage/        the view of the sequence for the system
OUT/cells/SYSTEM/SEQUENCE/run_1/ ...    out/ (the system's working folder), log.txt,
                                        matched/NAME.txt (the evaluated trajectory)
"""

import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import is_file, read_bytes, read_json, sha256, whole_folder, write_json

from ....systems.evaluation import Evaluation, evaluate_run, row
from ....systems.process import Ended, run_command
from ....systems.staging import StagedSequence, unpacked
from ....systems.system import System
from ...cell import Cell
from ...store import Store
from ...table import ResultTable, mm

KIND = "systems"
#: Keys of a system's file that do not decide the result.
_DESCRIPTIONS = ("about", "title", "install", "deterministic", "has_scale")
#: What follows the name of a system without scale wherever its errors stand beside others.
_ALIGNED = " (Sim(3))"


@dataclass(frozen=True)
class RunKey:
    """A run of a system on a sequence; runs count from 1."""

    system: str
    sequence: str
    run: int

    @property
    def place(self) -> str:
        return f"{_file_name(self.system)}/{_file_name(self.sequence)}/run_{self.run}"


def _file_name(name: str) -> str:
    return re.sub("[:/]", "_", name)


def system_store(out: Path) -> Store:
    """The store of `iclnuim run` in a folder."""
    return Store(out.resolve(), KIND, keeps=True)


@dataclass(frozen=True, eq=False)
class SystemRuns:
    """The runs of a system on a sequence, in a store."""

    system: System
    sequence: StagedSequence
    store: Store

    @property
    def folder(self) -> Path:
        """The folder of the view and of all runs."""
        return self.store.folder(RunKey(self.system.name, self.sequence.name, 1)).parent

    def cells(self, runs: int) -> list[Cell]:
        """The cells of the first runs."""
        identity = self._identity()
        keys = (RunKey(self.system.name, self.sequence.name, k) for k in range(1, runs + 1))
        return [Cell(key, identity) for key in keys]

    def prepare(self) -> dict[str, object]:
        """Make the view, or open the existing one. Returns the values of the command's placeholders
        except {out}.

        Raises InputError if the folder has runs of something else, WorkError if something is
        missing or cannot be written.
        """
        stage = self.folder / "stage"
        settings = self.system.settings
        program = self.system.found_program()
        options = unpacked(self.system.options, self.store.out / "options") | {"program": program}
        values = {**self.sequence.values(settings.stage, stage), **options}
        if settings.check:
            check = self.system.filled(settings.check, values)
            if subprocess.run(check, capture_output=True).returncode:
                text = f"{self.system.name} cannot run with {program}"
                raise WorkError(text, hint=settings.install)
        self.store.open({})
        self.store.missing(self.cells(1))
        if stage.is_dir() and not self.sequence.is_staged_in(stage):
            shutil.rmtree(stage)
        if not stage.is_dir():
            with whole_folder(stage) as temporary:
                self.sequence.write(settings.stage, temporary)
        return values

    def there(self, runs: int, limit_s: float) -> int:
        """Number of the first `runs` runs that run() would keep."""
        return sum(self._is_done(cell, limit_s) for cell in self.cells(runs))

    def run(
        self, runs: int, limit_s: float, on_run: Callable[[], object] = lambda: None
    ) -> list[dict[str, Any]]:
        """Run the system until there are `runs` runs; returns the rows over all of them, one for
        each trajectory.

        A run that was killed at a shorter time limit is repeated. An interruption removes the
        current run and keeps the others.
        """
        values = self.prepare()
        cells = self.cells(runs)
        for cell in cells:
            if not self._is_done(cell, limit_s):
                self._run_once(cell, values, limit_s)
            on_run()
        measured = self.store.read(cells)
        places = [one.folder for one in measured]
        ended = [Ended(**one.figures["ended"]) for one in measured]
        return [self._row(name, places, ended) for name in self.system.trajectories]

    def _is_done(self, cell: Cell, limit_s: float) -> bool:
        for one in self.store.read([cell]):
            return one.figures["ended"]["how"] != "time limit" or one.figures["limit_s"] >= limit_s
        return False

    def _run_once(self, cell: Cell, values: dict[str, object], limit_s: float) -> None:
        with self.store.files(cell) as temporary:
            folder = temporary / "out"
            folder.mkdir()
            values = {**values, "out": folder}
            command = self.system.filled(self.system.settings.command, values)
            texts = self.system.filled(tuple(self.system.environment.values()), values)
            environment = dict(zip(self.system.environment, texts, strict=True))
            ended = run_command(command, folder, temporary / "log.txt", limit_s, environment)
        place = str(self.store.folder(cell.key))
        command = [text.replace(str(temporary), place) for text in command]
        figures = {"ended": asdict(ended), "limit_s": limit_s, "command": command}
        self.store.write(cell, {"title": self.system.title, **figures})

    def _row(self, name: str, places: list[Path], ended: list[Ended]) -> dict[str, Any]:
        runs = []
        for place, one in zip(places, ended, strict=True):
            runs.append((one, evaluate_run(self.sequence, self.system, name, place, one)))
        alone = name == "final" or len(self.system.trajectories) == 1
        title = self.system.title if alone else f"{self.system.title} {name}"
        title += _ALIGNED * (not self.system.settings.has_scale)
        values = row(title, len(self.sequence.pairs), runs)
        return {**values, "each": [_both(*run) for run in runs]}

    def _identity(self) -> dict[str, Any]:
        """What decides the result of a run."""
        content = {k: v for k, v in self.system.content.items() if k not in _DESCRIPTIONS}
        camera = self.sequence.camera
        identity = {
            "system": content,
            "options": self.system.chosen_options,
            "program_sha256": sha256(read_bytes(self.system.found_program())),
            "sequence_sha256": self.sequence.images_sha256,
            "camera": camera.pinhole.to_dict(),
            "depth_units_per_metre": camera.depth_units_per_metre,
        }
        stage = self.system.settings.stage
        if stage.imu:
            identity["imu_sha256"] = sha256(self.sequence.imu_text(stage).encode())
        return identity


def _both(ended: Ended, evaluation: Evaluation) -> dict[str, Any]:
    return {**asdict(ended), **asdict(evaluation), "notes": list(evaluation.notes)}


def merged(comparisons: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge rows of one sequence: of odometers with the same preset, and of systems, which have no
    preset, with any. The later of two rows with one name replaces the earlier.
    """
    found: list[dict[str, Any]] = []
    for comparison in sorted(comparisons, key=lambda one: one["preset"] is None):
        same = [one for one in found if one["sequence"] == comparison["sequence"]]
        fitting = [one for one in same if comparison["preset"] in (None, one["preset"])]
        if not fitting:
            found.append(comparison)
            continue
        names = [row["odometer"] for row in comparison["runs"]]
        kept = [row for row in fitting[0]["runs"] if row["odometer"] not in names]
        fitting[0]["runs"] = kept + comparison["runs"]
    return found


def read_results(path: Path) -> list[dict[str, Any]]:
    """Results that were written with --json or as results.json.

    Raises InputError for another file, and for one of an older version.
    """
    results = read_json(path).get("results")
    if not isinstance(results, list):
        what = "output of `iclnuim bench odometry --json` or `iclnuim run`"
        raise InputError(what, path=path, hint="if it is an older one, to run it again")
    return results


def write_results(out: Path, comparisons: Sequence[dict[str, Any]]) -> None:
    """Merge results into OUT/results.json."""
    path = out / "results.json"
    existing = read_results(path) if is_file(path) else []
    write_json(path, {"results": merged([*existing, *comparisons])})


_COLUMNS = (
    "", "runs", "covered", "ATE mm", "quartiles", "RPE mm/s", "wall s", "CPU s", "MB",
)  # fmt: skip


def runs_table(result: dict[str, Any]) -> ResultTable:
    """A row for each trajectory of a system, with medians over its runs, followed by the notes
    about these runs. Systems with an IMU have a column for its initialisation.
    """
    rows = []
    notes = []
    has_imu = any(r.get("initialised_s") is not None for r in result["runs"])
    for r in result["runs"]:
        killed = any("killed at" in note for note in r["notes"])
        quartiles_m = r["ate_quartiles_m"] or []
        rows.append(
            (
                r["odometer"],
                f"{r['good_runs']}/{r['runs']}{', some killed' * killed}",
                f"{r['coverage']:.1%}",
                mm(r["ate_rmse_m"], ".3f"),
                " .. ".join(mm(value, ".3f") for value in quartiles_m) or "-",
                mm(r["rpe_1s_rmse_m"], ".3f"),
                f"{r['wall_s']:.1f}",
                f"{r['cpu_s']:.1f}",
                f"{r['peak_bytes'] / 1e6:.0f}",
                *[_seconds(r.get("initialised_s"))] * has_imu,
            )
        )
        notes += [f"{r['odometer']}: {note}" for note in r["notes"]]
    columns = (*_COLUMNS, *["IMU s"] * has_imu)
    return ResultTable("runs", result["sequence"], columns, tuple(rows), notes=tuple(notes))


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
