"""Stamps of another clock: an offset, another rate or unit, or those of the ground truth row by
row.
"""

from collections.abc import Iterator

import numpy as np

from ...geometry.trajectory import Trajectory
from ..change import Change
from ..hypothesis import Words
from ..time_axis import (
    ROTATIONS,
    SCALED_POSITIONS,
    SHAPES,
    Curve,
    TimeAxis,
    best_offset,
    best_scales,
    frame_s,
)
from ..time_views import Clock, Compared

#: Offsets that differ by less than this share of a frame are one.
_SAME_SHARE = 0.25


def clocks(compared: Compared, offset_only: bool) -> Iterator[Clock]:
    """Other time axes with which the positions as read fit best."""
    reference, estimate, curve = compared.reference, compared.estimate, compared.positions
    offset = best_offset(reference, estimate, curve)
    if offset is not None:
        yield Clock("offset", 1, estimate, offset, curve)
    if offset_only:
        return
    yield from _rates(compared, curve)
    if len(reference) == len(estimate) and not _on_a_line(compared):
        stamped = Trajectory(reference.stamps_s, estimate.T_world_camera)
        yield Clock("rows", 0, stamped, TimeAxis(0.0), curve)


def other_clocks(compared: Compared, with_rates: bool) -> Iterator[Clock]:
    """Offsets with which the estimate fits best, whatever its positions and rotations are
    multiplied by; with_rates: such rates, too. Poses at other times that may be scaled fit wherever
    the ground truth hardly moves, so rates are for stamps that mean nothing as read.
    """
    reference, estimate = compared.reference, compared.estimate
    step_s = frame_s(reference)
    known = [compared.settings.offset_s]
    if (offset := best_offset(reference, estimate, compared.positions)) is not None:
        known.append(offset.offset_s)
    curves = (SHAPES,) if compared.how.positions_only else (SHAPES, ROTATIONS)
    for curve in curves:
        axis = best_offset(reference, estimate, curve)
        if axis and all(abs(axis.offset_s - one) > _SAME_SHARE * step_s for one in known):
            known.append(axis.offset_s)
            yield Clock("offset", 1, estimate, axis, curve)
    for curve in (SCALED_POSITIONS, *curves) if with_rates else ():
        yield from _rates(compared, curve)


def _rates(compared: Compared, curve: Curve) -> Iterator[Clock]:
    for free, scaled in best_scales(compared.reference, compared.estimate, curve):
        if scaled.scale != 1.0:
            yield Clock("rate", free, compared.estimate, scaled, curve)


def _on_a_line(compared: Compared) -> bool:
    """Whether an offset and a scale make the stamps of the rows equal."""
    estimate, stamps_s = compared.estimate, compared.reference.stamps_s
    since_s = estimate.stamps_s - estimate.stamps_s[0]
    A = np.column_stack([since_s, np.ones(len(estimate))])
    line = np.linalg.lstsq(A, stamps_s, rcond=None)[0]
    return bool((np.abs(A @ line - stamps_s) < compared.settings.max_difference_s).all())


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
