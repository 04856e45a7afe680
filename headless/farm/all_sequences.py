"""Makes all shipped sequences one after another, with one progress display.

Each sequence can be resumed separately, and so can the whole.
"""

from collections.abc import Callable, Sequence

from iclnuim.console import Console, Progress
from iclnuim.errors import IclnuimError, WorkError

from ..options import option_name
from .run_plan import RunPlan


class _Whole(Console):
    """Console with one progress display for all plans.

    Missing frames of later plans are counted from their journals alone.
    """

    def __init__(self, console: Console, plans: Sequence[RunPlan]) -> None:
        super().__init__(console.quiet, console.as_json)
        self._later = {plan.job.sequence: plan.unwritten() for plan in plans}
        self._progress = console.progress(sum(self._later.values()), "all")

    def begin(self, plan: RunPlan) -> None:
        """Begin the next plan."""
        self._later.pop(plan.job.sequence)

    def progress(self, total: int, label: str, unit: str = "frames", there: int = 0) -> Progress:
        self._progress.label = label
        self._progress.total = self._progress.done + total - there + sum(self._later.values())
        return self._progress


def make_all(
    plans: Sequence[RunPlan], execute: Callable[[RunPlan, Console], int], console: Console
) -> int:
    """Execute the plans one after another; returns the exit code.

    After an error the next plan is executed, after a stop it is not. Raises WorkError if some
    failed.
    """
    whole = _Whole(console, plans)
    failed = []
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
