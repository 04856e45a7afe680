"""Common mistakes of a reconstruction: another unit, mirrored, in another world frame.

A reconstruction that is near its model has none. Each check takes a sample of the vertices, and
says in a sentence what is wrong and what to set; settings stand in it as `{name}`.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from iclnuim.doubt.axis_changes import changes_of_axes
from iclnuim.errors import InputError
from iclnuim.geometry.scene_axes import UNITS_M, unit_name
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .alignment import icp
from .placements import best_placement


class _OtherUnit(NamedTuple):
    """A unit in metres that the reconstruction or the model has by mistake; scale: by which the
    reconstruction is then to be multiplied, relative to the model.
    """

    whose: str
    setting: str
    unit_m: float
    read_m: float
    scale: float

    def moved(self, points: np.ndarray, T: SE3) -> np.ndarray:
        """The points (n, 3), with this unit, in the world of the model and its unit as read."""
        if self.whose == "model":
            return T.apply(points) * self.scale
        return T.apply(points * self.scale)

    def words(self, ratio: float, model_m: float) -> str:
        """The unit, and the sizes as read: of the model, and `ratio` times it."""
        return (
            f"the {self.whose} seems to be in {_unit(self.unit_m)[0]}, not in "
            f"{_unit(self.read_m)[0]} (as read, the reconstruction is {ratio * model_m:.4g} m "
            f"large and the model {model_m:.4g} m)"
        )

    def means(self, mean: float, given_m: float) -> str:
        """The mean distances, with this unit (in the model's as read) and as given; the advice."""
        then_m = mean / self.scale if self.whose == "model" else mean
        return (
            f"the mean distance is then {1e3 * then_m:.3g} mm instead of {1e3 * given_m:.3g} mm; "
            f"set {self.setting} to {_unit(self.unit_m)[1]}"
        )


def _other_unit(scale: float, units_m: tuple[float, float]) -> _OtherUnit:
    """Of two that are known the one that was set, or of the reconstruction."""
    mesh_m, model_m = units_m
    mesh = _OtherUnit("reconstruction", "{unit}", mesh_m * scale, mesh_m, scale)
    model = _OtherUnit("model", "{model_unit}", model_m / scale, model_m, scale)
    if not _is_known(model.unit_m):
        return mesh
    if not _is_known(mesh.unit_m) or (mesh_m == 1 and model_m != 1):
        return model
    return mesh


def _is_known(unit_m: float) -> bool:
    return bool(np.isclose(list(UNITS_M.values()), unit_m, rtol=1e-9).any())


#: Between units that are mistaken for each other.
_SCALES = [unit_m for unit_m in UNITS_M.values() if unit_m != 1]
_SCALES += [1 / unit_m for unit_m in _SCALES]
#: A mean distance below this share of the model's size is near: only the sizes are checked.
_NEAR = 0.002
#: Valid size ratio of a reconstruction in metres to its model: from a part of it ...
_MIN_RATIO = 0.04
#: ... to all of it with some outliers.
_MAX_RATIO = 1.6
#: Another unit fits if the mean distance is below this share of the model's size ...
_UNIT_FIT = 0.05
#: ... and, where the sizes are valid, this share of the reconstruction's, and of the mean distance
#: as read, both relative to the size.
_UNIT_RATIO = 0.25
#: A model is larger only if it is not in metres, and neither is the reconstruction that fits it.
_LARGEST_M = 1000.0
#: A reconstruction is mirrored if a reflection has a mean distance below this share of the best
#: rigid fit's ...
_MIRROR_RATIO = 0.25
#: ... and below this share of the model's size.
_MIRROR_FIT = 0.01
#: A mean distance above this share of the model's size, that ICP from the given pose does not bring
#: near, is that of another world frame.
_OTHER_WORLD = 0.03
#: Another placement explains that if it leaves at most this share of the distance, and of the
#: model's size.
_WORLD_RATIO = 0.25
_WORLD_FIT = 0.01


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
    checks = _Checks(model)
    size_m = checks.size_m
    if not size_m:  # nearly all vertices are in one place
        return ()
    some = points[:: max(1, len(points) // 5000)]
    is_near = mean_m <= _NEAR * size_m
    moved = T.apply(some)
    given_m = checks.mean_m(moved)
    unit, unit_m = checks.unit(some, T, units_m, is_near)
    if unit and unit_m <= _WORLD_FIT * size_m:
        return (unit,)
    if is_near and not unit:
        return _both_units(size_m, units_m)
    fitted_m = checks.fitted_mean_m(moved)
    if not unit and (found := checks.mirrored(moved, fitted_m)):
        return (found,)
    if min(mean_m, given_m) > _WORLD_FIT * size_m:
        fits = np.isfinite(unit_m)
        most_m = min(_WORLD_RATIO * (unit_m if fits else given_m), _WORLD_FIT * size_m)
        if other := best_placement(model, some, T, most_m, scales=bool(fits)):
            return (
                f"the reconstruction seems to be in another world frame: {other.words}, its mean "
                f"distance is {1e3 * other.mean_m:.3g} mm instead of {1e3 * given_m:.3g} mm; "
                f"{other.advice}",
            )
    if unit:
        return (unit,)
    if mean_m > _OTHER_WORLD * size_m and fitted_m > _NEAR * size_m:
        return (
            f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction "
            "seems to be in another world frame; set {poses} to the trajectory that was used for "
            "fusion, and {truth} to its ground truth",
        )
    return _both_units(size_m, units_m)


def _both_units(size_m: float, units_m: tuple[float, float]) -> tuple[str, ...]:
    """Warning if both may be in another unit, so that only their size tells it."""
    if size_m <= _LARGEST_M or units_m != (1, 1):
        return ()
    return (
        f"the model is {size_m:.4g} m large: if it and the reconstruction are in millimetres, set "
        "{unit} and {model_unit} to mm",
    )


class _Checks:
    """The checks against a model, with its box (2, 3) and the length of the box's diagonal."""

    def __init__(self, model: TriangleDistance) -> None:
        self.model = model
        self.box_m = _box(model.vertices[np.unique(model.triangles)])
        self.size_m = float(np.linalg.norm(self.box_m[1] - self.box_m[0]))

    def mean_m(self, moved: np.ndarray) -> float:
        return float(self.model.distance(moved).mean())

    def fitted_mean_m(self, moved: np.ndarray) -> float:
        """Mean distance as given or after ICP, whichever is less."""
        given_m = self.mean_m(moved)
        try:
            return min(given_m, self.mean_m(icp(self.model, moved, SE3.identity()).apply(moved)))
        except InputError:
            return given_m

    def unit(
        self, points: np.ndarray, T: SE3, units_m: tuple[float, float], is_near: bool
    ) -> tuple[str, float]:
        """Warning if the size is not valid for the model or a part of it, or if another unit of one
        of them fits much better, with the unit that fits or gives a similar size; and the mean distance
        with that unit, infinite if none fits. units_m: of the
        reconstruction and of the model, as read. Of what is near the model no size is invalid: a
        small part of it, or one in metres near a wall of a model in millimetres.
        """
        ratio = _diagonal(points) / self.size_m
        if not ratio or (is_near and ratio > _MIN_RATIO):
            return "", np.inf
        is_valid = is_near or _is_valid(ratio)
        scales = [scale for scale in _SCALES if _is_valid(ratio * scale)]
        possible = [_other_unit(scale, units_m) for scale in scales]
        given_m = self.mean_m(T.apply(points))
        fits = []
        for one in possible:
            mean = self.mean_m(one.moved(points, T))
            share = mean / (one.scale * ratio * self.size_m)
            better = min(_UNIT_FIT, _UNIT_RATIO * given_m / (ratio * self.size_m))
            if mean < _UNIT_FIT * self.size_m and (not is_valid or share < better):
                fits.append((mean, one))
        if fits:
            mean, best = min(fits, key=lambda fit: fit[0])
            return f"{best.words(ratio, self.size_m)}: {best.means(mean, given_m)}", mean
        if is_valid:
            return "", np.inf
        advice = "check {unit} and {model_unit}"
        similar = [one for one in possible if ratio * one.scale > 0.5]
        if similar:
            advice = f"set {similar[0].setting} to {_unit(similar[0].unit_m)[1]}"
        return (
            f"the reconstruction is {ratio:.3g} times as large as the model, which is "
            f"{self.size_m:.4g} m large; {advice}",
            np.inf,
        )

    def mirrored(self, moved: np.ndarray, fitted_m: float) -> str:
        """Warning if a reflection about the model's centre or origin, followed by ICP, is much
        closer than the best rigid fit.
        """
        flipped = []
        for axis, middle_m in enumerate(self.box_m.mean(0)):
            for about_m in (0.0, middle_m):
                points = moved.copy()
                points[:, axis] = 2 * about_m - points[:, axis]
                flipped.append((self.mean_m(points), "xyz"[axis], points))
        flipped.sort(key=lambda found: found[0])
        mean_m, name = min((self.fitted_mean_m(points), name) for _, name, points in flipped[:2])
        if mean_m >= min(_MIRROR_RATIO * fitted_m, _MIRROR_FIT * self.size_m):
            return ""
        rigid_m = min(fitted_m, *map(self.fitted_mean_m, self.rigid_starts(moved)))
        if mean_m >= _MIRROR_RATIO * rigid_m:
            return ""
        return (
            f"the reconstruction is mirrored: with {name} flipped its mean distance is "
            f"{1e3 * mean_m:.3g} mm instead of {1e3 * rigid_m:.3g} mm; flip {name} of its "
            "vertices, or check the handedness of the poses it was made with"
        )

    def rigid_starts(self, moved: np.ndarray) -> list[np.ndarray]:
        """The points, moved by the ten best of the motions that map axes to axes and align, on each
        axis, one side or the centre of the box with the model's.
        """
        some = moved[::10]
        starts = []
        for R in changes_of_axes(1):
            low, high = self.box_m - _box(some @ R.T)
            for shares in product((0.0, 0.5, 1.0), repeat=3):
                t = (1 - np.array(shares)) * low + shares * high
                starts.append((self.mean_m(some @ R.T + t), R, t))
        starts.sort(key=lambda start: start[0])
        return [moved @ R.T + t for _, R, t in starts[:10]]


def _diagonal(points: np.ndarray) -> float:
    low, high = _box(points)
    return float(np.linalg.norm(high - low))


def _is_valid(ratio: float) -> bool:
    """Whether a reconstruction may be so many times as large as its model."""
    return _MIN_RATIO < ratio < _MAX_RATIO


def _box(points: np.ndarray) -> np.ndarray:
    """(2, 3): corners of the box of nearly all points (1st to 99th percentile)."""
    return np.percentile(points, (1, 99), axis=0)


def _unit(unit_m: float) -> tuple[str, str]:
    """The name of a unit in metres, and the value of the unit setting for it."""
    for setting, known_m in UNITS_M.items():
        if np.isclose(known_m, unit_m, rtol=1e-9):
            return unit_name(known_m), setting
    return unit_name(unit_m), f"{unit_m:g}"
