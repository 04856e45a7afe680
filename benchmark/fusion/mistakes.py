"""Common mistakes of a reconstruction: another unit, mirrored, in another world frame.

A reconstruction that is near its model has none. Each check takes a sample of the vertices, and
says in a sentence what is wrong and what to set; settings stand in it as `{name}`.
"""

from itertools import permutations, product

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.scene_axes import UNITS_M, unit_name
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .alignment import icp

#: Units, in metres, that reconstructions have by mistake.
OTHER_UNITS_M = (*(unit_m for name, unit_m in UNITS_M.items() if name != "m"), 1000.0)
#: A mean distance below this share of the model's size is near: nothing is checked.
_NEAR = 0.002
#: Valid size ratio of a reconstruction in metres to its model: from a part of it ...
_MIN_RATIO = 0.04
#: ... to all of it with some outliers.
_MAX_RATIO = 1.6
#: A reconstruction is mirrored if a reflection has a mean distance below this share of the best
#: rigid fit's ...
_MIRROR_RATIO = 0.25
#: ... and below this share of the model's size.
_MIRROR_FIT = 0.01
#: A mean distance above this share of the model's size, that ICP from the given pose does not bring
#: near, is that of another world frame.
_OTHER_WORLD = 0.03


def warnings(
    model: TriangleDistance, points: np.ndarray, T: SE3, mean_m: float, unit_m: float
) -> tuple[str, ...]:
    """At most one sentence. points (n, 3) in metres, which were in unit_m; T: T_model_mesh, with
    which their mean distance is mean_m.
    """
    checks = _Checks(model)
    size_m = checks.size_m
    if not size_m or mean_m <= _NEAR * size_m:  # 0: nearly all vertices are in one place
        return ()
    some = points[:: max(1, len(points) // 5000)]
    if found := checks.unit(some, T, unit_m):
        return (found,)
    moved = T.apply(some)
    fitted_m = checks.fitted_mean_m(moved)
    if found := checks.mirrored(moved, fitted_m):
        return (found,)
    if mean_m > _OTHER_WORLD * size_m and fitted_m > _NEAR * size_m:
        return (
            f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction "
            "seems to be in another world frame; set {poses} to the trajectory that was used for "
            "fusion, and {truth} to its ground truth",
        )
    return ()


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

    def unit(self, points: np.ndarray, T: SE3, unit_m: float) -> str:
        """Warning if the size is not valid for the model or a part of it in metres, with the unit
        that fits or gives a similar size.
        """
        low, high = _box(points)
        ratio = float(np.linalg.norm(high - low)) / self.size_m
        if _MIN_RATIO < ratio < _MAX_RATIO:
            return ""
        possible = [f for f in OTHER_UNITS_M if _MIN_RATIO < ratio * f < _MAX_RATIO]
        means_m = {factor: self.mean_m(T.apply(points * factor)) for factor in possible}
        best = min(possible, key=means_m.__getitem__, default=1.0)
        if possible and means_m[best] < 0.05 * self.size_m:
            name, setting = _unit(best * unit_m)
            given_mm = 1e3 * self.mean_m(T.apply(points))
            return (
                f"the reconstruction seems to be in {name}, not in {_unit(unit_m)[0]}: its mean "
                f"distance is then {1e3 * means_m[best]:.3g} mm instead of {given_mm:.3g} mm; "
                f"set its unit to {setting}"
            )
        advice = "check its unit"
        for factor in possible:
            if ratio * factor > 0.5:
                advice = f"set its unit to {_unit(factor * unit_m)[1]}"
                break
        return (
            f"the reconstruction is {ratio:.3g} times as large as the model, which is in metres; "
            f"{advice}"
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
        for R in _axis_rotations():
            low, high = self.box_m - _box(some @ R.T)
            for shares in product((0.0, 0.5, 1.0), repeat=3):
                t = (1 - np.array(shares)) * low + shares * high
                starts.append((self.mean_m(some @ R.T + t), R, t))
        starts.sort(key=lambda start: start[0])
        return [moved @ R.T + t for _, R, t in starts[:10]]


def _axis_rotations() -> list[np.ndarray]:
    """The 24 rotations that map axes to axes."""
    signed: list[np.ndarray] = []
    for rows in permutations(np.eye(3)):
        for signs in product((1, -1), repeat=3):
            signed.append(np.array(signs) * np.array(rows))
    return [R for R in signed if np.linalg.det(R) > 0]


def _box(points: np.ndarray) -> np.ndarray:
    """(2, 3): corners of the box of nearly all points (1st to 99th percentile)."""
    return np.percentile(points, (1, 99), axis=0)


def _unit(unit_m: float) -> tuple[str, str]:
    """The name of a unit in metres, and the value of the unit setting for it."""
    for setting, known_m in UNITS_M.items():
        if np.isclose(known_m, unit_m, rtol=1e-9):
            return unit_name(known_m), setting
    return unit_name(unit_m), f"{unit_m:g}"
