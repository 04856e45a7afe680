"""The journal of a run, frames.jsonl: a line with the hash of each frame's file, so that whoever
reads a frame whole notices that it was changed.

Processes on several machines append to it. A line that is lost or damaged leaves its frame without
a hash; a frame that was rendered twice has the hashes of both files, either of which is right.
"""

import contextlib
import json
import os
from pathlib import Path

from ..errors import InputError
from ..formats.files import file_sha256, not_written
from .journal import JOURNAL


def note_frame(run: Path, number: int, file: Path) -> None:
    """Append the hash of a frame's file. Raises WorkError if it cannot be written."""
    line = json.dumps({"frame": number, "sha256": file_sha256(file)}) + "\n"
    try:
        journal = os.open(run / JOURNAL, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(journal, line.encode())
        finally:
            os.close(journal)
    except OSError as error:
        raise not_written(run / JOURNAL, error) from None


def read_hashes(run: Path) -> dict[int, set[str]]:
    """The hashes of the frames of a run; {} if there is no journal."""
    found: dict[int, set[str]] = {}
    if not (run / JOURNAL).is_file():
        return found
    for line in (run / JOURNAL).read_bytes().split(b"\n"):
        with contextlib.suppress(ValueError, TypeError, KeyError):
            entry = json.loads(line)
            found.setdefault(int(entry["frame"]), set()).add(entry["sha256"])
    return found


def is_changed(file: Path, hashes: set[str] | None) -> bool:
    """Whether a frame's file is none of those with these hashes; never without hashes."""
    return hashes is not None and file_sha256(file) not in hashes


def refuse_changed(file: Path, hashes: set[str] | None) -> None:
    """Raises InputError if a frame's file is none of those with these hashes."""
    if is_changed(file, hashes):
        hint = "`iclnuim resume` of its run, which renders it again"
        found = "a file that was changed since"
        raise InputError("the frame that was rendered", path=file, found=found, hint=hint)
