"""A system, as described by its TOML file: its command, the view of a sequence that it requires,
and the trajectories that it writes.
"""

import os
import re
import shutil
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iclnuim.benchmark.odometry.registry import names
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.files import read_text
from iclnuim.sequences.slam_settings import SLAM_SETTINGS
from iclnuim.settings import MISSING, Settings, parameter
from iclnuim.trajectory_files.trajectories import FORMATS

_HERE = Path(__file__).parent
#: The file that all odometers of `iclnuim odometry` share.
_ODOMETRY_FILE = _HERE / "odometry.toml"


@dataclass(frozen=True)
class StageSettings(Settings):
    """The view of a sequence for a system: a folder with links to its images, and lists of them."""

    group = "settings of [stage] in a system's file"

    names: str = parameter(
        "number",
        "names of the images",
        choices={"number": "000000.png, ...", "stamp": "1.033333.png, ..."},
    )
    rgb: str = parameter("rgb", "folder of the colour images")
    depth: str = parameter("depth", "folder of the depth images")
    order: str = parameter(
        "rgb-first",
        "order of associations.txt",
        choices={
            "rgb-first": "stamp rgb stamp depth, as in TUM",
            "depth-first": "stamp depth stamp rgb, as in ICL-NUIM",
        },
    )
    depth_units: float | None = parameter(
        None,
        "depth units per metre that the system assumes; default: those of the sequence",
        low=1.0,
        high=1e6,
    )
    first_stamp_s: float = parameter(
        1.0,
        "minimum of the first stamp: whole seconds are added to all stamps, and subtracted from "
        "the result; many systems stop at a stamp of 0",
        unit="s",
    )
    settings: str | None = parameter(
        None,
        "settings file to write from the camera; default: none",
        choices=lambda: dict.fromkeys(SLAM_SETTINGS, ""),
    )
    settings_file: str = parameter("settings.yaml", "its name in the view")
    imu: bool = parameter(
        False, "the readings of the IMU: imu.csv in the view; a sequence without them is refused"
    )


@dataclass(frozen=True)
class ResultSettings(Settings):
    """A trajectory that a system writes."""

    group = "settings of [trajectories.NAME] in a system's file"

    file: str = parameter(MISSING, "its name in the folder {out}")
    format: str | None = parameter(
        None, "its format; default: by name and content", choices=lambda: dict.fromkeys(FORMATS, "")
    )
    counted: bool = parameter(
        False, "its stamps are frame numbers of the view, from 0, instead of times"
    )


@dataclass(frozen=True)
class SystemSettings(Settings):
    """A system's file."""

    group = "settings of a system's file"

    about: str = parameter(MISSING, "description in one line")
    command: tuple[str, ...] = parameter(MISSING, "program and arguments, with placeholders")
    title: str | None = parameter(None, "its name in tables; default: the name of the system")
    program: str | None = parameter(
        None, "value of {program}, looked up on PATH; python: the Python that runs iclnuim"
    )
    install: str | None = parameter(None, "how to install it, for the error if it is missing")
    check: tuple[str, ...] | None = parameter(
        None, "a command that fails if something is missing; default: none"
    )
    deterministic: bool = parameter(
        False, "whether every run writes the same trajectory; `iclnuim stress` then runs it once"
    )
    has_scale: bool = parameter(
        True,
        "whether its trajectories are in metres; those of a monocular system are not, and are "
        "aligned by Sim(3), which their rows say",
    )
    initialised: str | None = parameter(
        None,
        "file in {out} with the stamps, one a line, at which the system initialised its IMU; "
        "default: none",
    )
    stage: StageSettings = StageSettings()


@dataclass(frozen=True)
class System:
    """A system, in one of its modes, with the values of its options. name: SYSTEM or SYSTEM:MODE.
    content: the parsed file, with what the mode changes. here: the value of {here}, the folder of
    the file.
    """

    name: str
    settings: SystemSettings
    trajectories: Mapping[str, ResultSettings]
    options: Mapping[str, str]
    environment: Mapping[str, str]
    content: Mapping[str, Any]
    here: Path

    def filled(self, texts: tuple[str, ...], values: Mapping[str, object]) -> list[str]:
        """The texts with all placeholders {name} replaced.

        Raises InputError for an unknown placeholder.
        """
        known = {
            **self.options,
            "here": str(self.here),
            "odometer": self.name,
            **values,
        }

        def value(found: re.Match) -> str:
            if found[1] not in known:
                raise InputError(
                    f"placeholders {', '.join(sorted(known))}", path=self.name, found=found[0]
                )
            return str(known[found[1]])

        return [re.sub(r"\{(\w+)\}", value, text) for text in texts]

    @property
    def title(self) -> str:
        return self.settings.title or self.name

    @property
    def chosen_options(self) -> dict[str, str]:
        """The options that decide a result; the program is identified by its hash."""
        return {key: value for key, value in self.options.items() if key != "program"}

    def found_program(self) -> str:
        """Path of the program.

        Raises WorkError, which explains how to install it, if it is not found.
        """
        name = self.options["program"] or self.filled(self.settings.command[:1], {})[0]
        path = sys.executable if name == "python" else shutil.which(os.path.expanduser(name))
        if path is None:
            raise WorkError(
                f"{self.name} needs the program {name}", hint=self.settings.install or "{program}"
            )
        return os.path.abspath(path)


def built_in() -> list[str]:
    """Names of the built-in systems."""
    return [
        *sorted(file.stem for file in _HERE.glob("*.toml") if file != _ODOMETRY_FILE),
        *names(),
    ]


def user_folder() -> Path:
    """Folder of the user's own systems: ICLNUIM_SYSTEMS, or iclnuim/systems below XDG_CONFIG_HOME,
    or ~/.config/iclnuim/systems.
    """
    if own := os.environ.get("ICLNUIM_SYSTEMS"):
        return Path(own).expanduser()
    return (
        Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config").expanduser()
        / "iclnuim/systems"
    )


def read_system(name: str, given: Mapping[str, str], mode: str | None = None) -> System:
    """Read a system by the path of its TOML file, or by name from the user's folder or the built-in
    ones. given: values of its options. mode: one of its [modes.NAME]; None: none of them.

    Raises InputError for an unknown system or mode, an invalid file, and missing or unknown options.
    """
    file = _file_of(name)
    short = name if file == _ODOMETRY_FILE else file.stem
    try:
        content = _in_mode(_content(file), mode)
        rest = dict(content)
        tables = {key: rest.pop(key, {}) for key in ("trajectories", "options", "environment")}
        for key, table in tables.items():
            if not isinstance(table, dict):
                raise InputError(f"a table [{key}]", found=table)
        settings = SystemSettings.from_dict(rest)
        results = {}
        for key, value in tables["trajectories"].items():
            results[key] = ResultSettings.from_dict(value)
        if not results:
            raise InputError("a table [trajectories.NAME]", found="none")
        options = _options({"program": settings.program or "", **tables["options"]}, given)
    except InputError as error:
        raise error.at(file) from None
    environment = {key: str(value) for key, value in tables["environment"].items()}
    return System(
        name=short if mode is None else f"{short}:{mode}",
        settings=settings,
        trajectories=results,
        options=options,
        environment=environment,
        content=content,
        here=file.parent.resolve(),
    )


def has_scale(name: str) -> bool:
    """Whether the trajectories of a system, given as to read_system(), are in metres."""
    return _content(_file_of(name)).get("has_scale", True) is not False


def title_of(name: str) -> str:
    """The name in tables of a system of the user's folder or of the built-in ones; of another one,
    which ran elsewhere, the name itself.
    """
    try:
        return _content(_file_of(name)).get("title", name)
    except InputError:
        return name


def _in_mode(content: dict[str, Any], mode: str | None) -> dict[str, Any]:
    """The content of a system's file without its modes, and with what this one changes: a value
    replaces a value, and a table the same keys of a table. Raises InputError.
    """
    rest = dict(content)
    modes = rest.pop("modes", {})
    if not isinstance(modes, dict) or not all(isinstance(one, dict) for one in modes.values()):
        raise InputError("tables [modes.NAME]", found=modes)
    if mode is None:
        return rest
    if mode not in modes:
        raise InputError(f"a mode ({', '.join(modes) or 'none'})", setting="--mode", found=mode)
    for key, value in modes[mode].items():
        is_table = isinstance(value, dict) and isinstance(rest.get(key), dict)
        rest[key] = {**rest[key], **value} if is_table else value
    return rest


def _content(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(file, "a system's file (TOML)"))
    except tomllib.TOMLDecodeError as error:
        raise InputError("TOML", path=file, found=error) from None


def _file_of(name: str) -> Path:
    if name.endswith(".toml"):
        return Path(name)
    for folder in (user_folder(), _HERE):
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    if name in names():
        return _ODOMETRY_FILE
    raise InputError(
        f"a system ({', '.join(built_in())}), or the path of its .toml file", found=name
    )


def _options(declared: Mapping[str, object], given: Mapping[str, str]) -> dict[str, str]:
    """Option -> value.

    An option declared as "" must be given; without `program`, the first word of the command is the
    program.
    """
    if unknown := sorted(set(given) - set(declared)):
        raise InputError(
            f"options {', '.join(declared)}", found=", ".join(unknown), hint="{set} NAME=VALUE"
        )
    options = {key: str(value) for key, value in {**declared, **given}.items()}
    if missing := [key for key, value in options.items() if not value and key != "program"]:
        raise InputError(
            f"a value for {', '.join(missing)}", found="none", hint=f"{{set}} {missing[0]}=VALUE"
        )
    return options
