"""Protects the files that a command reads from being replaced by the files that it writes."""

import argparse
import os
import re
from collections.abc import Iterator
from pathlib import Path

from iclnuim.errors import InputError
from iclnuim.formats.files import is_stream, real_path

#: Options whose value is written.
_OUTPUTS = ("out", "csv", "plot", "rerun", "blend")
#: Files of a sequence in its own folder, apart from its images: ground truth, lists, camera,
#: recipe, journal, calibration.
_SEQUENCE = re.compile(
    r"(groundtruth.*|rgb|depth|associat.*|camera|recipe|sequence|frames|calibration|orb_slam.*)\.(txt|json|jsonl|csv|yaml)|.*\.gt\.\w+"
)
_IMAGES = (".png", ".jpg", ".exr", ".npy")
#: Folders of images, of which a folder that is not a complete sequence has at least one.
_FOLDERS = ("rgb", "depth", "exr")
#: A sequence's images are at most this many folders below it.
_DEPTH = 4


def check_outputs(args: argparse.Namespace) -> None:
    """Raises InputError if an existing file that would be written is one that the command reads, or
    belongs to a sequence.
    """
    if getattr(args, "force", False):
        return
    for name, path in _outputs(args):
        if path.is_file():
            for given in _inputs(args):
                if _is_read(path, given):
                    raise _refused(
                        name, path, f"the input {given}" if given.is_file() else _of_sequence(given)
                    )
            if folder := _sequence_with(path):
                raise _refused(name, path, _of_sequence(folder))


def refuse_existing(path: str | os.PathLike[str], hint: str) -> None:
    """Raises InputError if a file or folder exists at the path of a new file.

    Pipes and devices (/dev/stdout) are written.
    """
    if os.path.lexists(path) and not is_stream(path):
        raise InputError("a new file name", path=path, found="an existing file", hint=hint)


def _refused(name: str, path: Path, what: str) -> InputError:
    hint = f"another name for {{{name}}}"
    return InputError(
        "an output that is none of the inputs and in no sequence", path=path, found=what, hint=hint
    )


def _of_sequence(folder: Path) -> str:
    return f"a file of the sequence {folder}"


def _outputs(args: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """Options and the files that they write; `beside_out` of a command is the ending of a second
    file, which it writes next to its output.
    """
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
    path, given = real_path(path), real_path(given)
    if not path.is_relative_to(given):
        return False
    image = path.suffix.lower() in _IMAGES and path.parent != given
    return image or bool(_SEQUENCE.fullmatch(path.name))


def _sequence_with(path: Path) -> Path | None:
    """The sequence that a file belongs to, whether or not the command reads it; None if there is
    none.
    """
    path = real_path(path)
    return next((folder for folder in path.parents[:_DEPTH] if _has(folder, path)), None)


def _has(folder: Path, path: Path) -> bool:
    """Whether a file is an image, the ground truth, a list or the camera of a sequence in any
    format.
    """
    from iclnuim.dataset.frames import find_pairs, find_truth

    try:
        images = {
            real_path(image) for pair in find_pairs(folder) for image in (pair.rgb, pair.depth)
        }
        truth = find_truth(folder)
    except InputError:
        images, truth = set(), None
    places = {image.parent for image in images} | {
        folder / name for name in _FOLDERS if (folder / name).is_dir()
    }
    if not places:
        return False
    image = path.suffix.lower() in _IMAGES and path.parent in places - {folder}
    listed = path.parent == folder and _SEQUENCE.fullmatch(path.name)
    return path in images or image or bool(listed) or truth is not None and path == real_path(truth)
