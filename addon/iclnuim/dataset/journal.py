"""`frames.jsonl`: one line a finished frame, with the hashes of its images, so that a stopped sequence can go on."""

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ..errors import WorkError
from ..formats.files import atomic_write_text


@dataclass(frozen=True)
class JournalEntry:
    """Frame number, SHA-256 of both images, how many pixels of rendered depth became 0, by kind, and SHA-256 of ground-truth images, by kind."""

    frame: int
    rgb_sha256: str = ""
    depth_sha256: str = ""
    invalid_depth: dict[str, int] = field(default_factory=dict)
    truth_sha256: dict[str, str] = field(default_factory=dict)

    def to_line(self) -> str:
        """JSON; the last item only where there is any."""
        content = asdict(self)
        if not self.truth_sha256:
            del content["truth_sha256"]
        return json.dumps(content) + "\n"


def read_entries(path: Path) -> dict[int, JournalEntry]:
    """The entries of a journal's whole lines, latest of each frame. The file is left as it is: a process may be writing it."""
    whole = path.read_bytes().rpartition(b"\n")[0] if path.is_file() else b""
    found = {}
    for line in whole.decode("utf-8", "replace").split("\n"):
        with contextlib.suppress(ValueError, TypeError):
            entry = JournalEntry(**json.loads(line))
            found[entry.frame] = entry
    return found


class Journal:
    """The entries of a file, latest of each frame; a line cut short by a crash is dropped."""

    def __init__(self, path: Path) -> None:
        self.path, self.entries = path, read_entries(path)
        data = path.read_bytes() if path.is_file() else b""
        if not data.endswith(b"\n") and data:
            # in place: a kill in the middle of writing anew would lose all entries
            os.truncate(path, data.rfind(b"\n") + 1)

    def add(self, entry: JournalEntry) -> None:
        """Append one line. Raises WorkError where it cannot be written."""
        try:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(entry.to_line())
        except OSError as error:
            raise WorkError(f"{self.path}: cannot write: {error.strerror or error}") from None
        self.entries[entry.frame] = entry

    def sort(self) -> None:
        """One line a frame, in order: the same frames leave the same file, however often the work was broken off."""
        atomic_write_text(self.path, "".join(self.entries[number].to_line() for number in sorted(self.entries)))
