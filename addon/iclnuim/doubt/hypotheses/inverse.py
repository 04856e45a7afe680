"""World-to-camera poses where camera-to-world is expected, or rotations alone of that kind."""

import numpy as np

from ...geometry.se3 import SE3
from ..change import Change
from ..hypothesis import Files, Hypothesis, Words, fixed, reading


def turned_back(poses: SE3) -> SE3:
    """The poses with inverse rotations at the same positions."""
    return SE3(np.swapaxes(poses.rotation, -1, -2), poses.translation)


def hypotheses(files: Files) -> list[Hypothesis]:
    found = []
    for of in ("reference", "estimate") if files.have_rotations else ():
        found += [fixed("inverse", SE3.inverse, of), fixed("inverse rotations", turned_back, of)]
    return found


def _inverse_words(change: Change, format: str) -> Words:
    advice = reading(format, "tum-inverse")
    return Words("inverted", "its poses may be world to camera", advice)


def _inverse_rotations_words(change: Change, format: str) -> Words:
    cause = "its rotations may be world to camera, unlike its positions"
    return Words("with inverse rotations", cause, "inverting the rotations alone")


WORDS = {"inverse": _inverse_words, "inverse rotations": _inverse_rotations_words}
