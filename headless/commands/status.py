"""`iclnuim status DIR`: what is done in an output folder and what is missing, read from the files alone."""

import argparse
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from iclnuim.dataset.run_folder import load_trajectory, read_run
from iclnuim.dataset.sequence import read_entries
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob

from ..console import Console
from ..farm import slurm_queue
from ..farm.run_plan import RunPlan, find_run, read_plan
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what --out of `iclnuim render` or `make` was")
    frames = "which frames count, as a Python slice; default: those asked for"
    parser.add_argument("--frames", metavar="A:B:S", help=frames)
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
    plan: RunPlan | None = None
    with suppress(InputError):  # None where nothing that can be read is recorded
        plan = read_plan(find_run(folder))
    places = [place for place in (folder, folder / "raw") if (place / "sequence.json").is_file()]
    run = read_run(places[0]) if places else None
    if run is None and plan is not None and frames is None:  # it waits in a queue: there is no recipe yet
        return _values(plan.raw, plan.job.sequence, plan.numbers, set(), list(plan.numbers))
    if run is None:
        expected = "a folder with a run begun by `iclnuim render` or `make`"
        raise InputError(expected, path=folder, found="no sequence.json")
    job = RenderJob.from_dict(run.recipe["job"])
    if frames is None and plan is not None:
        numbers: Sequence[int] = plan.numbers
    else:
        numbers = list(frame_slice(frames or "::", len(load_trajectory(job))))
    made = _in_sequences(run.path).intersection(numbers)
    return _values(run.path, job.sequence, numbers, made, run.missing([n for n in numbers if n not in made]))


def _in_sequences(raw: Path) -> set[int]:
    """Frames that the journals of both sequences beside raw/ name."""
    if raw.name != "raw":
        return set()
    return set.intersection(*(set(read_entries(raw.parent / name / "frames.jsonl")) for name in ("clean", "noisy")))


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
        "failed": slurm_queue.last_error(raw) if missing and queue == "nothing" else None,
    }


def _queue(raw: Path) -> str | None:
    """What waits or runs in Slurm; None where nothing was submitted, or no Slurm answers."""
    with suppress(WorkError):
        jobs = slurm_queue.recorded(raw)
        return (slurm_queue.counted(slurm_queue.in_queue(jobs)) or "nothing") if jobs else None
    return None


def _holder(lock: Path) -> str | None:
    """The process that holds the folder's lock."""
    try:
        content = json.loads(lock.read_text("utf-8"))
        return f"process {content['pid']} on {content['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return None
