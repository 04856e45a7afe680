"""All shipped sequences one after another, as one work with one progress; each can be resumed by itself, and so can the whole."""

from collections.abc import Callable, Sequence

from iclnuim.dataset.sequence import read_entries
from iclnuim.errors import IclnuimError, WorkError

from ..options import Console, Progress, option_name
from .run_plan import RunPlan


class _Whole(Console):
    """Progress of all plans together; of those to come, frames count as lacking by the journals alone."""

    def __init__(self, console: Console, plans: Sequence[RunPlan]) -> None:
        super().__init__(console.quiet, console.as_json)
        self._later = {plan.job.sequence: _lacking(plan) for plan in plans}
        self._progress = console.progress(sum(self._later.values()), "all")

    def begin(self, plan: RunPlan) -> None:
        """The next one's turn."""
        self._later.pop(plan.job.sequence)

    def progress(self, total: int, label: str, unit: str = "frames") -> Progress:
        self._progress.label = label
        self._progress.total = self._progress.done + total + sum(self._later.values())
        return self._progress


def make_all(plans: Sequence[RunPlan], execute: Callable[[RunPlan, Console], int], console: Console) -> int:
    """Execute the plans in turn; the exit code. An error of one leaves the others their turn, a stop does not. Raises WorkError where
    some failed.
    """
    whole, failed = _Whole(console, plans), []
    for count, plan in enumerate(plans, 1):
        whole.begin(plan)
        console.note(f"{plan.job.sequence}: {count} of {len(plans)}")
        try:
            if code := execute(plan, whole):
                return code
        except IclnuimError as error:
            console.note(f"{plan.job.sequence}: {error.worded(option_name)}")
            failed.append(plan.job.sequence)
    if failed:
        done = f"{len(plans) - len(failed)} of {len(plans)} are done"
        raise WorkError(f"{', '.join(failed)} failed, for the reasons above; {done}")
    return 0


def _lacking(plan: RunPlan) -> int:
    """Frames that some sequence's journal has not."""
    made = set(plan.numbers)
    for folder in plan.variants():
        made &= read_entries(folder / "frames.jsonl").keys()
    return len(plan.numbers) - len(made)
