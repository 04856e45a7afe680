"""What of a run is done, from the files of its folder alone. Nothing is written: somebody may be at work there."""

from __future__ import annotations

import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from iclnuim.dataset.journal import JournalEntry
from iclnuim.formats.files import sha256

SEQUENCES = ("clean", "noisy")


def noted(raw: Path) -> set[int]:
    """Frames that the journals of both sequences beside raw/ name."""
    if raw.name != "raw":
        return set()
    return set.intersection(*(set(_entries(raw.parent / name)) for name in SEQUENCES))


def standing(raw: Path, numbers: Iterable[int]) -> set[int]:
    """Those of `numbers` whose four images, read back, are what the journals say."""
    journals = {raw.parent / name: _entries(raw.parent / name) for name in SEQUENCES}

    def stands(number: int) -> bool:
        return all(_is_whole(folder, entries.get(number)) for folder, entries in journals.items())

    numbers = list(numbers)
    with ThreadPoolExecutor(4) as pool:
        return {n for n, good in zip(numbers, pool.map(stands, numbers), strict=True) if good}


def _entries(folder: Path) -> dict[int, JournalEntry]:
    """All whole lines of a journal; the latest of each frame."""
    entries = {}
    file = folder / "frames.jsonl"
    for line in file.read_text("utf-8", "replace").splitlines() if file.is_file() else []:
        with suppress(ValueError, TypeError, AttributeError):
            content = json.loads(line)
            known = {name: content.get(name) for name in JournalEntry.__dataclass_fields__}
            entries[int(known["frame"])] = JournalEntry(**known)
    return entries


def _is_whole(folder: Path, entry: JournalEntry | None) -> bool:
    if entry is None:
        return False
    hashes = {"rgb": entry.rgb_sha256, "depth": entry.depth_sha256}
    try:
        return all(sha256((folder / kind / f"{entry.frame:06}.png").read_bytes()) == h for kind, h in hashes.items())
    except OSError:
        return False
