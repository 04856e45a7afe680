"""Other placements of a reconstruction that is far from its model: of another unit, mirrored, with
the inverse transform, turned, moved or scaled, and several of these at once. What each of them
leaves, and what it says.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from iclnuim.doubt.change import Change
from iclnuim.doubt.competition import Candidate
from iclnuim.doubt.fit import Fit, Limits
from iclnuim.doubt.hypotheses.scale import is_drift
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .alignment import icp
from .other_units import SCALES, OtherUnit, other_unit, unit_of_scale
from .similarity_search import LEAST_SIZE, Similarity, SimilaritySearch

#: Distances are shares of the size of what is placed: below the first one nothing is to be
#: explained, below the second one no motion is; explanations leave at most the third, units the
#: fourth, as something else may be wrong besides.
NEAR = 0.002
_FAR = 0.01
_LEFT = 0.01
_LEFT_OF_UNIT = 0.05
#: Valid size ratio of a reconstruction in metres to its model: from a part of it ...
MIN_RATIO = 0.04
#: ... to all of it with some outliers.
_MAX_RATIO = 1.6
#: Fewer points can fit by chance.
_LEAST_POINTS = 100
#: ICP from the given pose takes every so many of the points.
_FEWER = 3
#: The reflections that flip an axis.
_FLIPS = [np.diag(np.where(np.arange(3) == axis, -1.0, 1.0)) for axis in range(3)]
#: A smaller rotation, in degrees, is none that is worth a word.
_NO_TURN_DEG = 2.0
_OF_POSES = (
    "set {poses} to the trajectory that was used for fusion, and {truth} to its ground truth, or "
    "{transform} to this motion"
)
_OF_HANDEDNESS = "or check the handedness of the poses it was made with"


@dataclass(frozen=True, eq=False)
class PlacedPoints:
    """Points (n, 3) in the model's world, the changes by which they got there, how in words, and
    what to try for each of them. unit: the other unit that the changes are for.
    """

    model: TriangleDistance
    points: np.ndarray
    changes: tuple[Change, ...] = ()
    how: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    unit: OtherUnit | None = None

    @property
    def kinds(self) -> list[str]:
        return [change.kind for change in self.changes]

    @cached_property
    def mean_m(self) -> float:
        return float(self._distances_m.mean())

    @property
    def is_mostly_near(self) -> bool:
        """Whether most points are where they should be."""
        return bool(np.median(self._distances_m) <= NEAR * diagonal(self.points))

    @cached_property
    def _distances_m(self) -> np.ndarray:
        return self.model.distance(self.points)

    def candidate(self, given: "PlacedPoints") -> Candidate:
        """It in the competition; the halves of thousands of points share its parameters."""
        worth = NEAR if {"unit", "mirror"} & set(self.kinds) else _FAR
        largest = _LEFT_OF_UNIT if self.kinds == ["unit"] else _LEFT
        limits = Limits(*np.array([[1e-9], [worth], [largest], [np.inf]]))
        return Candidate(self.changes, Fit(given._errors, self._errors, limits))

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


def other_units(
    model: TriangleDistance, points: np.ndarray, T: SE3, units_m: tuple[float, float], ratio: float
) -> list[PlacedPoints]:
    """The points in other units of them or of the model with which the sizes are valid."""
    found = []
    for scale in SCALES:
        if is_valid(ratio * scale):
            unit = other_unit(scale, units_m)
            moved = unit.moved(points, T)
            change = (Change("unit"),)
            found.append(PlacedPoints(model, moved, change, (), (unit.advice,), unit))
    return found


def is_valid(ratio: float) -> bool:
    """Whether a reconstruction may be so many times as large as its model."""
    return MIN_RATIO < ratio < _MAX_RATIO


def moved_placements(
    model: TriangleDistance, points: np.ndarray, T_model_mesh: SE3, units_m: tuple[float, float]
) -> list[PlacedPoints]:
    """Points (n, 3) mirrored, moved, scaled, in other units, and several of these at once, in other
    ways than by T_model_mesh.
    """
    moved = T_model_mesh.apply(points)
    search = SimilaritySearch(model, moved)
    found = []
    is_searched = len(points) >= _LEAST_POINTS
    if not (is_searched and LEAST_SIZE <= search.ratio <= _MAX_RATIO):
        flip = min(_flips(model), key=search.share)
        found += [_placed(search, one) for one in (flip, search.refined(flip))]
    else:
        with suppress(InputError):
            T = icp(model, moved[::_FEWER], SE3.identity())
            plain = _placed(search, Similarity(T.rotation, T.translation))
            change, advice = (Change("motion", free=6),), ("try {align} icp",)
            found.append(replace(plain, changes=change, advice=advice))
        found += [_placed(search, one) for one in _both_hands(search, 1.0)]
    if np.abs(T_model_mesh.matrix - np.eye(4)).max() > 1e-9:
        inverse = T_model_mesh.inverse().apply(points)
        how = ("with the inverse of the given motion",)
        advice = ("try inverting it (T_model_mesh)",)
        found.append(PlacedPoints(model, inverse, (Change("inverse"),), how, advice))
    near = NEAR * diagonal(moved)
    is_near = min(one.mean_m for one in found) <= near
    for one in _both_hands(search, None) if is_searched and not is_near else ():
        is_doubtful = one.is_mirrored and search.share(one) > near
        if is_drift(one.scale) or is_doubtful:
            continue
        unit = unit_of_scale(one.scale, units_m)
        if unit:
            one = search.refined(search.resized(one, unit.scale))
        found.append(_placed(search, one, unit))
    return found


def _both_hands(search: SimilaritySearch, scale: float | None) -> list[Similarity]:
    """The best similarities of this scale, or of any one, without and with a reflection. A room is
    nearly symmetric, so what the search with one found is also tried with it undone in the room.
    """
    found = [search.best(mirrored, scale) for mirrored in (False, True)]
    if (mirrored := found[1]) is not None:
        undone = [mirrored.then(*flip) for flip in _flips(search.model)]
        found.append(search.refined(min(undone, key=search.share), scale is None))
    return [one for one in found if one is not None]


def _flips(model: TriangleDistance) -> list[Similarity]:
    """The reflections about the model's centre or origin."""
    middle = box(model.vertices[np.unique(model.triangles)]).mean(axis=0)
    found = []
    for matrix in _FLIPS:
        found.append(Similarity(matrix, np.zeros(3)))
        found.append(Similarity(matrix, middle - matrix @ middle))
    return found


def _placed(
    search: SimilaritySearch, found: Similarity, unit: OtherUnit | None = None
) -> PlacedPoints:
    """The placement by a similarity: its scale, reflection and motion. The choice of a start is a
    parameter, too.
    """
    changes, how, advice = [], [], []
    rotation = found.matrix / found.scale
    is_scaled = unit is None and not is_drift(found.scale)
    if unit:
        changes.append(Change("unit"))
        advice.append(unit.advice)
    elif is_scaled:
        changes.append(Change("scale", free=1))
        how.append(f"multiplied by {found.scale:.4g}")
        advice.append(f"try giving it the scale of the model, times {found.scale:.4g}")
    if found.is_mirrored:
        angles = [so3.angle(rotation @ flip) for flip in _FLIPS]
        flip = int(np.argmin(angles))
        rotation = rotation @ _FLIPS[flip]
        changes.append(Change("mirror"))
        how.append(f"with {'xyz'[flip]} flipped")
        advice.append(f"flip {'xyz'[flip]} of its vertices, {_OF_HANDEDNESS}")
    turned_deg = float(np.degrees(so3.angle(rotation)))
    if turned_deg > _NO_TURN_DEG or not (is_scaled or found.is_mirrored):
        middle = search.points.mean(axis=0)
        moved = found.apply(middle[None])[0] - found.scale * middle
        changes.append(Change("motion", free=7))
        how.append(_motion_words(rotation, moved))
        advice.append(_OF_POSES)
    else:  # a motion that is not worth a word is fitted, too
        changes[-1] = replace(changes[-1], free=changes[-1].free + 7)
    points = found.apply(search.points)
    return PlacedPoints(search.model, points, tuple(changes), tuple(how), tuple(advice), unit)


def _motion_words(rotation: np.ndarray, moved_m: np.ndarray) -> str:
    vector = so3.log(rotation)
    angle = np.linalg.norm(vector)
    axis = np.round(vector / max(angle, 1e-12), 2) + 0.0
    about = ", ".join(f"{value:g}" for value in axis)
    words = f"turned by {np.degrees(angle):.3g} degrees about ({about})"
    return f"{words} and its centre moved by {np.linalg.norm(moved_m):.3g} m"
