"""How tasks are asked of Slurm: settings from options or a TOML file."""

from __future__ import annotations

import argparse
import re
import tomllib
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import read_text


@dataclass(frozen=True)
class SlurmSettings:
    """What a task asks for. Keys of the TOML file are these names; options of the command line stand above the file.

    `time` and `memory` as Slurm writes them (30, 2:00:00, 1-12; 4G, 900M), time by default from the estimate. `cpus` of a task: two for
    each worker process. `chunk_minutes` of work a frame task. `at_once`: most tasks running together. `scratch`: a folder on the node for
    Blender's raw frames; the node's variables are filled in. `python`: what runs Python on the nodes, such as a container. `setup`: shell
    lines before. `extra`: further sbatch options.
    """

    partition: str | None = None
    account: str | None = None
    qos: str | None = None
    constraint: str | None = None
    time: str | None = None
    memory: str = "4G"
    cpus: int = 4
    chunk_minutes: float = 6.0
    at_once: int = 256
    scratch: str | None = None
    python: str | None = None
    setup: tuple[str, ...] = ()
    extra: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind, least in (("cpus", int, 1), ("at_once", int, 1), ("chunk_minutes", int | float, 1e-6)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, kind) or value < least:
                raise InputError(f"{name} of at least {least}", found=value)
        if not re.fullmatch(r"\d+[KMGT]?", str(self.memory)):
            raise InputError("memory such as 4G or 900M", found=self.memory)
        if self.time is not None:
            minutes(self.time)
        for name in ("partition", "account", "qos", "constraint", "scratch", "python"):
            if not isinstance(getattr(self, name), str | None):
                raise InputError(f"{name} as text", found=getattr(self, name))
        if not isinstance(self.setup, tuple) or not all(isinstance(line, str) for line in self.setup):
            raise InputError("setup as a list of shell lines", found=self.setup)
        if not isinstance(self.extra, dict):
            raise InputError("extra as a table of sbatch options", found=self.extra)

    @property
    def time_min(self) -> int | None:
        """Minutes, where a time was asked for."""
        return None if self.time is None else minutes(self.time)


def minutes(text: str | int) -> int:
    """Slurm's forms: M, M:S, H:M:S, D-H, D-H:M, D-H:M:S; rounded up. Raises InputError."""
    form = re.fullmatch(r"(?:(\d+)-)?(\d+)(?::(\d+))?(?::(\d+))?", str(text))
    if form is None:
        raise InputError("a time such as 30, 2:00:00 or 1-12", found=text)
    days, *rest = form.groups()
    parts = [int(part) for part in rest if part is not None]
    if days is not None:
        hours, mins, secs = (parts + [0, 0])[:3]
    else:
        hours, mins, secs = {1: (0, *parts, 0), 2: (0, *parts), 3: tuple(parts)}[len(parts)]
    total = (int(days or 0) * 24 + hours) * 60 + mins + (secs > 0)
    if total < 1:
        raise InputError("a time of at least a minute", found=text)
    return total


def add_options(parser: argparse.ArgumentParser) -> None:
    """--engine, and how its tasks are asked for."""
    group = parser.add_argument_group("many machines")
    group.add_argument("--engine", choices=("local", "slurm"), help="this machine (default), or an existing Slurm")
    group.add_argument("--slurm", metavar="FILE", help="settings for Slurm in TOML; the options below stand above it")
    for name, metavar, kind, text in (
        ("partition", "NAME", str, "Slurm's partition"),
        ("account", "NAME", str, "who pays"),
        ("time", "TIME", str, "limit of a task, such as 30 or 2:00:00; default: from the estimate"),
        ("memory", "SIZE", str, "of a task, such as 4G (default)"),
        ("cpus", "N", int, "of a task; default: 4"),
        ("chunk-minutes", "M", float, "work of a frame task; default: 6"),
        ("scratch", "DIR", str, "node-local folder for raw frames, such as '$TMPDIR'"),
    ):
        group.add_argument(f"--{name}", dest=_dest(name), metavar=metavar, type=kind, help=text)
    group.add_argument("--print-only", action="store_true", help="show job scripts and the estimate, submit nothing")


def settings_from(args: argparse.Namespace) -> SlurmSettings:
    """File and options together. Raises InputError for unknown keys and wrong values."""
    settings = read_settings(Path(args.slurm)) if args.slurm else SlurmSettings()
    names = ("partition", "account", "time", "memory", "cpus", "chunk_minutes", "scratch")
    given = {name: getattr(args, _dest(name)) for name in names}
    return replace(settings, **{name: value for name, value in given.items() if value is not None})


def read_settings(path: Path) -> SlurmSettings:
    """Raises InputError with the file's name."""
    try:
        content = tomllib.loads(read_text(path, "Slurm settings in TOML"))
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=path, found=error) from None
    known = [f.name for f in fields(SlurmSettings)]
    if unknown := sorted(set(content) - set(known)):
        raise InputError(f"the keys {', '.join(known)}", path=path, found=", ".join(unknown))
    if isinstance(content.get("setup"), list):
        content["setup"] = tuple(content["setup"])
    for name in ("time", "memory"):
        if name in content:
            content[name] = str(content[name])
    try:
        return SlurmSettings(**content)
    except InputError as error:
        raise InputError(error.expected, path=path, found=error.found, hint=error.hint) from None


def _dest(name: str) -> str:
    return "slurm_" + name.replace("-", "_")
