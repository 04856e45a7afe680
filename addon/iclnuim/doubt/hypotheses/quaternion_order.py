"""Quaternions with the scalar at the other end."""

from ..change import Change
from ..hypothesis import Files, Hypothesis, Words, fixed, reading


def hypotheses(files: Files) -> list[Hypothesis]:
    if not files.have_rotations:
        return []
    reorders = files.reorders.items()
    return [fixed(reorder.kind, reorder.poses, of) for of, reorder in reorders if reorder]


def _words(change: Change, format: str) -> Words:
    order, place = {"wxyz": ("qw qx qy qz", "first"), "xyzw": ("qx qy qz qw", "last")}[change.kind]
    advice = reading(format, "tum-wxyz") if change.kind == "wxyz" else "reordering its columns"
    cause = f"its quaternions may have the scalar {place}"
    return Words(f"with quaternions {order}", cause, advice)


WORDS = dict.fromkeys(("wxyz", "xyzw"), _words)
