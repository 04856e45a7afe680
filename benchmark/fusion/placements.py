"""Other placements of a reconstruction that is far from its model: the inverse transform, other
axes, another scale, or any rigid motion.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from iclnuim.doubt.axis_changes import changes_of_axes
from iclnuim.doubt.fit import WORTH_SHARE
from iclnuim.doubt.hypotheses.scale import is_drift
from iclnuim.errors import InputError
from iclnuim.evaluation.align import umeyama
from iclnuim.geometry import so3
from iclnuim.geometry.scene_axes import UNITS_M
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .alignment import icp

#: Scales that are tried, in these steps; between them ICP finds the right one.
_SCALES = np.geomspace(0.1, 10.0, 41)
#: Rounds of ICP with a scale. What it leaves has at least this share of the model's extent, and a
#: distance of at most this share of its own: anything can be shrunk to a point on the model.
_ROUNDS = 40
_LEAST_SIZE = 0.3
_FITS = 0.02
#: Fewer points can fit by chance.
_LEAST_POINTS = 100
#: A scale within this share of a unit is that unit.
_KNOWN = 0.01
#: A placement has at most this share of the distance of simpler ones, or those are named.
_MUCH_BETTER = WORTH_SHARE
#: Rotations about the third axis between those that swap axes; starts of ICP that are kept.
_BETWEEN_DEG = (0.0, 30.0, 60.0)
_KEPT = 6


@dataclass(frozen=True, eq=False)
class Other:
    """Another placement of the points (n, 3) as they are in the model's world: how it is reached,
    in words, what to try, and the mean distance in metres.
    """

    words: str
    advice: str
    mean_m: float


def best_placement(
    model: TriangleDistance,
    points: np.ndarray,
    T_model_mesh: SE3,
    largest_m: float,
    scales: bool = False,
) -> Other | None:
    """The simplest placement whose mean distance is at most `largest_m`, unless another one has
    half of it; None if there is none. scales: only those with another scale.
    """
    best = None
    if len(points) < _LEAST_POINTS:
        return None
    for other in _placements(model, points, T_model_mesh, scales):
        near = other.mean_m <= largest_m
        if near and (best is None or other.mean_m < _MUCH_BETTER * best.mean_m):
            best = other
    return best


def _placements(
    model: TriangleDistance, points: np.ndarray, T: SE3, scales: bool
) -> Iterator[Other]:
    """All placements, the simplest first."""
    moved = T.apply(points)
    if not scales:
        yield from _rigid(model, points, T)
    if (scaled := _scaled(model, moved)) is not None:
        yield scaled


def _rigid(model: TriangleDistance, points: np.ndarray, T: SE3) -> Iterator[Other]:
    """The inverse motion, and others if the points are not a small part of the model."""
    moved = T.apply(points)
    if np.abs(T.matrix - np.eye(4)).max() > 1e-9:
        inverse = T.inverse().apply(points)
        words = "with the inverse of the given motion"
        yield Other(words, "try inverting it (T_model_mesh)", _mean_m(model, inverse))
    if _extent(points) < _LEAST_SIZE * _extent(model.vertices[np.unique(model.triangles)]):
        return
    yield _fitted(model, moved, SE3.identity(), "try {align} icp")
    advice = (
        "set {poses} to the trajectory that was used for fusion, and {truth} to its ground truth, "
        "or {transform} to this motion"
    )
    for R in changes_of_axes(1)[1:]:
        if _mean_m(model, moved[::10] @ R.T) < _MUCH_BETTER * _mean_m(model, moved[::10]):
            yield _fitted(model, moved, SE3(R, np.zeros(3)), advice)
    for start in _starts(model, moved):
        yield _fitted(model, moved, start, advice)


def _starts(model: TriangleDistance, moved: np.ndarray) -> list[SE3]:
    """Motions that turn the points about their centre, which they move to the model's: the best of
    rotations that swap axes, and of those between them.
    """
    some = moved[:: max(1, len(moved) // 300)]
    corners = model.vertices[np.unique(model.triangles)]
    between = SE3.exp(np.multiply.outer(np.radians(_BETWEEN_DEG), [0, 0, 0, 0, 0, 1.0])).rotation
    tried = []
    for R in changes_of_axes(1):
        for turn in between:
            start = SE3(turn @ R, corners.mean(0) - turn @ R @ moved.mean(0))
            tried.append((_mean_m(model, start.apply(some)), start))
    tried.sort(key=lambda one: one[0])
    return [start for _, start in tried[:_KEPT]]


def _fitted(model: TriangleDistance, moved: np.ndarray, start: SE3, advice: str) -> Other:
    """The placement of moved points (n, 3) after ICP from a start."""
    found = start
    with suppress(InputError):
        found = icp(model, moved, start)
    means_m = [_mean_m(model, T.apply(moved)) for T in (start, found)]
    T = (start, found)[int(np.argmin(means_m))]
    vector = so3.log(T.rotation)
    angle = np.linalg.norm(vector)
    axis = np.round(vector / max(angle, 1e-12), 2) + 0.0
    about = ", ".join(f"{value:g}" for value in axis)
    middle = moved.mean(0)
    distance_m = np.linalg.norm(T.apply(middle) - middle)
    words = f"turned by {np.degrees(angle):.3g} degrees about ({about})"
    return Other(f"{words} and its centre moved by {distance_m:.3g} m", advice, min(means_m))


def _scaled(model: TriangleDistance, moved: np.ndarray) -> Other | None:
    """The best similarity, from scales about the origin and about the centres of both."""
    some = moved[:: max(1, len(moved) // 1000)]
    corners = model.vertices[np.unique(model.triangles)]
    about = ((np.zeros(3), np.zeros(3)), (some.mean(0), corners.mean(0)))
    tried = []
    for mesh_m, model_m in about:
        for scale in _SCALES:
            points = scale * (some - mesh_m) + model_m
            tried.append((_mean_m(model, points) / scale, scale, points))
    _, scale, points = min(tried, key=lambda one: one[0])
    for _ in range(_ROUNDS):
        near = model.nearest(points)
        use = near.distance_m <= 3 * np.median(near.distance_m)
        T, factor = umeyama(points[use], near.point_m[use], with_scale=True)
        if not 0.5 < factor < 2.0:
            return None
        points = T.apply(factor * points)
        scale *= factor
    mean_m = _mean_m(model, points)
    size = _extent(points) / _extent(corners)
    fits = size >= _LEAST_SIZE and mean_m <= _FITS * _extent(points)
    if is_drift(scale) or not fits:
        return None
    advice = f"try giving it the scale of the model, times {scale:.4g}"
    for setting, unit_m in UNITS_M.items():
        if unit_m != 1 and abs(scale / unit_m - 1) < _KNOWN:
            advice = f"set {{unit}} to {setting}, and check its world frame"
    return Other(f"multiplied by {scale:.4g} and moved", advice, mean_m)


def _extent(points: np.ndarray) -> float:
    return float(np.linalg.norm(points.std(axis=0)))


def _mean_m(model: TriangleDistance, points: np.ndarray) -> float:
    return float(model.distance(points).mean())
