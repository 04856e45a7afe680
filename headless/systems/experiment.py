"""A system on a sequence, several times, in a folder that can be taken up again:

OUT/results.json                        the rows of all systems and sequences there, as `bench odometry` reads them
OUT/SYSTEM/SEQUENCE/recipe.json         the system's file, its options, the sequence, versions
OUT/SYSTEM/SEQUENCE/stage/              the view of the sequence that the system is given
OUT/SYSTEM/SEQUENCE/run_1/ and on       out/ (the system's working folder), log.txt, ended.json, matched/NAME.txt (what is measured)
"""

import platform
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import iclnuim
from iclnuim.dataset.run_folder import refuse_other
from iclnuim.errors import WorkError
from iclnuim.formats.files import make_folder, read_bytes, read_json, sha256, whole_folder, write_json
from iclnuim.shipped import source_commit

from .judge import Verdict, judge, row
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


@dataclass(frozen=True, eq=False)
class Experiment:
    """A system and a sequence, and the folder OUT of their results."""

    system: System
    sequence: StagedSequence
    out: Path

    @property
    def folder(self) -> Path:
        names = (name.replace(":", "_").replace("/", "_") for name in (self.system.name, self.sequence.name))
        return self.out.resolve().joinpath(*names)

    def prepare(self) -> dict[str, object]:
        """Make folder, recipe and view, or open those that are there; what the command's placeholders stand for, but {out}.

        Raises InputError where another experiment lies there, WorkError where something is missing or cannot be written.
        """
        stage, settings = self.folder / "stage", self.system.settings
        program = self.system.found_program()
        options = {**unpacked(self.system.options, self.out.resolve() / "options"), "program": program}
        values = {**self.sequence.values(settings.stage, stage), **options}
        if (
            settings.check
            and subprocess.run(self.system.filled(settings.check, values), capture_output=True).returncode
        ):
            raise WorkError(f"{self.system.name} cannot run with {program}", hint=settings.install)
        recipe, place = self._recipe(program), self.folder / "recipe.json"
        if place.is_file():
            there, asked = ({key: one.get(key) for key in _IDENTITY} for one in (read_json(place), recipe))
            refuse_other("experiment", place, there, asked, "another {out}")
        make_folder(self.folder, hint="another {out}")
        if not stage.is_dir():
            with whole_folder(stage) as temporary:
                self.sequence.write(settings.stage, temporary)
        if not place.is_file():
            write_json(place, recipe)
        return values

    def run(self, runs: int, limit_s: float, on_run: Callable[[], object] = lambda: None) -> list[dict]:
        """As many runs as are missing to `runs`, one after the other; the rows of all of them, one for each trajectory.

        A run that was killed at a shorter limit is done again. Interrupted, the run at work is removed, and the others stay.
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
            ended = run_command(command, temporary / "out", temporary / "log.txt", limit_s, environment)
            command = [text.replace(str(temporary), str(place)) for text in command]
            write_json(temporary / "ended.json", {"ended": asdict(ended), "limit_s": limit_s, "command": command})

    def _row(self, name: str, places: list[Path], ended: list[Ended]) -> dict:
        runs = [(e, judge(self.sequence, self.system, name, place, e)) for place, e in zip(places, ended, strict=True)]
        alone = name == "final" or len(self.system.trajectories) == 1
        values = row(self.system.title if alone else f"{self.system.title} {name}", len(self.sequence.pairs), runs)
        return {**values, "each": [_both(*run) for run in runs]}

    def _recipe(self, program: str) -> dict:
        camera = self.sequence.camera
        return {
            "schema_version": _SCHEMA_VERSION,
            "system": dict(self.system.content),
            "options": {key: value for key, value in self.system.options.items() if key != "program"},
            "program": program,
            "program_sha256": sha256(read_bytes(program)),
            "sequence": self.sequence.name,
            "images_sha256": self.sequence.list_sha256,
            "camera": camera.pinhole.to_dict(),
            "depth_units_per_metre": camera.depth_units_per_metre,
            "stamp_offset_s": self.sequence.offset_s(self.system.settings.stage),
            "versions": {"iclnuim": iclnuim.__version__, "python": platform.python_version()},
            "source_commit": source_commit(),
            "machine": platform.platform(),
        }


def _both(ended: Ended, verdict: Verdict) -> dict:
    return {**asdict(ended), **asdict(verdict), "notes": list(verdict.notes)}


def _is_done(place: Path, limit_s: float) -> bool:
    if not (place / "ended.json").is_file():
        return False
    content = read_json(place / "ended.json")
    return content["ended"]["how"] != "time limit" or content["limit_s"] >= limit_s


def merged(races: list[dict]) -> list[dict]:
    """Results with the rows of systems, which have no preset of ours, put beside the other rows of their sequence; of two rows of one
    system the later counts.
    """
    found: list[dict] = []
    for race in sorted(races, key=lambda race: race["preset"] is None):
        there = next((one for one in found if one["sequence"] == race["sequence"]), None)
        if race["preset"] is not None or there is None:
            found.append(race)
            continue
        names = [row["odometer"] for row in race["runs"]]
        there["runs"] = [row for row in there["runs"] if row["odometer"] not in names] + race["runs"]
    return found


def write_results(out: Path, races: list[dict]) -> list[dict]:
    """Put results beside those that OUT/results.json has, and return all of them."""
    place = out / "results.json"
    everything = merged([*(read_json(place)["races"] if place.is_file() else ()), *races])
    write_json(place, {"races": everything})
    return everything
