"""The plan of a run: job, frames, sequences, and how the work is distributed.

`resume` reads its record in the run folder.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from iclnuim.errors import InputError
from iclnuim.formats.files import read_json, write_json
from iclnuim.job import RenderJob
from iclnuim.scene_files.blend_file import may_simulate
from iclnuim.sequences.bag_writer import BagSettings
from iclnuim.sequences.frame_source import frames_of_run
from iclnuim.sequences.journal import read_entries
from iclnuim.sequences.run_folder import read_run
from iclnuim.sequences.sequence_options import SequenceOptions, SequenceSettings
from iclnuim.sequences.writer import complete_frames
from iclnuim.settings import refuse_unknown

from .chunks import numbers_from, numbers_text
from .farm_settings import FarmSettings, SlurmSettings

SCHEMA_VERSION = 2
#: The record of a run, relative to the run folder.
RECORD = ".farm/command.json"
_KEYS = (
    "schema_version",
    "command",
    "working_folder",
    "job",
    "frames",
    "sequences",
    "keep_raw",
    "farm",
    "slurm",
    "logs",
    "held_out",
    "noisy",
)


@dataclass(frozen=True)
class RunPlan:
    """Render frames `numbers` of `job` into the run folder `raw`, and with `sequences` write the
    sequences clean/ and noisy/ next to it.

    working_folder: folder in which the command was called; it may contain the user's own noise
    model. held_out: number of held-out views, or their trajectory, "" for none. noisy: whether
    noisy/ is written too.
    """

    job: RenderJob
    raw: Path
    numbers: tuple[int, ...]
    sequences: SequenceOptions | None = None
    keep_raw: bool = True
    farm: FarmSettings = field(default_factory=FarmSettings)
    slurm: SlurmSettings = field(default_factory=SlurmSettings)
    logs: BagSettings = field(default_factory=BagSettings)
    working_folder: str = field(default_factory=lambda: str(Path.cwd()))
    held_out: str = ""
    noisy: bool = True

    @property
    def command(self) -> str:
        """`make` if the plan has sequences, else `render`."""
        if self.sequences is None:
            return "render"
        return "make"

    @property
    def out(self) -> Path:
        """The value of the command's --out."""
        if self.sequences is None:
            return self.raw
        return self.raw.parent

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats of the sequences."""
        if self.sequences is None:
            return ()
        return self.sequences.formats

    def variants(self) -> dict[Path, SequenceSettings]:
        """Folder -> settings, for each sequence.

        Raises InputError for an unknown noise model or parameter.
        """
        if self.sequences is None:
            return {}
        noisy = self.sequences.sequence_settings()
        found = {self.out / "clean": self.sequences.without_noise()}
        if self.noisy:
            found[self.out / "noisy"] = noisy
        return found

    @property
    def may_simulate(self) -> bool:
        """Whether simulations may have to be baked first."""
        return may_simulate(Path(self.job.scene))

    def missing(self) -> list[int]:
        """Frames that are neither rendered nor written to the sequences, according to the files of
        the folder.
        """
        if not (self.raw / "sequence.json").is_file():
            return list(self.numbers)
        run = read_run(self.raw)
        made = set()
        if self.sequences is not None:
            source = frames_of_run(run, list(self.numbers))
            made = complete_frames(source, self.variants(), self.formats)
        return run.missing([n for n in self.numbers if n not in made])

    def unwritten(self) -> int:
        """Number of frames that are missing in the journal of at least one sequence; of a run without
        sequences, of those that are not rendered.
        """
        if self.sequences is None:
            return len(self.missing())
        made = set(self.numbers)
        for folder in self.variants():
            made &= read_entries(folder).keys()
        return len(self.numbers) - len(made)

    def to_dict(self) -> dict[str, Any]:
        """The record. It does not contain the run folder, which may be moved."""
        record = {
            "schema_version": SCHEMA_VERSION,
            "command": self.command,
            "working_folder": self.working_folder,
            "job": self.job.to_dict(),
            "frames": numbers_text(self.numbers),
            "sequences": None if self.sequences is None else self.sequences.to_dict(),
            "keep_raw": self.keep_raw,
            "farm": self.farm.to_dict(),
            "slurm": self.slurm.to_dict(),
            "logs": self.logs.to_dict(),
        }
        if self.held_out:
            record["held_out"] = self.held_out
        if not self.noisy:
            record["noisy"] = False
        return record

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], raw: Path) -> "RunPlan":
        """The plan of a record, for the current folder of the run. Raises InputError for unknown
        keys and invalid values.

        The folder in which the command was called is added to the search path, for the user's own
        noise model.
        """
        if content.get("schema_version") != SCHEMA_VERSION:
            found = content.get("schema_version")
            expected = f"schema_version {SCHEMA_VERSION}"
            raise InputError(expected, found=found, hint="running its command again")
        refuse_unknown(content, _KEYS, "the record of a run")
        _find_modules_of(content)
        sequences = content["sequences"]
        return cls(
            job=RenderJob.from_dict(content["job"]),
            raw=raw,
            numbers=numbers_from(str(content["frames"])),
            sequences=None if sequences is None else SequenceOptions.from_dict(sequences),
            keep_raw=content["keep_raw"],
            farm=FarmSettings.from_dict(content["farm"]),
            slurm=SlurmSettings.from_dict(content["slurm"]),
            logs=BagSettings.from_dict(content["logs"]),
            working_folder=content["working_folder"],
            held_out=content.get("held_out", ""),
            noisy=content.get("noisy", True),
        )

    def has_record(self) -> bool:
        """Whether the run folder has a record, of this command or of an earlier one."""
        return (self.raw / RECORD).is_file()

    def write_record(self) -> None:
        """Write the record into the run folder."""
        (self.raw / RECORD).parent.mkdir(parents=True, exist_ok=True)
        write_json(self.raw / RECORD, self.to_dict())


def find_run(folder: Path) -> Path:
    """The run folder (that of the frames) for a value of --out.

    Raises InputError if no command was recorded.
    """
    for raw in (folder, folder / "raw"):
        if (raw / RECORD).is_file():
            return raw
    expected = "the output folder of `iclnuim render` or `make`"
    raise InputError(expected, path=folder, found=f"no {RECORD}")


def read_plan(raw: Path) -> RunPlan:
    """Read the recorded plan of a run folder.

    Raises InputError, which names the record, if it is invalid.
    """
    try:
        return RunPlan.from_dict(read_json(raw / RECORD), raw)
    except KeyError as error:
        raise InputError(f"the key {error}", path=raw / RECORD) from None
    except InputError as error:
        if error.path:
            raise
        raise error.at(raw / RECORD) from None


def _find_modules_of(record: Mapping[str, Any]) -> None:
    if record["working_folder"] not in sys.path:
        sys.path.append(record["working_folder"])
