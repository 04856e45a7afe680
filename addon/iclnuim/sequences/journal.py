"""The journal of a sequence, frames.jsonl: a line for each finished frame with the hashes of its
images, so that a stopped sequence can be resumed.
"""

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ..channels import DEPTH, RGB
from ..errors import WorkError
from ..formats.files import atomic_write_text

JOURNAL = "frames.jsonl"
_OPTIONAL = ("truth_sha256", "other_sha256", "source_sha256")


@dataclass(frozen=True)
class JournalEntry:
    """Frame number, SHA-256 of both images as PNG, number of depth pixels that became 0 by kind,
    SHA-256 of further images by name, and of images that are stored in another way, by the key of
    `ImageFile.stored`. source_sha256: FrameSource.digest() of the frame.
    """

    frame: int
    rgb_sha256: str = ""
    depth_sha256: str = ""
    invalid_depth: dict[str, int] = field(default_factory=dict)
    truth_sha256: dict[str, str] = field(default_factory=dict)
    other_sha256: dict[str, str] = field(default_factory=dict)
    source_sha256: str = ""

    def to_line(self) -> str:
        """A line of JSON; the last three items only if they are not empty."""
        content = {k: v for k, v in asdict(self).items() if v or k not in _OPTIONAL}
        return json.dumps(content) + "\n"

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of all images by the key of `ImageFile.stored`."""
        main = {RGB: self.rgb_sha256, DEPTH: self.depth_sha256}
        return main | self.truth_sha256 | self.other_sha256


class Journal:
    """The journal in a sequence's folder. `entries`: its content at construction, the latest entry
    of each frame, and what was added or read since.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL
        self.entries = read_entries(folder)

    def repair(self) -> None:
        """Remove a line truncated by a crash, in place: if the file were rewritten, a kill could
        lose all entries.
        """
        if self.path.is_file():
            os.truncate(self.path, self.path.read_bytes().rfind(b"\n") + 1)

    def read_again(self) -> None:
        """Read the file again: another process may have added entries."""
        self.entries |= read_entries(self.path.parent)

    def add(self, entry: JournalEntry) -> None:
        """Append a line. Raises WorkError if it cannot be written."""
        try:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(entry.to_line())
        except OSError as error:
            raise WorkError(f"{self.path}: cannot write: {error.strerror or error}") from None
        self.entries[entry.frame] = entry

    def sort(self) -> None:
        """Rewrite the file with one line per frame, in order: the same frames give the same file,
        however often the work was interrupted.
        """
        lines = [self.entries[number].to_line() for number in sorted(self.entries)]
        atomic_write_text(self.path, "".join(lines))


def read_entries(folder: Path) -> dict[int, JournalEntry]:
    """The entries of the complete lines of the journal in a sequence's folder, the latest of each
    frame; {} if there is none.

    The file is not changed, because a process may be writing it.
    """
    found: dict[int, JournalEntry] = {}
    if not (folder / JOURNAL).is_file():
        return found
    whole = (folder / JOURNAL).read_bytes().rpartition(b"\n")[0]
    for line in whole.decode("utf-8", "replace").split("\n"):
        with contextlib.suppress(ValueError, TypeError):
            entry = JournalEntry(**json.loads(line))
            found[entry.frame] = entry
    return found
