"""Common mistakes of a reconstruction: another unit, mirrored, in another world frame.

A reconstruction that is near its model has none. Else a sample of its vertices is placed in other
ways (placements.py), which compete; the sentence on the best one says what is wrong and what to set,
with settings as `{name}`.
"""

import numpy as np
from iclnuim.doubt.competition import winner
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .other_units import SCALES, other_unit
from .placements import (
    MIN_RATIO,
    NEAR,
    PlacedPoints,
    diagonal,
    is_valid,
    moved_placements,
    other_units,
)

#: A model is larger only if it is not in metres, and neither is the reconstruction that fits it.
_LARGEST_M = 1000.0
#: A mean distance above this share of the model's size, that ICP from the given pose does not bring
#: near, is that of another world frame.
_OTHER_WORLD = 0.03


def warnings(
    model: TriangleDistance,
    points: np.ndarray,
    T: SE3,
    mean_m: float,
    units_m: tuple[float, float] = (1.0, 1.0),
) -> tuple[str, ...]:
    """At most one sentence. points (n, 3) in metres; T: T_model_mesh, with which their mean
    distance is mean_m; units_m: those in which they and the model were.
    """
    size_m = diagonal(model.vertices[np.unique(model.triangles)])
    some = points[:: max(1, len(points) // 5000)]
    if not size_m or not diagonal(some):  # nearly all vertices are in one place
        return ()
    given = PlacedPoints(model, T.apply(some))
    ratio = diagonal(some) / size_m
    is_near = mean_m <= NEAR * size_m
    every: list[PlacedPoints] = []
    if not is_near or ratio <= MIN_RATIO:
        every = other_units(model, some, T, units_m, ratio)
    best = _best(every, given)
    if not is_near and (best is None or best.mean_m > NEAR * diagonal(best.points)):
        every += moved_placements(model, some, T, units_m)
        best = _best(every, given)
    if best:
        return (_sentence(best, given, every, ratio, size_m),)
    if not is_near and not is_valid(ratio):
        return (_of_sizes(ratio, size_m, units_m),)
    nearest_m = min(one.mean_m for one in (given, *every) if "mirror" not in one.kinds)
    if mean_m > _OTHER_WORLD * size_m and nearest_m > NEAR * size_m:
        return (
            f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction "
            "seems to be in another world frame; set {poses} to the trajectory that was used for "
            "fusion, and {truth} to its ground truth",
        )
    return _both_units(size_m, units_m)


def _best(every: list[PlacedPoints], given: PlacedPoints) -> PlacedPoints | None:
    """The placement that explains the distance; no reflection that hardly fits better than a
    motion, and no motion of points that mostly are where they should be: those of a room fit
    another corner, too.
    """
    candidates = {one.candidate(given): one for one in every}
    best = winner(list(candidates))
    if best is None:
        return None
    if "mirror" in best.kinds:
        motions = [one for one in candidates if "motion" in one.kinds and "mirror" not in one.kinds]
        if not all(best.fit.halves_errors_of(one.fit) for one in motions):
            return None
    if {"motion", "scale"} & set(best.kinds) and given.is_mostly_near:
        return None
    return candidates[best]


def _sentence(
    best: PlacedPoints, given: PlacedPoints, every: list[PlacedPoints], ratio: float, size_m: float
) -> str:
    found = []
    given_m, found_m = given.mean_m, best.mean_m
    if best.unit:
        found.append(best.unit.words(ratio, size_m))
        found_m = best.unit.in_metres(found_m)
    if "mirror" in best.kinds:
        found.append("the reconstruction is mirrored")
        given_m = min(one.mean_m for one in (given, *every) if one.kinds in ([], ["motion"]))
    if {"scale", "motion", "inverse"} & set(best.kinds):
        found.append("the reconstruction seems to be in another world frame")
    how = (
        f"{' and '.join(best.how)}, its mean distance is"
        if best.how
        else "the mean distance is then"
    )
    figures = f"{how} {1e3 * found_m:.3g} mm instead of {1e3 * given_m:.3g} mm"
    return f"{', and '.join(found)}: {figures}; {', and '.join(best.advice)}"


def _of_sizes(ratio: float, size_m: float, units_m: tuple[float, float]) -> str:
    """The sentence on a size that is not valid for the model or a part of it, with the unit that
    gives a similar size.
    """
    possible = [other_unit(scale, units_m) for scale in SCALES if is_valid(ratio * scale)]
    similar = [one for one in possible if ratio * one.scale > 0.5]
    advice = similar[0].advice if similar else "check {unit} and {model_unit}"
    return (
        f"the reconstruction is {ratio:.3g} times as large as the model, which is "
        f"{size_m:.4g} m large; {advice}"
    )


def _both_units(size_m: float, units_m: tuple[float, float]) -> tuple[str, ...]:
    """Warning if both may be in another unit, so that only their size tells it."""
    if size_m <= _LARGEST_M or units_m != (1, 1):
        return ()
    return (
        f"the model is {size_m:.4g} m large: if it and the reconstruction are in millimetres, set "
        "{unit} and {model_unit} to mm",
    )
