"""How tasks are asked of Slurm: settings from options or a TOML file."""

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from iclnuim.errors import InputError
from iclnuim.formats.files import read_text
from iclnuim.settings import Settings, setting


@dataclass(frozen=True)
class SlurmSettings(Settings):
    """What a task asks for. Keys of the TOML file are these names; options of the command line take precedence over the file."""

    group: ClassVar[str] = "Slurm's settings"

    partition: str | None = setting(None, "Slurm's partition")
    account: str | None = setting(None, "Slurm's account, which pays")
    qos: str | None = setting(None, "Slurm's quality of service", option="")
    constraint: str | None = setting(None, "features of the nodes", option="")
    time: str | None = setting(None, "limit of a task, such as 30, 2:00:00 or 1-12; default: from the estimate")
    memory: str = setting("4G", "memory of a task, such as 4G or 900M")
    cpus: int = setting(4, "cores of a task, two for each worker process", low=1)
    chunk_minutes: float = setting(6.0, "work of a frame task", unit="min", low=1e-6)
    at_once: int = setting(256, "tasks that run at the same time, at most", low=1, option="")
    scratch: str | None = setting(
        None, "folder on the node for Blender's raw frames, such as '$TMPDIR'; the node's variables are filled in"
    )
    python: str | None = setting(None, "what runs Python on the nodes, such as a container", option="")
    setup: tuple[str, ...] = ()
    extra: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not re.fullmatch(r"\d+[KMGT]?", self.memory):
            raise InputError("a size such as 4G or 900M", setting="memory", found=self.memory)
        if self.time is not None:
            minutes(self.time)
        if not isinstance(self.setup, list | tuple) or not all(isinstance(line, str) for line in self.setup):
            raise InputError("a list of shell lines", setting="setup", found=self.setup)
        object.__setattr__(self, "setup", tuple(self.setup))
        if not isinstance(self.extra, dict):
            raise InputError("a table of sbatch options", setting="extra", found=self.extra)

    @property
    def time_min(self) -> int | None:
        """Minutes, where a time was asked for."""
        return None if self.time is None else minutes(self.time)


def minutes(text: str | int) -> int:
    """Slurm's forms: M, M:S, H:M:S, D-H, D-H:M, D-H:M:S; rounded up. Raises InputError."""
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
    """Settings of a TOML file. Raises InputError for unknown keys and values that do not fit."""
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
