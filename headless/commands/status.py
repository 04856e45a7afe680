"""`iclnuim status DIR`: what is done in an output folder and what is missing, read from the files alone."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from pathlib import Path

from iclnuim.dataset.run_folder import RunFolder, load_trajectory, read_run
from iclnuim.errors import InputError
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob

from ..console import Console
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what --out of `iclnuim render` or `make` was")
    parser.add_argument("--frames", metavar="A:B:S", help="which frames count, as a Python slice; default: all")
    common(parser, "iclnuim status out/living_room/kt2")


def run(args: argparse.Namespace, console: Console) -> int:
    values = state_of(run_in(args.folder), args.frames or "::")
    missing = f"{values['missing']} missing" if values["missing"] else "nothing is missing"
    text = f"{values['folder']}: {values['sequence']}, {values['finished']} of {values['frames']} frames rendered, {values['in_sequences']} of them in the sequences, {missing}"
    console.result(values, f"{text}\nworks on it: {values['holder'] or 'no local command'}")
    return 0


def run_in(folder: Path) -> RunFolder:
    """The render run in a folder, or in its raw/. Raises InputError where there is none."""
    for place in (folder, folder / "raw"):
        if (place / "sequence.json").is_file():
            return read_run(place)
    raise InputError("a folder with a run begun by `iclnuim render` or `make`", path=folder, found="no sequence.json")


def state_of(run: RunFolder, frames: str) -> dict:
    """Every frame file is read back before it counts as rendered; one that `make` turned into pairs counts by their journals."""
    job = RenderJob.from_dict(run.recipe["job"])
    numbers = list(frame_slice(frames, len(load_trajectory(job))))
    made = _made(run.path)
    missing = run.missing([n for n in numbers if n not in made])
    return {
        "folder": str(run.path),
        "sequence": job.sequence,
        "frames": len(numbers),
        "finished": len(numbers) - len(missing),
        "in_sequences": len(made.intersection(numbers)),
        "missing": len(missing),
        "missing_frames": missing,
        "holder": _holder(run.path / ".farm/lock"),
    }


def _made(raw: Path) -> set[int]:
    """Frames that both sequences beside raw/ have noted. The journals are only read: somebody may be writing them."""
    noted = [_numbers(raw.parent / name / "frames.jsonl") for name in ("clean", "noisy")]
    return set.intersection(*noted) if raw.name == "raw" else set()


def _numbers(journal: Path) -> set[int]:
    """Those of all whole lines."""
    numbers = set()
    for line in journal.read_text("utf-8", "replace").splitlines() if journal.is_file() else []:
        with suppress(ValueError, KeyError, TypeError):
            numbers.add(int(json.loads(line)["frame"]))
    return numbers


def _holder(lock: Path) -> str | None:
    """Who has the folder, as its lock says."""
    try:
        content = json.loads(lock.read_text("utf-8"))
        return f"process {content['pid']} on {content['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return None
