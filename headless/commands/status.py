"""`iclnuim status DIR`: reports what is finished in an output folder and what is missing, from its
files alone.
"""

import argparse
from contextlib import suppress
from pathlib import Path

from iclnuim.console import Console
from iclnuim.dataset.frames import frames_of_run
from iclnuim.dataset.journal import read_entries
from iclnuim.dataset.run_folder import load_trajectory, read_run
from iclnuim.dataset.sequence import complete_frames
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.trajectory import frame_slice

from ..farm import held_out, slurm_queue
from ..farm.lock import OutputLock
from ..farm.run_plan import RunPlan, find_run, read_plan
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="output folder of `iclnuim render` or `make`"
    )
    frames = "frames to count, as a Python slice; default: those of the recorded command"
    parser.add_argument("--frames", metavar="A:B:S", help=frames)
    common(parser, "iclnuim status out/living_room/kt2")


def run(args: argparse.Namespace, console: Console) -> None:
    values = state(args.folder, args.frames)
    missing = f"{values['missing']} missing" if values["missing"] else "nothing is missing"
    lines = [
        f"{values['folder']}: {values['sequence']}, {values['finished']} of {values['frames']} frames rendered, "
        f"{values['in_sequences']} of them in the sequences, {missing}",
        f"working on it: {values['holder'] or 'no local command'}",
    ]
    if values["queue"] is not None:
        lines.append(f"in Slurm's queue: {values['queue']}; logs: {values['folder']}/.farm/slurm")
    if values["failed"] is not None:
        lines.append(f"the last task that failed: {values['failed']}")
    if (views := values["held_out"]) is not None:
        lines.append(
            f"held-out views: {views['finished']} of {views['frames']} rendered"
            if views
            else "held-out views: not begun"
        )
    console.result(values, "\n".join(lines))


def state(folder: Path, frames: str | None) -> dict:
    """State of a run.

    Without `frames`, the frames of the recorded command count. Raises InputError for a folder
    without a run.
    """
    plan: RunPlan | None = None
    with suppress(InputError):  # None without a readable record
        plan = read_plan(find_run(folder))
    places = [place for place in (folder, folder / "raw") if (place / "sequence.json").is_file()]
    made: set[int] = set()
    if places:
        run = read_run(places[0])
        raw, job = run.path, run.job
        numbers = (
            plan.numbers
            if frames is None and plan
            else frame_slice(frames or "::", len(load_trajectory(job)))
        )
        if raw.name == "raw":  # frames listed in the journals of both sequences in the folder above
            names = ("clean", "noisy") if plan is None or plan.noisy else ("clean",)
            made = set(numbers)
            for name in names:
                made &= read_entries(raw.parent / name).keys()
            if plan is not None and plan.sequences is not None:
                with suppress(InputError):  # a noise model of the user that is not there
                    made &= complete_frames(
                        frames_of_run(run, numbers), plan.variants(), plan.formats, hashes=False
                    )
        missing = run.missing([n for n in numbers if n not in made])
    elif plan is not None and frames is None:  # it waits in a queue and has no recipe yet
        raw, job, numbers, missing = plan.raw, plan.job, plan.numbers, list(plan.numbers)
    else:
        expected = "a folder with a run begun by `iclnuim render` or `make`"
        raise InputError(expected, path=folder, found="no sequence.json")
    queue, holder = None, None
    if jobs := slurm_queue.recorded(raw):
        try:
            queue = slurm_queue.counted(slurm_queue.in_queue(jobs)) or "nothing"
        except WorkError as error:
            queue = f"unknown ({error})"
    with suppress(OSError, KeyError):
        if lock := OutputLock(raw / ".farm").living_holder():
            holder = f"process {lock['pid']} on {lock['host']}"
    return {
        "folder": str(raw),
        "sequence": job.sequence,
        "frames": len(numbers),
        "finished": len(numbers) - len(missing),
        "in_sequences": len(made),
        "missing": len(missing),
        "missing_frames": missing,
        "holder": holder,
        "queue": queue,
        "held_out": _held_out(plan) if plan is not None and plan.held_out else None,
        "failed": slurm_queue.last_error(raw) if missing and queue == "nothing" else None,
    }


def _held_out(plan: RunPlan) -> dict:
    """State of the run of the held-out views; {} before it has begun."""
    folder = plan.out / held_out.FOLDER
    return state(folder, None) if (folder / "raw/sequence.json").is_file() else {}
