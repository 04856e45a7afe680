"""Common mistakes of a reconstruction: another unit, mirrored, in another world frame.

A reconstruction that is near its model has none. Else a sample of its vertices is placed in other
ways (placements.py), which compete; the sentence on the best one says what is wrong and what to set,
with settings as `{name}`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from iclnuim.doubt.competition import winner
from iclnuim.geometry.scene_axes import UNITS_M, unit_name
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.distance import TriangleDistance

from .placements import NEAR, PlacedPoints, diagonal, moved_placements


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
        """The mean distances, with this unit (in the model's as read) and as given."""
        then_m = mean / self.scale if self.whose == "model" else mean
        return f"the mean distance is then {1e3 * then_m:.3g} mm instead of {1e3 * given_m:.3g} mm"

    @property
    def advice(self) -> str:
        return f"set {self.setting} to {_unit(self.unit_m)[1]}"


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
#: Valid size ratio of a reconstruction in metres to its model: from a part of it ...
_MIN_RATIO = 0.04
#: ... to all of it with some outliers.
_MAX_RATIO = 1.6
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
    given = PlacedPoints(model, "", T.apply(some))
    ratio = diagonal(some) / size_m
    is_near = mean_m <= NEAR * size_m
    every: list[PlacedPoints] = []
    if not is_near or ratio <= _MIN_RATIO:
        every = _other_units(given, some, T, units_m, ratio)
    of_units = _best(every, given)
    if of_units is None and not is_near:
        every += moved_placements(model, some, T)
    if best := _best(every, given):
        return (_sentence(best, given, every),)
    if not is_near and not _is_valid(ratio):
        return (_of_sizes(ratio, size_m, units_m),)
    nearest_m = min(one.mean_m for one in (given, *every) if one.kind != "mirror")
    if mean_m > _OTHER_WORLD * size_m and nearest_m > NEAR * size_m:
        return (
            f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction "
            "seems to be in another world frame; set {poses} to the trajectory that was used for "
            "fusion, and {truth} to its ground truth",
        )
    return _both_units(size_m, units_m)


def _best(every: list[PlacedPoints], given: PlacedPoints) -> PlacedPoints | None:
    """The placement that explains the distance; no reflection that hardly fits better than a
    motion.
    """
    candidates = {one.candidate(given): one for one in every}
    best = winner(list(candidates))
    if best is None:
        return None
    if best.kinds == ["mirror"]:
        motions = [one for one in candidates if one.kinds == ["motion"]]
        if not all(best.fit.halves_errors_of(one.fit) for one in motions):
            return None
    return candidates[best]


def _sentence(best: PlacedPoints, given: PlacedPoints, every: list[PlacedPoints]) -> str:
    if best.kind == "unit":
        return f"{best.words}; {best.advice}"
    what = "the reconstruction seems to be in another world frame"
    given_m = given.mean_m
    if best.kind == "mirror":
        what = "the reconstruction is mirrored"
        given_m = min(one.mean_m for one in (given, *every) if one.kind in ("", "motion"))
    return (
        f"{what}: {best.words}, its mean distance is {1e3 * best.mean_m:.3g} mm instead of "
        f"{1e3 * given_m:.3g} mm; {best.advice}"
    )


def _other_units(
    given: PlacedPoints, points: np.ndarray, T: SE3, units_m: tuple[float, float], ratio: float
) -> list[PlacedPoints]:
    """The reconstruction in other units of it or of the model with which the sizes are valid."""
    size_m = diagonal(points) / ratio
    found = []
    for scale in _SCALES:
        if _is_valid(ratio * scale):
            unit = _other_unit(scale, units_m)
            placed = PlacedPoints(given.model, "unit", unit.moved(points, T))
            words = f"{unit.words(ratio, size_m)}: {unit.means(placed.mean_m, given.mean_m)}"
            found.append(replace(placed, words=words, advice=unit.advice))
    return found


def _of_sizes(ratio: float, size_m: float, units_m: tuple[float, float]) -> str:
    """The sentence on a size that is not valid for the model or a part of it, with the unit that
    gives a similar size.
    """
    possible = [_other_unit(scale, units_m) for scale in _SCALES if _is_valid(ratio * scale)]
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


def _is_valid(ratio: float) -> bool:
    """Whether a reconstruction may be so many times as large as its model."""
    return _MIN_RATIO < ratio < _MAX_RATIO


def _unit(unit_m: float) -> tuple[str, str]:
    """The name of a unit in metres, and the value of the unit setting for it."""
    for setting, known_m in UNITS_M.items():
        if np.isclose(known_m, unit_m, rtol=1e-9):
            return unit_name(known_m), setting
    return unit_name(unit_m), f"{unit_m:g}"
