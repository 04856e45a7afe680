"""`frames.jsonl`: one line a finished frame, with the hashes of its images, so that a stopped sequence can go on."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from ..errors import WorkError


@dataclass(frozen=True)
class JournalEntry:
    """Frame number, SHA-256 of both images, and how many pixels of rendered depth became 0, by kind."""

    frame: int
    rgb_sha256: str
    depth_sha256: str
    invalid_depth: dict[str, int]


class Journal:
    """The entries of a file, latest of each frame; a line cut short by a crash is dropped."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.entries: dict[int, JournalEntry] = {}
        text = path.read_text("utf-8", "replace") if path.is_file() else ""
        whole, newline, rest = text.rpartition("\n")
        for line in whole.split("\n"):
            entry = _parsed(line)
            if entry is not None:
                self.entries[entry.frame] = entry
        if rest:
            path.write_text(whole + newline, "utf-8")

    def add(self, entry: JournalEntry) -> None:
        """Append one line. Raises WorkError where it cannot be written."""
        try:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(entry)) + "\n")
        except OSError as error:
            raise WorkError(f"{self.path}: cannot write: {error.strerror or error}") from None
        self.entries[entry.frame] = entry


def _parsed(line: str) -> JournalEntry | None:
    try:
        return JournalEntry(**json.loads(line))
    except (ValueError, TypeError):
        return None
