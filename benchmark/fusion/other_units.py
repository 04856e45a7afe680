"""Units of length that a reconstruction or its model may have by mistake."""

from typing import NamedTuple

import numpy as np
from iclnuim.geometry.scene_axes import UNITS_M, unit_name
from iclnuim.geometry.se3 import SE3

#: A scale within this share of that of a unit is that unit's.
_SAME = 0.01
#: Between units that are mistaken for each other.
SCALES = [unit_m for unit_m in UNITS_M.values() if unit_m != 1]
SCALES += [1 / unit_m for unit_m in SCALES]


class OtherUnit(NamedTuple):
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

    def in_metres(self, distance: float) -> float:
        """A distance in the unit of the model as read."""
        return distance / self.scale if self.whose == "model" else distance

    @property
    def advice(self) -> str:
        return f"set {self.setting} to {_unit(self.unit_m)[1]}"


def other_unit(scale: float, units_m: tuple[float, float]) -> OtherUnit:
    """Of two that are known the one that was set, or of the reconstruction."""
    mesh_m, model_m = units_m
    mesh = OtherUnit("reconstruction", "{unit}", mesh_m * scale, mesh_m, scale)
    model = OtherUnit("model", "{model_unit}", model_m / scale, model_m, scale)
    if not _is_known(model.unit_m):
        return mesh
    if not _is_known(mesh.unit_m) or (mesh_m == 1 and model_m != 1):
        return model
    return mesh


def unit_of_scale(scale: float, units_m: tuple[float, float]) -> OtherUnit | None:
    """The unit whose scale this nearly is."""
    known = min(SCALES, key=lambda one: abs(np.log(one / scale)))
    return other_unit(known, units_m) if abs(known / scale - 1) < _SAME else None


def _is_known(unit_m: float) -> bool:
    return bool(np.isclose(list(UNITS_M.values()), unit_m, rtol=1e-9).any())


def _unit(unit_m: float) -> tuple[str, str]:
    """The name of a unit in metres, and the value of the unit setting for it."""
    for setting, known_m in UNITS_M.items():
        if np.isclose(known_m, unit_m, rtol=1e-9):
            return unit_name(known_m), setting
    return unit_name(unit_m), f"{unit_m:g}"
