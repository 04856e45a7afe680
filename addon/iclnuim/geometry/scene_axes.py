"""Axes and units of a scene file: the settings for reading it, the resulting matrix, and a guess
for files that do not define them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..settings import Settings, declared, setting
from . import axes

#: Axis that points up in the file -> rotation that maps it to z.
UP = {
    "z": np.eye(3),
    "y": axes.Z_UP_FROM_Y_UP,
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "-y": axes.Z_UP_FROM_Y_DOWN,
    "-x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
}
UNITS_M = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
#: Metres are plausible if the largest extent and the height are within these limits; else the unit
#: is guessed from the height of a room.
PLAUSIBLE_M = (0.2, 60.0)
MAX_HEIGHT_M = 15.0
#: Height of rooms, its spread (about a quarter), and its minimum and maximum.
ROOM_HEIGHT_M = 2.6
_SPREAD = 0.25
_HEIGHTS_M = (1.9, 12.0)
#: A height that differs by more than this number of spreads is not that of a room, and only the
#: shape is used.
_MAX_SPREADS = 2.8
LAYERS = 20
#: The fullest layer of a scanned room fills 0.15 of its cross-section or more; with parts far
#: outside, 0.06 or less.
_LEVEL = 0.1
#: An axis other than the format's usual one is chosen as up if its evidence is larger by this
#: factor. x, which few programs use, needs CLEARLY_X; a unit other than metres needs CLEARLY_UNIT
#: in addition.
CLEARLY = 1.5
CLEARLY_X = 4.0
CLEARLY_UNIT = 4.0


def parse_unit(text: str) -> float:
    """The unit in metres, from `cm`, `in`, `inch`, ... or a number. Raises InputError."""
    try:
        return UNITS_M.get({"inch": "in", "foot": "ft"}.get(text, text)) or float(text)
    except ValueError:
        expected = f"a unit: {', '.join(UNITS_M)}, or metres as a number"
        raise InputError(expected, found=text) from None


@dataclass(frozen=True)
class SceneReading(Settings):
    """Settings for reading a scene file; None: as defined by the file, or a guess, which is
    reported.
    """

    group: ClassVar[str] = "the scene's reading"

    up: str | None = setting(
        None,
        "axis of the scene's file that points up; "
        "default: the format's, or a guess, which is reported",
        choices={axis: f"the file's {axis} axis points up" for axis in UP},
    )
    unit_m: float | None = setting(
        None,
        f"length unit of the scene's file: {', '.join(UNITS_M)}, or metres as a number; "
        "default: the format's, or a guess, which is reported",
        unit="m",
        low=1e-6,
        high=1e6,
        option="--scene-unit",
        label="Unit",
        parse=parse_unit,
    )
    mirror: str = setting(
        "none",
        "axis of the scene's file to mirror before any other conversion",
        choices={
            "none": "nothing is mirrored",
            **{axis: f"the {axis} axis is mirrored" for axis in "xyz"},
        },
    )
    textures: str | None = setting(
        None,
        "additional folder with textures of the scene; default: only the scene's folder",
        parse=lambda text: str(Path(text).expanduser().resolve()),
    )
    allow_outside: bool = setting(False, "read all files that the scene refers to, in any folder")

    def check_asked(self, allowed: bool, path: str | Path) -> None:
        """Raises InputError if these settings, read from the file `path`, let the scene read files
        outside its folder and the user's own act does not: no file may allow it.
        """
        if self.allow_outside and not allowed:
            hint = "{allow_outside} if you trust the scene: this file cannot allow it"
            raise InputError(
                "{allow_outside}", path=path, found="a recipe that asks for it", hint=hint
            )

    def to_dict(self) -> dict[str, Any]:
        """The inverse of from_dict; settings with their default values are left out."""
        known = declared(SceneReading)
        values = super().to_dict()
        return {name: value for name, value in values.items() if value != known[name].default}


@dataclass(frozen=True)
class Shape:
    """Measures of a scene for the guess, along the file's axes and without backdrops.

    low (3,), extent (3,): its box. level (3, LAYERS): for each axis, the area perpendicular to it,
    in layers from its low to its high end, as a share of the cross-section. askew (3,): the share
    of surfaces that are neither perpendicular nor parallel to the axis.
    """

    low: np.ndarray
    extent: np.ndarray
    level: np.ndarray
    askew: np.ndarray


def linear(up: str, unit_m: float, mirror: str) -> np.ndarray:
    """(3, 3): M with p_world = M p_file, in metres and z up.

    The determinant is negative if an axis is mirrored.
    """
    flip = np.eye(3)
    if mirror != "none":
        flip["xyz".index(mirror)] *= -1
    return unit_m * UP[up] @ flip


def shape_of(vertices: np.ndarray, triangles: np.ndarray) -> Shape:
    """The shape of vertices (n, 3) and triangles (m, 3). Parts far from the detail are not used,
    such as a landscape behind a window.

    The extent is that of 98 % of the area, so that floor and ceiling count even with few vertices.
    A surface is perpendicular to an axis within some 15 degrees.
    """
    corners = vertices[triangles.reshape(-1)].reshape(-1, 3, 3)
    low, high = np.percentile(corners.reshape(-1, 3), (2, 98), axis=0)
    margin = float((high - low).max())
    within = ((corners >= low - margin) & (corners <= high + margin)).all((1, 2))
    if within.any():
        corners = corners[within]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    areas = np.linalg.norm(vectors, axis=1)
    weights = np.repeat(areas, 3)
    low, high = np.stack([_ends(corners[..., k].ravel(), weights) for k in range(3)], -1)
    extent = high - low
    cosines = np.abs(vectors) / np.maximum(areas, 1e-30)[:, None]
    smallest = 1e-9 * float(extent.max(initial=1e-9)) ** 2
    cross_section = np.maximum(extent[[1, 0, 0]] * extent[[2, 2, 1]], smallest)
    layer = (corners.mean(1) - low) / np.maximum(extent, 1e-30) * LAYERS
    layer = layer.clip(0, LAYERS - 1).astype(int)
    facing = (cosines > 0.966) * areas[:, None]
    level = np.stack([np.bincount(layer[:, k], facing[:, k], LAYERS) for k in range(3)])
    level = level / cross_section[:, None]
    askew = (cosines > 0.05) & (cosines < 0.99)
    of_area = (askew * areas[:, None]).sum(0) / max(float(areas.sum()), 1e-30)
    askew_share = np.sqrt((of_area + 0.005) * (askew.mean(0) + 0.1))
    return Shape(low, extent, level.clip(0, 1), askew_share)


def _ends(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(2,) the values below and above which 1 % of the weight is."""
    order = values.argsort()
    share = np.cumsum(weights[order])
    at = np.searchsorted(share, np.array([0.01, 0.99]) * share[-1])
    return values[order[np.minimum(at, len(order) - 1)]]


def guess_up(shape: Shape, usual: str, unit_m: float | None = None) -> str:
    """The axis that points up: floors, ceilings and table tops are large, scenes are wider than
    high, and rooms are some 2.6 m high.

    The evidence is the horizontal area per height, times the likelihood of the height for a room,
    in `unit_m` or the guessed unit. The format's `usual` axis is chosen unless another is clearly
    better.
    """

    def evidence(axis: str) -> float:
        k = "xyz".index(axis)
        unit = unit_m or guess_unit_m(shape, axis)
        height = max(float(shape.extent[k]), 1e-9 * float(shape.extent.max(initial=1e-9)))
        spreads = min(abs(np.log(height * unit / ROOM_HEIGHT_M)) / _SPREAD, _MAX_SPREADS)
        flat = shape.level[k].sum() * shape.extent.prod() / height**2 / shape.askew[k]
        likely = float(flat * np.exp(-0.5 * spreads**2))
        if axis != usual:
            likely /= CLEARLY_X if axis == "x" else CLEARLY
        if unit != 1.0:
            likely /= CLEARLY_UNIT
        return likely

    return max((usual, *"yzx".replace(usual, "")), key=evidence)


def guess_unit_m(shape: Shape, up: str) -> float:
    """Metres if the scene then has a plausible size, else the unit for which its height is closest
    to that of a room; metres if there is none.

    Where no layer is level, as in a reconstruction with parts far outside of the room, the height
    says nothing. A scene as high as two storeys, with tables as high as a person, is a room in
    feet.
    """
    k = "xyz".index(up[-1])
    height = float(shape.extent[k])
    inner = shape.level[k, 1:-3]
    tables = float(inner @ np.arange(1.5, LAYERS - 3)) / max(float(inner.sum()), 1e-9)
    tables = tables / LAYERS * height
    if is_plausible(shape.extent, up):
        in_feet = 6.5 < height < 12 and 1.4 < tables < 4 and 0.02 < inner.max() < 0.7
        return UNITS_M["ft"] if in_feet else 1.0
    if shape.level[k].max() < _LEVEL:
        return 1.0
    low, high = _HEIGHTS_M
    fitting = [unit_m for unit_m in UNITS_M.values() if low <= height * unit_m <= high]
    rooms = [unit_m for unit_m in fitting if is_plausible(shape.extent * unit_m, up)]
    return min(rooms, key=lambda unit_m: abs(np.log(height * unit_m / ROOM_HEIGHT_M)), default=1.0)


def is_plausible(extent_m: np.ndarray, up: str) -> bool:
    """Whether a scene of this extent (3,) in metres is plausible: from an object on a table to a
    building.
    """
    low, high = PLAUSIBLE_M
    return bool(low <= extent_m.max() <= high and extent_m["xyz".index(up[-1])] <= MAX_HEIGHT_M)


def unit_name(unit_m: float) -> str:
    """The name of a unit, such as `centimetres` or `units of 0.3 m`."""
    names = dict(
        zip(
            UNITS_M.values(),
            ("metres", "decimetres", "centimetres", "millimetres", "inches", "feet"),
            strict=True,
        )
    )
    return names.get(unit_m, f"units of {unit_m:g} m")
