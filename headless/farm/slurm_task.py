"""A task as Slurm's nodes run it: a small object with the command's record, handed over by submitit."""

from __future__ import annotations

import importlib
import logging
from dataclasses import dataclass
from pathlib import Path

from ..console import Console
from . import record, tasks
from .rendering import report


@dataclass(frozen=True)
class Task:
    """`stage` of the command in `asked` (farm/record.py) for the run folder `raw`; `frames` of a frame task."""

    asked: dict
    raw: str
    stage: str
    frames: tuple[int, ...] = ()

    def __call__(self) -> int:
        """Runs on a node; returns the exit code 0. Raises what went wrong, so that Slurm counts the task as failed."""
        console, raw = Console(), Path(self.raw)
        args = record.options(self.asked, raw)
        plan = importlib.import_module(f"..commands.{self.asked['command']}", __package__).plan(args)
        if self.stage == "light":
            tasks.light(plan, console, _never)
        elif self.stage == "frames":
            progress = console.progress(len(self.frames), f"{plan.job.sequence}, frame {self.frames[0]} and on")
            outcome = tasks.frames(plan, self.frames, console, _never, lambda number: progress.advance())
            return report(outcome, console)
        else:
            progress = console.progress(len(plan.numbers), plan.job.sequence, "pairs")
            tasks.dataset(plan, lambda number: progress.advance())
        return 0

    def checkpoint(self) -> object:
        """submitit asks before time is up, or when a task must make room: the same task again, frames that are finished are skipped."""
        from submitit.helpers import DelayedSubmission

        logging.getLogger("submitit").info("back into the queue; finished frames stand")
        return DelayedSubmission(self)


def _never() -> bool:
    return False
