"""What turns poses or stamps as read into those of another reading."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..geometry.se3 import SE3
from .time_axis import OtherTime


def unchanged(given: Any) -> Any:
    return given


@dataclass(frozen=True, eq=False)
class Change:
    """kind: of the hypothesis that it is of. apply: to what is changed (`of`), such as the poses of
    the estimate or of the reference. parameters: what was fitted, by names with units; free: how
    many numbers that are. time: other stamps of the estimate.
    """

    kind: str
    apply: Callable[[Any], Any] = unchanged
    of: str = "estimate"
    parameters: dict[str, Any] = field(default_factory=dict)
    free: int = 0
    time: OtherTime | None = None

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "file": self.of, "parameters": self.parameters}


def applied(changes: Sequence[Change], reference: SE3, estimate: SE3) -> tuple[SE3, SE3]:
    """The poses of both after the changes, one after the other."""
    for change in changes:
        if change.of == "reference":
            reference = change.apply(reference)
        else:
            estimate = change.apply(estimate)
    return reference, estimate
