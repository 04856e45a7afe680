"""Other placements of a reconstruction that is far from its model: of another unit, mirrored, with
the inverse transform, turned, moved or scaled. What each of them leaves, and what it says.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from iclnuim.doubt.axis_changes import changes_of_axes
from iclnuim.doubt.change import Change
from iclnuim.doubt.competition import Candidate
from iclnuim.doubt.fit import Fit, Limits
from iclnuim.doubt.hypotheses.scale import is_drift
from iclnuim.errors import InputError
from iclnuim.evaluation.align import umeyama
from iclnuim.geometry import so3
from iclnuim.geometry.scene_axes import UNITS_M
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .alignment import icp

#: Distances are shares of the size of what is placed: below the first one nothing is to be
#: explained, below the second one no motion is; explanations leave at most the third, units the
#: fourth, as something else may be wrong besides.
NEAR = 0.002
_FAR = 0.01
_LEFT = 0.01
_LEFT_OF_UNIT = 0.05
#: Scales that are tried, in these steps; between them ICP finds the right one, in so many rounds.
_SCALES = np.geomspace(0.1, 10.0, 41)
_ROUNDS = 40
#: What is turned or scaled has at least this share of the model's extent: anything can be shrunk to
#: a point on the model, and a small part fits in many places.
_LEAST_SIZE = 0.3
#: Fewer points can fit by chance.
_LEAST_POINTS = 100
#: A scale within this share of a unit is that unit.
_KNOWN = 0.01
#: Rotations about the third axis between those that swap axes; starts of ICP that are kept.
_BETWEEN_DEG = (0.0, 30.0, 60.0)
_KEPT = 6
_OF_POSES = (
    "set {poses} to the trajectory that was used for fusion, and {truth} to its ground truth, or "
    "{transform} to this motion"
)


@dataclass(frozen=True, eq=False)
class PlacedPoints:
    """Points (n, 3) in the model's world, how they got there in words, and what to try. free: the
    number of fitted parameters.
    """

    model: TriangleDistance
    kind: str
    points: np.ndarray
    words: str = ""
    advice: str = ""
    free: int = 0

    @cached_property
    def mean_m(self) -> float:
        return float(self._distances_m.mean())

    @cached_property
    def _distances_m(self) -> np.ndarray:
        return self.model.distance(self.points)

    def candidate(self, given: "PlacedPoints") -> Candidate:
        """It in the competition; the halves of thousands of points share its parameters."""
        worth = NEAR if self.kind in ("unit", "mirror") else _FAR
        largest = _LEFT_OF_UNIT if self.kind == "unit" else _LEFT
        limits = Limits(*np.array([[1e-9], [worth], [largest], [np.inf]]))
        return Candidate(
            (Change(self.kind, free=self.free),), Fit(given._errors, self._errors, limits)
        )

    @property
    def _errors(self) -> np.ndarray:
        """(3, 1) mean distances as shares of the size, of all points and of each half. Which points
        are in a half does not follow the order of vertices, which is that of a grid in many meshes.
        """
        mixed = self._distances_m[np.random.default_rng(0).permutation(len(self.points))]
        parts = mixed, mixed[::2], mixed[1::2]
        return np.array([[part.mean()] for part in parts]) / diagonal(self.points)


def box(points: np.ndarray) -> np.ndarray:
    """(2, 3): corners of the box of nearly all points (1st to 99th percentile)."""
    return np.percentile(points, (1, 99), axis=0)


def diagonal(points: np.ndarray) -> float:
    """The length of the box's diagonal."""
    low, high = box(points)
    return float(np.linalg.norm(high - low))


def moved_placements(
    model: TriangleDistance, points: np.ndarray, T_model_mesh: SE3
) -> Iterator[PlacedPoints]:
    """Points (n, 3) mirrored, moved and scaled in other ways than by T_model_mesh."""
    moved = T_model_mesh.apply(points)
    corners = model.vertices[np.unique(model.triangles)]
    yield _mirrored(model, moved, box(corners))
    if len(points) < _LEAST_POINTS:
        return
    if np.abs(T_model_mesh.matrix - np.eye(4)).max() > 1e-9:
        inverse = T_model_mesh.inverse().apply(points)
        words = "with the inverse of the given motion"
        yield PlacedPoints(model, "inverse", inverse, words, "try inverting it (T_model_mesh)")
    if _extent(points) >= _LEAST_SIZE * _extent(corners):
        plain = _fitted(model, moved, SE3.identity())
        yield replace(plain, advice="try {align} icp", free=6)
        for start in _starts(model, moved, corners.mean(0)):
            yield _fitted(model, moved, start)
    if (scaled := _scaled(model, moved, corners)) is not None:
        yield scaled


def _mirrored(model: TriangleDistance, moved: np.ndarray, box_m: np.ndarray) -> PlacedPoints:
    """The best of the reflections about the model's centre or origin, followed by ICP."""
    flipped = []
    for axis, middle_m in enumerate(box_m.mean(0)):
        for about_m in (0.0, middle_m):
            points = moved.copy()
            points[:, axis] = 2 * about_m - points[:, axis]
            flipped.append((_mean_m(model, points), "xyz"[axis], points))
    flipped.sort(key=lambda one: one[0])
    found = [(_best_motion(model, points, SE3.identity()), name) for _, name, points in flipped[:2]]
    points, name = min(
        ((T.apply(one[2]), name) for (T, name), one in zip(found, flipped, strict=False)),
        key=lambda one: _mean_m(model, one[0]),
    )
    advice = f"flip {name} of its vertices, or check the handedness of the poses it was made with"
    return PlacedPoints(model, "mirror", points, f"with {name} flipped", advice, 6)


def _starts(model: TriangleDistance, moved: np.ndarray, middle_m: np.ndarray) -> list[SE3]:
    """Motions that turn the points about the origin or about their centre, which they move to the
    model's (3,): the best of rotations that swap axes, and of those between them.
    """
    some = moved[:: max(1, len(moved) // 300)]
    between = SE3.exp(np.multiply.outer(np.radians(_BETWEEN_DEG), [0, 0, 0, 0, 0, 1.0])).rotation
    tried = []
    for R in changes_of_axes(1):
        starts = [SE3(turn @ R, middle_m - turn @ R @ moved.mean(0)) for turn in between]
        for start in (SE3(R, np.zeros(3)), *starts):
            tried.append((_mean_m(model, start.apply(some)), start))
    tried.sort(key=lambda one: one[0])
    return [start for _, start in tried[:_KEPT]]


def _best_motion(model: TriangleDistance, points: np.ndarray, start: SE3) -> SE3:
    """The start, or what ICP makes of it, if that is nearer."""
    found = start
    with suppress(InputError):
        found = icp(model, points, start)
    return min((start, found), key=lambda T: _mean_m(model, T.apply(points)))


def _fitted(model: TriangleDistance, moved: np.ndarray, start: SE3) -> PlacedPoints:
    """The placement of moved points (n, 3) after ICP from a start, whose choice is a parameter,
    too.
    """
    T = _best_motion(model, moved, start)
    vector = so3.log(T.rotation)
    angle = np.linalg.norm(vector)
    axis = np.round(vector / max(angle, 1e-12), 2) + 0.0
    about = ", ".join(f"{value:g}" for value in axis)
    middle = moved.mean(0)
    distance_m = np.linalg.norm(T.apply(middle) - middle)
    words = f"turned by {np.degrees(angle):.3g} degrees about ({about})"
    words += f" and its centre moved by {distance_m:.3g} m"
    return PlacedPoints(model, "motion", T.apply(moved), words, _OF_POSES, 7)


def _scaled(model: TriangleDistance, moved: np.ndarray, corners: np.ndarray) -> PlacedPoints | None:
    """The best similarity, from scales about the origin and about the centres of both."""
    some = moved[:: max(1, len(moved) // 1000)]
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
    if is_drift(scale) or _extent(points) < _LEAST_SIZE * _extent(corners):
        return None
    advice = f"try giving it the scale of the model, times {scale:.4g}"
    for setting, unit_m in UNITS_M.items():
        if unit_m != 1 and abs(scale / unit_m - 1) < _KNOWN:
            advice = f"set {{unit}} to {setting}, and check its world frame"
    return PlacedPoints(model, "scale", points, f"multiplied by {scale:.4g} and moved", advice, 8)


def _extent(points: np.ndarray) -> float:
    return float(np.linalg.norm(points.std(axis=0)))


def _mean_m(model: TriangleDistance, points: np.ndarray) -> float:
    return float(model.distance(points).mean())
