"""The plan of a run: job, frames, sequences, and how the work is distributed.

`resume` reads its record in the run folder.
"""

import re
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from iclnuim.dataset.bags_and_logs import LogSettings
from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.run_folder import read_run
from iclnuim.dataset.sequence import SequenceSettings, complete_frames
from iclnuim.dataset.sequence_options import SequenceOptions
from iclnuim.errors import InputError
from iclnuim.formats.files import read_json, read_text, write_json
from iclnuim.job import RenderJob
from iclnuim.settings import Settings, refuse_unknown, setting

from .chunks import numbers_from, numbers_text

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
class FarmSettings(Settings):
    """How the work is distributed; these settings do not change a pixel."""

    group: ClassVar[str] = "the farm"

    engine: str = setting(
        "local",
        "where it runs",
        choices={"local": "this machine", "slurm": "an existing Slurm cluster"},
    )
    workers: int | None = setting(
        None,
        "number of rendering processes, at most one per core; default: one per two cores",
        low=1,
    )
    worker_timeout_s: float = setting(
        120.0,
        "a worker that has sent nothing for this time is replaced; it sends a heartbeat every 2 s",
        unit="s",
        low=5.0,
        option="--worker-timeout",
    )
    start_timeout_s: float = setting(
        1800.0, "the same, until the scene is prepared", unit="s", low=1.0, option=""
    )
    frame_timeout_s: float = setting(
        3600.0,
        "the same, without a finished frame, as heartbeats continue if rendering hangs",
        unit="s",
        low=1.0,
        option="",
    )
    attempts: int = setting(
        3, "a frame is given up after it has ended this number of workers", low=1, option=""
    )
    max_frames: int = setting(
        2000, "a worker is replaced after this number of frames", low=1, option=""
    )
    max_mb: float = setting(
        6000.0, "a worker is replaced when it takes more memory", unit="MB", low=1.0, option=""
    )


@dataclass(frozen=True)
class SlurmSettings(Settings):
    """Resources of a task. The keys of the TOML file are these names; command-line options take
    precedence over the file.
    """

    group: ClassVar[str] = "Slurm's settings"

    partition: str | None = setting(None, "Slurm partition")
    account: str | None = setting(None, "Slurm account that is charged")
    qos: str | None = setting(None, "Slurm quality of service", option="")
    constraint: str | None = setting(None, "required features of the nodes", option="")
    time: str | None = setting(
        None, "time limit of a task, such as 30, 2:00:00 or 1-12; default: from the estimate"
    )
    memory: str = setting("4G", "memory of a task, such as 4G or 900M")
    cpus: int = setting(4, "cores of a task, two for each worker process", low=1)
    chunk_minutes: float = setting(6.0, "work of a frame task", unit="min", low=1e-6)
    at_once: int = setting(
        256, "maximum number of tasks that run at the same time", low=1, option=""
    )
    scratch: str | None = setting(
        None,
        "folder on the node for Blender's raw frames, such as '$TMPDIR'; variables are expanded on the node",
    )
    python: str | None = setting(
        None, "command that runs Python on the nodes, such as a container", option=""
    )
    setup: tuple[str, ...] = ()
    extra: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not re.fullmatch(r"\d+[KMGT]?", self.memory):
            raise InputError("a size such as 4G or 900M", setting="memory", found=self.memory)
        if self.time is not None:
            minutes(self.time)
        if not isinstance(self.setup, list | tuple) or not all(
            isinstance(line, str) for line in self.setup
        ):
            raise InputError("a list of shell lines", setting="setup", found=self.setup)
        object.__setattr__(self, "setup", tuple(self.setup))
        if not isinstance(self.extra, dict):
            raise InputError("a table of sbatch options", setting="extra", found=self.extra)


def minutes(text: str | int) -> int:
    """Minutes of a time in Slurm's formats M, M:S, H:M:S, D-H, D-H:M, D-H:M:S, rounded up.

    Raises InputError.
    """
    form = re.fullmatch(r"(?:(\d+)-)?(\d+)(?::(\d+))?(?::(\d+))?", str(text))
    if form is None:
        raise InputError("a time such as 30, 2:00:00 or 1-12", setting="time", found=text)
    days, *rest = form.groups()
    parts = [int(part) for part in rest if part is not None]
    if days is None and len(parts) < 3:
        parts.insert(0, 0)  # without days, hours are written only before M:S
    hours, mins, secs = [*parts, 0, 0][:3]
    total = (int(days or 0) * 24 + hours) * 60 + mins + (secs > 0)
    if total < 1:
        raise InputError("a time of at least a minute", setting="time", found=text)
    return total


def read_settings(path: Path) -> SlurmSettings:
    """Read the settings in a TOML file. Raises InputError for unknown keys and invalid values."""
    try:
        content: dict[str, Any] = tomllib.loads(read_text(path, "Slurm settings in TOML"))
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=path, found=error) from None
    for name in {"time", "memory"} & content.keys():
        content[name] = str(content[name])
    try:
        return SlurmSettings.from_dict(content)
    except InputError as error:
        raise error.at(path) from None


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
    logs: LogSettings = field(default_factory=LogSettings)
    working_folder: str = field(default_factory=lambda: str(Path.cwd()))
    held_out: str = ""
    noisy: bool = True

    @property
    def command(self) -> str:
        """`make` if the plan has sequences, else `render`."""
        return "render" if self.sequences is None else "make"

    @property
    def out(self) -> Path:
        """The value of the command's --out."""
        return self.raw if self.sequences is None else self.raw.parent

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats of the sequences."""
        return () if self.sequences is None else self.sequences.formats

    def variants(self) -> dict[Path, SequenceSettings]:
        """Folder -> settings, for each sequence.

        Raises InputError for an unknown noise model or parameter.
        """
        if self.sequences is None:
            return {}
        clean, noisy = self.sequences.without_noise(), self.sequences.sequence_settings()
        return {self.out / "clean": clean, **({self.out / "noisy": noisy} if self.noisy else {})}

    def missing(self) -> list[int]:
        """Frames that are neither rendered nor written to the sequences, according to the files of
        the folder.
        """
        if not (self.raw / "sequence.json").is_file():
            return list(self.numbers)
        run, made = read_run(self.raw), set()
        if self.sequences is not None:
            source = frames_of_run(run, list(self.numbers))
            made = complete_frames(source, self.variants(), self.formats)
        return run.missing([n for n in self.numbers if n not in made])

    def to_dict(self) -> dict[str, Any]:
        """The record. It does not contain the run folder, which may be moved."""
        return {
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
            **({"held_out": self.held_out} if self.held_out else {}),
            **({} if self.noisy else {"noisy": False}),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], raw: Path) -> "RunPlan":
        """The plan of a record, for the current folder of the run. Raises InputError for unknown
        keys and invalid values.

        The folder in which the command was called is added to the search path, for the user's own
        noise model.
        """
        if content.get("schema_version") != SCHEMA_VERSION:
            found = content.get("schema_version")
            raise InputError(
                f"schema_version {SCHEMA_VERSION}", found=found, hint="a newer iclnuim"
            )
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
            logs=LogSettings.from_dict(content["logs"]),
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
    raise InputError(
        "the output folder of `iclnuim render` or `make`", path=folder, found=f"no {RECORD}"
    )


def read_plan(raw: Path) -> RunPlan:
    """Read the recorded plan of a run folder.

    Raises InputError, which names the record, if it is invalid.
    """
    try:
        return RunPlan.from_dict(read_json(raw / RECORD), raw)
    except KeyError as error:
        raise InputError(f"the key {error}", path=raw / RECORD) from None
    except InputError as error:
        raise error if error.path else error.at(raw / RECORD) from None


def _find_modules_of(record: Mapping[str, Any]) -> None:
    if record["working_folder"] not in sys.path:
        sys.path.append(record["working_folder"])
