"""Runs a system on a sequence several times, in a folder that can be resumed:

OUT/results.json                        the rows of all systems and sequences in OUT, as read by
                                        `bench odometry`
OUT/SYSTEM/SEQUENCE/recipe.json         the system's file, its options, the sequence, versions
OUT/SYSTEM/SEQUENCE/stage/              the view of the sequence for the system
OUT/SYSTEM/SEQUENCE/run_1/, run_2/ ...  out/ (the system's working folder), log.txt, ended.json,
matched/NAME.txt (the evaluated trajectory)
"""

import platform
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from iclnuim.dataset.run_folder import refuse_other
from iclnuim.errors import WorkError
from iclnuim.formats.files import (
    make_folder,
    read_bytes,
    read_json,
    sha256,
    whole_folder,
    write_json,
)
from iclnuim.shipped import source_commit
from iclnuim.version import __version__

from .evaluation import Evaluation, evaluate_run, row
from .process import Ended, run_command
from .staging import StagedSequence, unpacked
from .system import System

_SCHEMA_VERSION = 1
#: Keys of a recipe that decide the result.
_IDENTITY = (
    "schema_version",
    "system",
    "options",
    "program_sha256",
    "images_sha256",
    "camera",
    "depth_units_per_metre",
)
#: Keys of a system's file that do not decide the result.
_DESCRIPTIONS = ("about", "title", "install", "deterministic")


@dataclass(frozen=True, eq=False)
class Experiment:
    """A system and a sequence, and the folder OUT of their results."""

    system: System
    sequence: StagedSequence
    out: Path

    @property
    def folder(self) -> Path:
        names = (
            name.replace(":", "_").replace("/", "_")
            for name in (self.system.name, self.sequence.name)
        )
        return self.out.resolve().joinpath(*names)

    def prepare(self) -> dict[str, object]:
        """Make folder, recipe and view, or open the existing ones. Returns the values of the
        command's placeholders except {out}.

        Raises InputError if the folder contains another experiment, WorkError if something is
        missing or cannot be written.
        """
        stage, settings = self.folder / "stage", self.system.settings
        program = self.system.found_program()
        options = {
            **unpacked(self.system.options, self.out.resolve() / "options"),
            "program": program,
        }
        values = {**self.sequence.values(settings.stage, stage), **options}
        if (
            settings.check
            and subprocess.run(
                self.system.filled(settings.check, values), capture_output=True
            ).returncode
        ):
            raise WorkError(f"{self.system.name} cannot run with {program}", hint=settings.install)
        recipe, path = self._recipe(program), self.folder / "recipe.json"
        if path.is_file():
            words = {"images_sha256": "other images"}
            refuse_other(
                "experiment",
                path,
                _identity(read_json(path)),
                _identity(recipe),
                "another {out}",
                words,
            )
        make_folder(self.folder, hint="another {out}")
        if stage.is_dir() and not self.sequence.is_staged_in(stage):
            shutil.rmtree(stage)
        if not stage.is_dir():
            with whole_folder(stage) as temporary:
                self.sequence.write(settings.stage, temporary)
        if not path.is_file():
            write_json(path, recipe)
        return values

    def run(
        self, runs: int, limit_s: float, on_run: Callable[[], object] = lambda: None
    ) -> list[dict]:
        """Run the system until there are `runs` runs; returns the rows over all of them, one for
        each trajectory.

        A run that was killed at a shorter time limit is repeated. An interruption removes the
        current run and keeps the others.
        """
        values = self.prepare()
        for place in (places := [self.folder / f"run_{number}" for number in range(1, runs + 1)]):
            if not _is_done(place, limit_s):
                self._run_once(place, values, limit_s)
            on_run()
        ended = [Ended(**read_json(place / "ended.json")["ended"]) for place in places]
        return [self._row(name, places, ended) for name in self.system.trajectories]

    def _run_once(self, place: Path, values: dict[str, object], limit_s: float) -> None:
        shutil.rmtree(place, ignore_errors=True)
        with whole_folder(place) as temporary:
            make_folder(temporary / "out")
            values = {**values, "out": temporary / "out"}
            command = self.system.filled(self.system.settings.command, values)
            names, texts = list(self.system.environment), tuple(self.system.environment.values())
            environment = dict(zip(names, self.system.filled(texts, values), strict=True))
            ended = run_command(
                command, temporary / "out", temporary / "log.txt", limit_s, environment
            )
            command = [text.replace(str(temporary), str(place)) for text in command]
            write_json(
                temporary / "ended.json",
                {"ended": asdict(ended), "limit_s": limit_s, "command": command},
            )

    def _row(self, name: str, places: list[Path], ended: list[Ended]) -> dict:
        pairs = zip(places, ended, strict=True)
        runs = [(e, evaluate_run(self.sequence, self.system, name, place, e)) for place, e in pairs]
        alone = name == "final" or len(self.system.trajectories) == 1
        values = row(
            self.system.title if alone else f"{self.system.title} {name}",
            len(self.sequence.pairs),
            runs,
        )
        return {**values, "each": [_both(*run) for run in runs]}

    def _recipe(self, program: str) -> dict:
        camera = self.sequence.camera
        return {
            "schema_version": _SCHEMA_VERSION,
            "system": dict(self.system.content),
            "options": {
                key: value for key, value in self.system.options.items() if key != "program"
            },
            "program": program,
            "program_sha256": sha256(read_bytes(program)),
            "sequence": self.sequence.name,
            "images_sha256": self.sequence.images_sha256,
            "camera": camera.pinhole.to_dict(),
            "depth_units_per_metre": camera.depth_units_per_metre,
            "stamp_offset_s": self.sequence.offset_s(self.system.settings.stage),
            "versions": {"iclnuim": __version__, "python": platform.python_version()},
            "source_commit": source_commit(),
            "machine": platform.platform(),
        }


def _identity(recipe: dict) -> dict:
    """What decides the result."""
    found = {key: recipe.get(key) for key in _IDENTITY}
    if isinstance(found["system"], dict):
        found["system"] = {
            key: value for key, value in found["system"].items() if key not in _DESCRIPTIONS
        }
    return found


def _both(ended: Ended, evaluation: Evaluation) -> dict:
    return {**asdict(ended), **asdict(evaluation), "notes": list(evaluation.notes)}


def _is_done(place: Path, limit_s: float) -> bool:
    if not (place / "ended.json").is_file():
        return False
    content = read_json(place / "ended.json")
    return content["ended"]["how"] != "time limit" or content["limit_s"] >= limit_s


def merged(comparisons: list[dict]) -> list[dict]:
    """Merge rows of one sequence: of odometers with the same preset, and of systems, which have no
    preset, with any. The later of two rows with
    one name replaces the earlier.
    """
    found: list[dict] = []
    for comparison in sorted(comparisons, key=lambda one: one["preset"] is None):
        same = [one for one in found if one["sequence"] == comparison["sequence"]]
        existing = next(
            (one for one in same if comparison["preset"] in (None, one["preset"])), None
        )
        if existing is None:
            found.append(comparison)
            continue
        names = [row["odometer"] for row in comparison["runs"]]
        existing["runs"] = [
            row for row in existing["runs"] if row["odometer"] not in names
        ] + comparison["runs"]
    return found


def write_results(out: Path, comparisons: list[dict]) -> list[dict]:
    """Merge results into OUT/results.json, and return all of them."""
    path = out / "results.json"
    everything = merged([*(read_json(path)["races"] if path.is_file() else ()), *comparisons])
    write_json(path, {"races": everything})
    return everything
