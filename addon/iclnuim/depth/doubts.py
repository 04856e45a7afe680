"""Reasons why predicted depth does not fit the truth, from a few frames: another unit, a scale, the
inverse, the distance along the ray, other frames. Each function returns a sentence, "" for none.

This is another question than that of `doubt/`, where a right explanation leaves next to nothing. A
network's depth errs by several percent, more than the length of a ray changes depth: no explanation
halves that error in both halves of the evidence. What tells is a trend that noise of single pixels
does not have: the sign of a correlation, a slope, a median, in most frames.

x are predicted values, as they are and after the alignment, and y true values in metres of the same
pixels, (n,) > 0, of one frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Metres of one unit, and what the unit is.
_UNITS_M = {
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "feet": 0.3048,
    "inches": 0.0254,
    "units of 1/5000 m (TUM)": 1 / 5000,
    "units of 1/256 m (KITTI)": 1 / 256,
    "units of 1/6553.5 m (Replica)": 1 / 6553.5,
}
#: A factor is that of a unit if it is this close to it.
_SAME_UNIT = 0.03
#: A scale of less is the error of a method that predicts metres: delta1 counts such depth as right.
_SMALLEST_SCALE = 1.25
#: A prediction that is the inverse has a correlation of logarithms of -1; noise alone has 0.
_INVERSE = -0.5
#: A cause is named if it reduces the spread to this share, so that what is left of the error is the
#: smaller part of it.
_CLEARLY = 0.7
#: Slope of ln(x / y) over ln(distance along the ray / depth): 0 for depth, 1 for the distance.
_RAY_SLOPES = (0.7, 1.3)


@dataclass(frozen=True, eq=False)
class SampledFrame:
    """Pixels of a frame: x as predicted, aligned, y, the length of their rays per depth (n,), and the
    true values of the same pixels in frames before and after it, NaN where they have none.
    """

    x: np.ndarray
    aligned: np.ndarray
    y: np.ndarray
    rays: np.ndarray
    others: dict[int, np.ndarray]


def doubts(frames: Sequence[SampledFrame], quantity_is_depth: bool, aligned: bool) -> list[str]:
    """Sentences on what the prediction seems to be instead, the most certain first."""
    frames = [frame for frame in frames if len(frame.x) > 1]
    if not frames:
        return []
    inverse = inverse_doubt(frames, quantity_is_depth)
    if inverse:
        return [inverse]
    found = [renumbered_doubt(frames, quantity_is_depth)]
    if quantity_is_depth:
        found.append(ray_doubt(frames) or ("" if aligned else unit_doubt(frames)))
    return [sentence for sentence in found if sentence]


def inverse_doubt(frames: Sequence[SampledFrame], quantity_is_depth: bool) -> str:
    """Whether what is given as depth falls with the true depth, or what is given as its inverse
    rises with it.
    """
    correlations = [_correlation(np.log(frame.x), np.log(frame.y)) for frame in frames]
    sign = 1.0 if quantity_is_depth else -1.0
    if sign * float(np.median(correlations)) > _INVERSE:
        return ""
    if quantity_is_depth:
        return (
            "the prediction is smaller where the true depth is larger: it seems to be an inverse "
            "depth or disparity; try {quantity} inverse-depth"
        )
    return (
        "the prediction is larger where the true depth is larger: it seems to be depth, not its "
        "inverse; try {quantity} depth"
    )


def unit_doubt(frames: Sequence[SampledFrame]) -> str:
    """The factor by which the prediction fits, if it fits clearly better with one."""
    ratio = np.concatenate([frame.y / frame.x for frame in frames])
    factor = float(np.median(ratio))
    before = float(np.median(np.abs(np.log(ratio))))
    after = float(np.median(np.abs(np.log(ratio / factor))))
    if after > _CLEARLY * before:
        return ""
    for name, metres in _UNITS_M.items():
        if abs(np.log(factor / metres)) < _SAME_UNIT:
            return (
                f"the prediction fits if it is multiplied by {factor:.4g}: it seems to be in {name}"
            )
    if abs(np.log(factor)) < np.log(_SMALLEST_SCALE):
        return ""
    return (
        f"the prediction fits if it is multiplied by {factor:.4g}: its scale seems to be unknown; "
        "try {align} scale"
    )


def ray_doubt(frames: Sequence[SampledFrame]) -> str:
    """Whether the prediction is the distance along the ray instead of planar depth."""
    slopes = []
    for frame in frames:
        rays = np.log(frame.rays)
        if np.ptp(rays) > 0:
            slopes.append(_slope(rays, np.log(frame.aligned / frame.y)))
    low, high = _RAY_SLOPES
    within = [low < slope < high for slope in slopes]
    if not slopes or not low < float(np.median(slopes)) < high or np.mean(within) < 0.75:
        return ""
    return (
        "the prediction grows towards the corners as the distance along the ray does; depth is "
        "planar z here: divide by the length of the ray at depth 1"
    )


def renumbered_doubt(frames: Sequence[SampledFrame], quantity_is_depth: bool) -> str:
    """Whether the predictions fit the true depth of other frames better, all the same number
    further on.
    """
    steps = sorted({step for frame in frames for step in frame.others})
    own = []
    other: dict[int, list[float]] = {step: [] for step in steps}
    for frame in frames:
        x = frame.aligned if quantity_is_depth else 1 / frame.aligned
        own.append(_spread(x, frame.y))
        for step in steps:
            y = frame.others.get(step)
            other[step].append(np.nan if y is None else _spread(x, y))
    for step in sorted(steps, key=abs):
        ratios = np.array(other[step]) / np.maximum(own, 1e-12)
        ratios = ratios[np.isfinite(ratios)]
        if len(ratios) > 1 and (ratios < 1).mean() > 0.9 and np.median(ratios) < _CLEARLY:
            way = "after" if step > 0 else "before"
            return (
                f"the predictions fit the frames {abs(step)} {way} theirs better: they seem to be "
                "renumbered"
            )
    return ""


def _spread(x: np.ndarray, y: np.ndarray) -> float:
    """Mean absolute deviation of ln(x / y) from its median."""
    used = np.isfinite(y) & (y > 0)
    if used.sum() < 2:
        return np.nan
    logs = np.log(x[used] / y[used])
    return float(np.abs(logs - np.median(logs)).mean())


def _correlation(x: np.ndarray, y: np.ndarray) -> float:
    x = x - x.mean()
    y = y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size else 0.0


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    x = x - x.mean()
    return float(x @ (y - y.mean()) / (x @ x))
