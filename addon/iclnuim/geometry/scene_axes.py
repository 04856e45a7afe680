"""Where a scene file's axes and units lead: the options of a reading, the matrix they make, and a guess for files that say nothing."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError
from ..settings import Settings, declared, setting
from . import axes

#: Axis that points up in the file -> rotation that turns it to z.
UP = {
    "z": np.eye(3),
    "y": axes.Z_UP_FROM_Y_UP,
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "-y": axes.Z_UP_FROM_Y_DOWN,
    "-x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
}
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
#: Metres are believed while the scene's largest extent stays within these; else the unit that makes it about a room high.
PLAUSIBLE_M, ROOM_HEIGHT_M = (0.2, 60.0), 2.5
#: The other axis is taken for up where level surfaces speak for it this much more clearly than for the usual one.
CLEARLY = 1.5


def parse_unit(text: str) -> float:
    """Metres of `cm`, `in`, ... or of a number. Raises InputError."""
    try:
        return UNITS_M[text] if text in UNITS_M else float(text)
    except ValueError:
        raise InputError(f"a unit: {', '.join(UNITS_M)}, or metres as a number", found=text) from None


@dataclass(frozen=True)
class SceneReading(Settings):
    """How a scene file is to be read; None leaves it to the file or to a guess, which is reported."""

    group: ClassVar[str] = "the scene's reading"

    up: str | None = setting(
        None,
        "axis of the scene's file that points up; default: the format's, or a guess, which is reported",
        choices={axis: f"the file's {axis} axis points up" for axis in UP},
    )
    unit_m: float | None = setting(
        None,
        f"length unit of the scene's file: {', '.join(UNITS_M)}, or metres as a number; default: the format's, or a guess, which is reported",
        unit="m",
        low=1e-6,
        high=1e6,
        option="--scene-unit",
        label="Unit",
        parse=parse_unit,
    )
    mirror: str = setting(
        "none",
        "axis of the scene's file to mirror before all else",
        choices={"none": "nothing is mirrored", **{axis: f"the {axis} axis is mirrored" for axis in "xyz"}},
    )
    textures: str | None = setting(
        None,
        "a further folder that the scene's textures may come from; default: its own only",
        parse=lambda text: str(Path(text).expanduser().resolve()),
    )
    allow_outside: bool = setting(False, "read whatever files the scene names, wherever they are")

    def to_dict(self) -> dict[str, Any]:
        """The inverse of from_dict; what is left open is left out."""
        return {k: v for k, v in super().to_dict().items() if v != declared(SceneReading)[k].default}


@dataclass(frozen=True)
class Shape:
    """What a guess goes by: extent (3,) of nearly all corners along the file's axes, and area_facing (3,) of surfaces square to each."""

    extent: np.ndarray
    area_facing: np.ndarray


def linear(up: str, unit_m: float, mirror: str) -> np.ndarray:
    """(3, 3): p_world = M p_file, in metres and z up. Determinant below 0 where something is mirrored."""
    flip = np.diag([-1.0 if axis == mirror else 1.0 for axis in "xyz"])
    return unit_m * UP[up] @ flip


def shape_of(vertices: np.ndarray, triangles: np.ndarray) -> Shape:
    """Of vertices (n, 3) and triangles (m, 3), where its detail is: a landscape seen through a window does not count.

    A surface faces an axis within some 15 degrees.
    """
    corners = vertices[triangles.reshape(-1)].reshape(-1, 3, 3)
    low, high = np.percentile(corners.reshape(-1, 3), (2, 98), axis=0)
    within = ((corners.mean(1) >= low) & (corners.mean(1) <= high)).all(1)
    corners = corners[within] if within.any() else corners
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    areas = np.linalg.norm(vectors, axis=1)
    facing = np.abs(vectors) > 0.966 * np.maximum(areas, 1e-30)[:, None]
    return Shape(high - low, (facing * areas[:, None]).sum(0))


def guess_up(shape: Shape, usual: str) -> str:
    """`y` or `z`. Floors, ceilings and table tops are large, and scenes are wider than high: level area per height decides.

    The format's `usual` axis wins unless the other is clearly better.
    """
    other = {"y": "z", "z": "y"}[usual]
    evidence = {
        axis: shape.area_facing[k] / max(float(shape.extent[k]), 1e-9 * float(shape.extent.max(initial=1e-9)))
        for axis, k in (("y", 1), ("z", 2))
    }
    return other if evidence[other] > CLEARLY * evidence[usual] and evidence[other] > 0 else usual


def guess_unit_m(shape: Shape, up: str) -> float:
    """Metres if the scene is then of a plausible size; else the one of m, cm, mm that makes it most nearly a room high."""
    largest, height = float(shape.extent.max(initial=0.0)), float(shape.extent["xyz".index(up[-1])])
    if PLAUSIBLE_M[0] <= largest <= PLAUSIBLE_M[1] or largest <= 0:
        return 1.0
    measure = height if height > 0 else largest
    return min((1.0, 0.01, 0.001), key=lambda unit_m: abs(np.log(measure * unit_m / ROOM_HEIGHT_M)))


def unit_name(unit_m: float) -> str:
    """`centimetres`, or `0.3 m`."""
    names = {1.0: "metres", 0.01: "centimetres", 0.001: "millimetres", 0.0254: "inches", 0.3048: "feet"}
    return names.get(unit_m, f"units of {unit_m:g} m")
