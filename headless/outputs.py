"""Protects the files that a command reads from being replaced by the files that it writes."""

import os
import re
from argparse import Namespace
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from iclnuim.errors import InputError, StrPath
from iclnuim.formats.files import is_stream, real_path

#: Options whose value is written.
_OUTPUTS = ("out", "csv", "plot", "picture", "rerun", "blend")
#: Files of a sequence in its own folder, apart from its images: ground truth, lists, camera,
#: recipe, journal, calibration.
_SEQUENCE = re.compile(
    r"(groundtruth.*|rgb|depth|associat.*|camera|recipe|sequence|frames|metadata|calibration|orb_slam.*)"
    r"\.(txt|json|jsonl|csv|yaml)|.*\.gt\.\w+"
)
_IMAGES = (".png", ".jpg", ".exr", ".npy")
#: Folders of images, of which a folder that is not a complete sequence has at least one.
_FOLDERS = ("rgb", "depth", "exr")
#: A sequence's images are at most this many folders below it.
_DEPTH = 4


def check_outputs(args: Namespace) -> None:
    """Raises InputError if an existing file that would be written is one that the command reads, or
    belongs to a sequence; or if a required output is not given.
    """
    if getattr(args, "out_required", False) and args.out is None:
        raise InputError("an output: OUT, or {out} OUT", found="none")
    if getattr(args, "force", False):
        return
    for name, path in _outputs(args):
        if path.is_file():
            _check_output(name, path, args)


def _check_output(name: str, path: Path, args: Namespace) -> None:
    read = next((given for given in _inputs(args) if _is_read(path, given)), None)
    if read is None:
        read = _sequence_with(path)
    if read is None:
        return
    found = f"the input {read}" if read.is_file() else f"a file of the sequence {read}"
    hint = f"another name for {{{name}}}"
    expected = "an output that is none of the inputs and in no sequence"
    raise InputError(expected, path=path, found=found, hint=hint)


def refuse_existing(path: StrPath, hint: str) -> None:
    """Raises InputError if a file or folder exists at the path of a new file.

    Pipes and devices (/dev/stdout) are written.
    """
    if os.path.lexists(path) and not is_stream(path):
        raise InputError("a new file name", path=path, found="an existing file", hint=hint)


def _outputs(args: Namespace) -> Iterator[tuple[str, Path]]:
    """Options and the files that they write; `beside_out` of a command is the ending of a second
    file, which it writes next to its output.
    """
    for name in _OUTPUTS:
        path = getattr(args, name, None)
        if isinstance(path, str | Path) and str(path):
            yield name, Path(path)
    if beside := getattr(args, "beside_out", None):
        yield "out", args.out.with_suffix(beside)


def _inputs(args: Namespace) -> Iterator[Path]:
    """Files and folders that exist among the values of all other options."""
    for name, value in vars(args).items():
        if name in (*_OUTPUTS, "beside_out"):
            continue
        for one in value if isinstance(value, list | tuple) else (value,):
            if isinstance(one, str | Path) and str(one) and os.path.exists(one):
                yield Path(one)


def _is_read(path: Path, given: Path) -> bool:
    if given.is_file():
        return os.path.samefile(path, given)
    path = real_path(path)
    given = real_path(given)
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
    from iclnuim.sequences.stored_sequence import StoredSequence

    sequence = StoredSequence(folder)
    files = set()
    places = {folder / name for name in _FOLDERS if (folder / name).is_dir()}
    with suppress(InputError):
        for pair in sequence.pairs:
            files |= {real_path(pair.rgb), real_path(pair.depth)}
        places |= {image.parent for image in files}
        if truth := sequence.truth_path:
            files.add(real_path(truth))
    if not places:
        return False
    image = path.suffix.lower() in _IMAGES and path.parent in places - {folder}
    listed = path.parent == folder and _SEQUENCE.fullmatch(path.name)
    return path in files or image or bool(listed)
