"""What is finished in the output folder of a run and what is missing, from its files alone."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.sequences.frame_source import frames_of_run
from iclnuim.sequences.journal import read_entries
from iclnuim.sequences.run_folder import RunFolder, load_trajectory, read_run
from iclnuim.sequences.writer import complete_frames

from . import held_out, slurm_queue
from .lock import OutputLock
from .run_plan import RunPlan, find_run, read_plan


def run_state(folder: Path, frames: str | None = None) -> dict[str, Any]:
    """The state of a run, ready for JSON.

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
        raw = run.path
        job = run.job
        numbers = tuple(_requested(run, plan, frames))
        made = _in_sequences(run, plan, numbers)
        missing = run.missing([n for n in numbers if n not in made], read_pixels=False)
    elif plan is not None and frames is None:  # it waits in a queue and has no recipe yet
        raw = plan.raw
        job = plan.job
        numbers = plan.numbers
        missing = list(numbers)
    else:
        expected = "a folder with a run begun by `iclnuim render` or `make`"
        raise InputError(expected, path=folder, found="no sequence.json")
    queue = _queue(raw)
    return {
        "folder": str(raw),
        "sequence": job.sequence,
        "frames": len(numbers),
        "finished": len(numbers) - len(missing),
        "in_sequences": len(made),
        "missing": len(missing),
        "missing_frames": missing,
        "locked_by": _holder(raw),
        "queue": queue,
        "held_out": _held_out(plan),
        "failed": slurm_queue.last_error(raw) if missing and queue == "nothing" else None,
    }


def _requested(run: RunFolder, plan: RunPlan | None, frames: str | None) -> Iterable[int]:
    if frames is None and plan:
        return plan.numbers
    return frame_slice(frames or "::", len(load_trajectory(run.job)))


def _in_sequences(run: RunFolder, plan: RunPlan | None, numbers: tuple[int, ...]) -> set[int]:
    """The frames that the journals of all sequences in the folder above list."""
    if run.path.name != "raw":
        return set()
    names = ["clean", "noisy"]
    if plan is not None and not plan.noisy:
        names.remove("noisy")
    made = set(numbers)
    for name in names:
        made &= read_entries(run.path.parent / name).keys()
    if plan is not None and plan.sequences is not None:
        source = frames_of_run(run, numbers)
        with suppress(InputError):  # a noise model of the user that is not there
            made &= complete_frames(source, plan.variants(), plan.formats, hashes=False)
    return made


def _queue(raw: Path) -> str | None:
    """Number of tasks in Slurm's queue by state; None if nothing was submitted."""
    jobs = slurm_queue.recorded(raw)
    if not jobs:
        return None
    try:
        return slurm_queue.counted(slurm_queue.in_queue(jobs)) or "nothing"
    except WorkError as error:
        return f"unknown ({error})"


def _holder(raw: Path) -> str | None:
    with suppress(OSError, KeyError):
        if lock := OutputLock(raw / ".farm").living_holder():
            return f"process {lock['pid']} on {lock['host']}"
    return None


def _held_out(plan: RunPlan | None) -> dict[str, Any] | None:
    """State of the run of the held-out views; {} before it has begun, None if there are none."""
    if plan is None or not plan.held_out:
        return None
    folder = plan.out / held_out.FOLDER
    if not (folder / "raw/sequence.json").is_file():
        return {}
    return run_state(folder)
