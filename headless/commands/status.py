"""`iclnuim status DIR`: what is done in an output folder and what is missing, read from the files alone."""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from iclnuim.dataset.run_folder import RunFolder, load_trajectory, read_run
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob

from ..console import Console
from ..farm import record, slurm_queue
from ..farm.progress import noted
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what --out of `iclnuim render` or `make` was")
    parser.add_argument(
        "--frames", metavar="A:B:S", help="which frames count, as a Python slice; default: those asked for"
    )
    common(parser, "iclnuim status out/living_room/kt2")


def run(args: argparse.Namespace, console: Console) -> int:
    values = state(args.folder, args.frames)
    missing = f"{values['missing']} missing" if values["missing"] else "nothing is missing"
    lines = [
        f"{values['folder']}: {values['sequence']}, {values['finished']} of {values['frames']} frames rendered, "
        f"{values['in_sequences']} of them in the sequences, {missing}",
        f"works on it: {values['holder'] or 'no local command'}",
    ]
    if values["queue"] is not None:
        lines.append(f"in Slurm's queue: {values['queue']}; logs: {values['folder']}/.farm/slurm")
    if values["failed"] is not None:
        lines.append(f"the last task that failed: {values['failed']}")
    console.result(values, "\n".join(lines))
    return 0


def state(folder: Path, frames: str | None) -> dict:
    """Without `frames` those that the recorded command asked for count. Raises InputError for a folder without a run."""
    try:
        run = run_in(folder)
    except InputError:
        if frames is None and (begun := _submitted(folder)) is not None:
            return begun
        raise
    return state_of(run, frames or _frames_asked(run.path))


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
    made = noted(run.path).intersection(numbers)
    return _values(run.path, job.sequence, numbers, made, run.missing([n for n in numbers if n not in made]))


def _values(raw: Path, sequence: str, numbers: Sequence[int], made: set[int], missing: list[int]) -> dict:
    queue = _queue(raw)
    return {
        "folder": str(raw),
        "sequence": sequence,
        "frames": len(numbers),
        "finished": len(numbers) - len(missing),
        "in_sequences": len(made),
        "missing": len(missing),
        "missing_frames": missing,
        "holder": _holder(raw / ".farm/lock"),
        "queue": queue,
        "failed": slurm_queue.last_words(raw) if missing and queue == "nothing" else None,
    }


def _frames_asked(raw: Path) -> str:
    """Those of the command that was recorded there; all where none was."""
    with suppress(InputError, KeyError):
        options = record.read(raw)["options"]
        return options["frames"] or ("::30" if options["quick"] else "::")
    return "::"


def _submitted(folder: Path) -> dict | None:
    """A run that waits in a queue: its folder has no recipe yet."""
    with suppress(InputError):
        raw = record.find(folder)
        asked = record.read(raw)
        plan = importlib.import_module(f".{asked['command']}", __package__).plan(record.options(asked, raw))
        return _values(raw, plan.job.sequence, plan.numbers, set(), list(plan.numbers))
    return None


def _queue(raw: Path) -> str | None:
    """What waits or runs in Slurm; None where nothing was submitted, or no Slurm answers."""
    with suppress(WorkError):
        jobs = slurm_queue.recorded(raw)
        return (slurm_queue.counted(slurm_queue.in_queue(jobs)) or "nothing") if jobs else None
    return None


def _holder(lock: Path) -> str | None:
    """Who has the folder, as its lock says."""
    try:
        content = json.loads(lock.read_text("utf-8"))
        return f"process {content['pid']} on {content['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return None
