"""What turns poses or stamps as read into those of another reading."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..geometry.se3 import SE3
from .compared_poses import ComparedPoses
from .time_axis import OtherTime


def unchanged(poses: SE3) -> SE3:
    return poses


@dataclass(frozen=True, eq=False)
class Change:
    """kind: of the hypothesis that it is of. poses: applied to the poses of the estimate or of the
    reference (`of`). parameters: what was fitted, by names with units; free: how many numbers that
    are. time: other stamps of the estimate.
    """

    kind: str
    poses: Callable[[SE3], SE3] = unchanged
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
            reference = change.poses(reference)
        else:
            estimate = change.poses(estimate)
    return reference, estimate


def changed(changes: Sequence[Change], poses: ComparedPoses) -> ComparedPoses:
    return poses.changed(*applied(changes, poses.reference, poses.estimate))
