"""Protects the files that a command reads from being replaced by the files that it writes."""

import argparse
import os
import re
from collections.abc import Iterator
from pathlib import Path

from iclnuim.errors import InputError

#: Options whose value is written.
_OUTPUTS = ("out", "csv", "plot", "rerun")
#: Files of a sequence in its own folder, apart from its images: ground truth, lists, camera, recipe, journal, calibration.
_SEQUENCE = re.compile(
    r"(groundtruth.*|rgb|depth|associat.*|camera|recipe|sequence|frames|calibration|orb_slam.*)\.(txt|json|jsonl|csv|yaml)|.*\.gt\.\w+"
)
_IMAGES = (".png", ".jpg", ".exr", ".npy")


def check_outputs(args: argparse.Namespace) -> None:
    """Raises InputError if an existing file that would be written is one that the command reads, or belongs to a sequence that it reads."""
    if getattr(args, "force", False):
        return
    for name, path in _outputs(args):
        if path.is_file():
            for given in _inputs(args):
                if _is_read(path, given):
                    hint = f"another name for {{{name}}}"
                    what = f"the input {given}" if given.is_file() else f"a file of the sequence {given}"
                    raise InputError("an output that is none of the inputs", path=path, found=what, hint=hint)


def _outputs(args: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """Options and the files that they write; `beside_out` of a command is the ending of a second file, which it writes next to its output."""
    for name in _OUTPUTS:
        path = getattr(args, name, None)
        if isinstance(path, str | Path) and str(path):
            yield name, Path(path)
    if beside := getattr(args, "beside_out", None):
        yield "out", args.out.with_suffix(beside)


def _inputs(args: argparse.Namespace) -> Iterator[Path]:
    """Files and folders that exist among the values of all other options."""
    for name, value in vars(args).items():
        if name not in (*_OUTPUTS, "beside_out"):
            for one in value if isinstance(value, list | tuple) else (value,):
                if isinstance(one, str | Path) and str(one) and os.path.exists(one):
                    yield Path(one)


def _is_read(path: Path, given: Path) -> bool:
    if given.is_file():
        return os.path.samefile(path, given)
    if not path.resolve().is_relative_to(given.resolve()):
        return False
    image = path.suffix.lower() in _IMAGES and path.resolve().parent != given.resolve()
    return image or bool(_SEQUENCE.fullmatch(path.name))
