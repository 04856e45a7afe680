"""What a run folder was asked for: the command and its options beside the frames, so that `iclnuim resume DIR` can ask again."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from iclnuim import shipped
from iclnuim.errors import InputError
from iclnuim.formats.files import read_json, write_json

SCHEMA_VERSION = 1
#: Where a folder's own record lies, below the run folder.
NAME = ".farm/command.json"
#: Options that say where and how to speak, not what to do.
NOT_RECORDED = {"run", "quiet", "json", "out", "blend", "print_only"}
#: Options that name files or folders; the record holds them in full.
FILES = {"scene", "trajectory", "slurm", "textures"}


def of(command: str, args: argparse.Namespace) -> dict:
    """The record of a parsed command, `make` or `render`. Without --out: the folder may be moved."""
    options = {k: str(v) if isinstance(v, Path) else v for k, v in vars(args).items() if k not in NOT_RECORDED}
    for name in FILES & options.keys():
        options[name] = _absolute(options[name])
    if str(options.get("sequence") or "").endswith(".json"):
        options["sequence"] = _absolute(options["sequence"])
    return {"schema_version": SCHEMA_VERSION, "command": command, "working_folder": str(Path.cwd()), "options": options}


def write(record: dict, raw: Path) -> None:
    """Beside the frames."""
    (raw / NAME).parent.mkdir(parents=True, exist_ok=True)
    write_json(raw / NAME, record)


def read(raw: Path) -> dict:
    """Raises InputError where a folder has none, or one of another make."""
    record = read_json(raw / NAME)
    if record.get("schema_version") != SCHEMA_VERSION or record.get("command") not in ("make", "render"):
        raise InputError(f"a record of make or render, schema_version {SCHEMA_VERSION}", path=raw / NAME)
    return record


def find(folder: Path) -> Path:
    """The run folder (that of the frames) of what --out was. Raises InputError where no command was recorded."""
    for raw in (folder, folder / "raw"):
        if (raw / NAME).is_file():
            return raw
    raise InputError("a folder in which `iclnuim render` or `make` was begun", path=folder, found=f"no {NAME}")


def options(record: dict, raw: Path) -> argparse.Namespace:
    """The recorded options as the command parses them, with --out where the folder lies now. Raises InputError for unknown ones."""
    module = importlib.import_module(f"..commands.{record['command']}", __package__)
    parser = argparse.ArgumentParser()
    module.configure(parser)
    args = parser.parse_args([])
    unknown = sorted(set(record["options"]) - set(vars(args)))
    if unknown:
        raise InputError("options of this iclnuim", path=raw / NAME, found=", ".join(unknown), hint="a newer iclnuim")
    vars(args).update(record["options"])
    args.out = raw.parent if record["command"] == "make" else raw
    return args


def _absolute(name: str | None) -> str | None:
    """The full path of what is there; names of shipped things stay."""
    if not name or name in shipped.SCENE_NAMES or not Path(name).expanduser().exists():
        return name
    return str(Path(name).expanduser().resolve())
