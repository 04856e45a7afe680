"""`iclnuim cache`: says where the cache is and how large its content, and clears it."""

import shutil
from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import WorkError

from ..options import common

#: Folder in the cache -> what it has. All of it is made again when it is needed.
KINDS = {
    "light": "baked light maps",
    "bags": "unpacked ROS bags",
    "mipmaps": "textures with their mipmaps, at most 2 GB",
    "simulations": "baked simulations",
    "references": "path-traced views of `bench render`",
    "figures": "measured times of frames",
}


def configure(parser: ArgumentParser) -> None:
    help = "remove all of it; what a later command needs is made again"
    parser.add_argument("--clear", action="store_true", help=help)
    common(parser, "iclnuim cache --clear")


def run(args: Namespace, console: Console) -> None:
    cache = shipped.cache_folder()
    kinds = {name: _size(cache / name) for name in KINDS}
    total = sum(kinds.values())
    lines = [f"{cache}: {_megabytes(total)}"]
    for name, size in kinds.items():
        if (cache / name).is_dir():
            done = _cleared(cache / name) if args.clear else ""
            lines.append(f"{done}{name:<12}{_megabytes(size):>10}  {KINDS[name]}")
    values = {"folder": str(cache), "bytes": total, "bytes_by_folder": kinds, "cleared": args.clear}
    console.result(values, "\n".join(lines))


def _cleared(folder: Path) -> str:
    """Remove a folder of the cache. Raises WorkError if that is not possible."""
    try:
        if folder.is_symlink():
            folder.unlink()
        else:
            shutil.rmtree(folder)
    except OSError as error:
        raise WorkError(f"{error.filename or folder}: {error.strerror or error}") from None
    return "removed  "


def _size(folder: Path) -> int:
    """Bytes of all files below a folder; 0 if there is none."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"
