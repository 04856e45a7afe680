"""`iclnuim extension`: build the Blender extension as a zip that installs from disk."""

import argparse
from pathlib import Path

from ..console import Console
from ..options import action, subcommands


def configure(parser: argparse.ArgumentParser) -> None:
    actions = subcommands(parser)
    build = action(
        actions,
        "build",
        "the extension's zip, complete: code, scenes, trajectories",
        "iclnuim extension build --out dist/",
        _build,
    )
    build.add_argument("--out", type=Path, default=Path("dist"), metavar="DIR", help="folder of the zip; default: dist")


def _build(args: argparse.Namespace, console: Console) -> int:
    from ..extension import build

    path = build(args.out)
    size = path.stat().st_size
    console.result({"file": str(path), "bytes": size}, f"{path} ({size / 1e6:.1f} MB)")
    return 0
