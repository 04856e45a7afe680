"""Settings of the farm, and of the tasks that it gives to Slurm."""

import re
import tomllib
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Any, ClassVar

from iclnuim.errors import InputError
from iclnuim.formats.files import read_text
from iclnuim.settings import Settings, setting


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
        "folder on the node for Blender's raw frames, such as '$TMPDIR'; "
        "variables are expanded on the node",
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
        is_list = isinstance(self.setup, list | tuple)
        if not is_list or not all(isinstance(line, str) for line in self.setup):
            raise InputError("a list of shell lines", setting="setup", found=self.setup)
        object.__setattr__(self, "setup", tuple(self.setup))
        if not isinstance(self.extra, dict):
            raise InputError("a table of sbatch options", setting="extra", found=self.extra)


def limit_minutes(expected: float) -> int:
    """The time limit of a task that is expected to take this number of minutes."""
    return max(30, ceil(4 * expected))


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
