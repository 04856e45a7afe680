"""Stamps of another clock: an offset, another rate or unit, or those of the ground truth row by
row.
"""

import numpy as np

from ..change import Change
from ..hypothesis import Words


def _offset_words(change: Change, format: str) -> Words:
    assert change.time is not None
    cause = "on the same poses"
    return Words("with another time offset", cause, change.time.axis.advice)


def _rate_words(change: Change, format: str) -> Words:
    assert change.time is not None
    axis = change.time.axis
    step_s = float(np.median(np.diff(change.time.stamps_s)))
    rates = f"{1 / step_s:.4g} poses a second instead of {axis.scale / step_s:.4g}"
    better = f"with its stamps {axis.scale:.4g} times as far apart ({rates})"
    cause = "they may be of another frame rate or unit, or count other frames"
    return Words(better, cause, axis.advice)


def _rows_words(change: Change, format: str) -> Words:
    better = "with the stamps of the ground truth, row by row"
    return Words(better, "its stamps may be of another clock", "giving it those stamps")


WORDS = {"offset": _offset_words, "rate": _rate_words, "rows": _rows_words}
