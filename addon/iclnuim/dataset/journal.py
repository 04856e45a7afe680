"""`frames.jsonl`: one line a finished frame, with the hashes of its images, so that a stopped sequence can go on."""

from __future__ import annotations

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
    rgb_sha256: str
    depth_sha256: str
    invalid_depth: dict[str, int]
    truth_sha256: dict[str, str] = field(default_factory=dict)

    def to_line(self) -> str:
        """JSON; the last item only where there is any."""
        content = asdict(self)
        return (
            json.dumps(content if self.truth_sha256 else {k: v for k, v in content.items() if k != "truth_sha256"})
            + "\n"
        )


class Journal:
    """The entries of a file, latest of each frame; a line cut short by a crash is dropped."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.entries: dict[int, JournalEntry] = {}
        data = path.read_bytes() if path.is_file() else b""
        whole, newline, rest = data.rpartition(b"\n")
        for line in whole.decode("utf-8", "replace").split("\n"):
            entry = _parsed(line)
            if entry is not None:
                self.entries[entry.frame] = entry
        if rest:
            os.truncate(
                path, len(whole + newline)
            )  # in place: a kill in the middle of writing anew would lose all entries

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
        lines = [self.entries[number].to_line() for number in sorted(self.entries)]
        atomic_write_text(self.path, "".join(lines))


def _parsed(line: str) -> JournalEntry | None:
    try:
        return JournalEntry(**json.loads(line))
    except (ValueError, TypeError):
        return None
