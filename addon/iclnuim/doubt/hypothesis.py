"""A hypothesis: one mistake that files of poses are often made or read with."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from ..geometry.se3 import SE3
from .change import Change
from .compared_poses import ComparedPoses


class Words(NamedTuple):
    """How it fits much better (`the estimate fits much better ...`), why that may be so, and what
    to try (`try ...`).
    """

    better: str
    cause: str
    advice: str


#: The words of a change of a file in this format.
Said = Callable[[Change, str], Words]


class Hypothesis(NamedTuple):
    """fit: the change that undoes the mistake in compared poses, None if there is none. of: the
    file that has it. group: at most one of a group is named.
    """

    kind: str
    fit: Callable[[ComparedPoses], Change | None]
    of: str = "estimate"
    group: str = ""


class Files(NamedTuple):
    """What is known of the two files: reorders: of the quaternions of the "estimate" and the
    "reference", None for a file of matrices.
    """

    reorders: Mapping[str, "Reorder | None"] = MappingProxyType({})
    have_rotations: bool = True
    scale_is_corrected: bool = False


class Reorder(NamedTuple):
    """The other order of quaternions, `wxyz` or `xyzw`, and the poses in it, of poses as read."""

    kind: str
    poses: Callable[[SE3], SE3]


def fixed(kind: str, poses: Callable[[SE3], SE3], of: str = "estimate") -> Hypothesis:
    """A hypothesis without a parameter."""
    return Hypothesis(kind, lambda _: Change(kind, poses, of), of, kind)


def reading(format: str, other: str) -> str:
    """The advice to read a file of this format as another one."""
    return f"reading it as {other}" if format == "tum" else "converting it"
