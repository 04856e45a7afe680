"""`iclnuim extension`: builds the Blender extension as a zip: the package with its manifest, all
scenes and all trajectories. The bytes are reproducible.
"""

import tomllib
import zipfile
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from pathlib import Path

import iclnuim
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write

from ..options import action, subcommands

_DATE = (2020, 1, 1, 0, 0, 0)
#: Parts that an extension has no use for.
_LEFT_OUT = {"checkout.py", "__main__.py"}
#: Endings of the package's files: code, tables, and what a page of `view` is made of.
_KINDS = (".py", ".toml", ".csv", ".html", ".css", ".js", ".LICENSE")


def configure(parser: ArgumentParser) -> None:
    help = "write the zip of the extension: code, scenes, trajectories"
    example = "iclnuim extension build --out dist/"
    build = action(subcommands(parser), "build", help, example, _build)
    help = "folder of the zip; default: dist"
    build.add_argument("-o", "--out", type=Path, default=Path("dist"), metavar="DIR", help=help)


def _build(args: Namespace, console: Console) -> None:
    path = build(args.out)
    size = path.stat().st_size
    console.result({"file": str(path), "bytes": size}, f"{path} ({size / 1e6:.1f} MB)")


def build(out: Path) -> Path:
    """Write `out`/iclnuim-VERSION.zip and return its path.

    Raises WorkError if it cannot be written.
    """
    package = Path(iclnuim.__file__).parent
    manifest = tomllib.loads((package / "blender_manifest.toml").read_text(encoding="utf-8"))
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise WorkError(
            f"{out}: the folder cannot be created: {reason}; try another --out"
        ) from None
    target = out / f"{manifest['id']}-{manifest['version']}.zip"

    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name, file in contents(package):
                entry = zipfile.ZipInfo(name.replace("\\", "/"), _DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, file.read_bytes())

    atomic_write(target, write)
    return target


def contents(package: Path) -> Iterator[tuple[str, Path]]:
    """The name in the zip and the file, for everything that is shipped."""
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        left_out = {"__pycache__", *_LEFT_OUT} & set(name.parts)
        if path.is_file() and path.suffix in _KINDS and not left_out:
            yield str(name), path
    for path in sorted(shipped.folder("blend").glob("*.blend")):
        yield f"blend/{path.name}", path
    for path in sorted(shipped.folder("blend").glob("light/*/*")):
        yield f"blend/light/{path.parent.name}/{path.name}", path
    trajectories = shipped.folder("trajectories")
    for path in sorted(trajectories.glob("*/*")):
        if path.suffix in (".txt", ".json"):
            yield f"trajectories/{path.relative_to(trajectories)}", path
