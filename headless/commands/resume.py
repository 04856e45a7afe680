"""`iclnuim resume DIR`: the command that began a folder, again, with the options that it was given; what is finished is skipped."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from ..console import Console
from ..farm import record, slurm_settings
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what --out of `iclnuim render` or `make` was")
    slurm_settings.add_options(parser)
    common(parser, "iclnuim resume out/living_room/kt2")


def run(args: argparse.Namespace, console: Console) -> int:
    raw = record.find(args.folder)
    asked = record.read(raw)
    again = record.options(asked, raw)
    again.print_only = args.print_only
    for name, value in vars(args).items():  # other options of the engine than it was begun with
        if name.startswith(("engine", "slurm")) and value is not None:
            setattr(again, name, value)
    if asked["working_folder"] not in sys.path:
        sys.path.append(asked["working_folder"])  # where a user's own noise model may lie
    console.note(f"resuming: iclnuim {asked['command']} {again.sequence or again.scene}")
    command = importlib.import_module(f".{asked['command']}", __package__)
    return command.run(again, console)
