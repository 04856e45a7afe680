"""Viewpoints in the free space of a scene, where a person could hold a camera."""

import numpy as np

from ..errors import InputError
from ..geometry.grids import cells_to_the_edge, connected_parts, with_neighbours
from ..geometry.handheld_plan import MARGINS_M, FreeSpace
from ..geometry.points import farthest_points
from .caster import Caster

#: Heights of eyes and cameras above the floor.
_LOW_EYES_M = 1.2
HIGH_EYES_M = 1.7
#: Maximum step of a person on a floor, including stairs; furniture is higher.
STEP_M = 0.2
#: Maximum share of rays from a free place that hit back faces.
_BACKS = 0.1
#: A place is in a room if the share of horizontal rays that hit a surface is at least this share of
#: the largest one.
_ENCLOSED = 0.6
#: If no more than this share of the places is free, the walls show their back faces to the room,
#: and back faces are ignored.
_FEW = 0.2


def viewpoints(
    space: FreeSpace, caster: Caster, count: int, clear_m: float, seed: int
) -> tuple[np.ndarray, FreeSpace]:
    """`count` places (count, 3) in rooms above one connected floor, ordered for short routes, and
    the part of the space where a person on this floor holds a camera.

    Raises InputError if there are not enough free places.
    """
    if not 2 <= count <= 100:
        raise InputError("2 to 100 viewpoints", found=count)
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(64, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cells, floor = _cells_above_floors(space, caster, clear_m)
    chosen = rng.permutation(len(cells))[:3000]  # enough to choose from, and soon cast
    chosen = chosen[_in_rooms(space.low_m + space.cell_m * cells[chosen], caster, rays)]
    largest = 0
    if len(chosen):
        best = np.bincount(floor[chosen]).argmax()
        walked = _held_above(space, cells[floor == best], clear_m)
        cells = cells[chosen[floor[chosen] == best]]
        for margin_m in MARGINS_M:
            inside = _in_largest_part(walked.clearance_m >= clear_m + margin_m, cells)
            if len(inside) >= count:
                places = space.low_m + space.cell_m * inside
                return _in_short_order(farthest_points(places, count)), walked
            largest = max(largest, len(inside))
    raise _too_few(space, count, largest)


def _too_few(space: FreeSpace, count: int, found: int) -> InputError:
    fewer = f"auto:{found}, " if found > 1 else ""
    height = space.cell_m * (space.clearance_m.shape[2] - 1)
    return InputError(
        f"a floor with {count} places free of surfaces {_LOW_EYES_M} to {HIGH_EYES_M} m above it, "
        "connected to one another",
        found=f"{found} in a scene {height:.2g} m high",
        hint=f"{fewer}a smaller {{clearance_m}}, another {{unit_m}} if the scene's size is wrong, "
        "or given viewpoints",
    )


def _in_short_order(places: np.ndarray) -> np.ndarray:
    """The places (n, 3) from the first one always to the nearest remaining one."""
    remaining = list(range(1, len(places)))
    order = [0]
    while remaining:
        away_m = [np.linalg.norm(places[k] - places[order[-1]]) for k in remaining]
        order.append(remaining.pop(int(np.argmin(away_m))))
    return places[order]


def _cells_above_floors(
    space: FreeSpace, caster: Caster, clear_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Free cells (n, 3) where a person can hold a camera, and the number of the floor below (n,).

    Table tops are separate floors, because the step to them is too high.
    """
    cells = np.argwhere(space.clearance_m >= clear_m)
    places = space.low_m + space.cell_m * cells
    below = _cast_from(caster, places, np.array([[0.0, 0.0, -1.0]]))[0][:, 0]
    slack = max(space.cell_m - 0.3, 0.0)  # with coarse cells there may be no layer at eye height
    at_eyes = (below >= _LOW_EYES_M - slack) & (below <= HIGH_EYES_M + slack)
    cells = cells[at_eyes]
    floors = places[at_eyes, 2] - below[at_eyes]
    steps = np.rint((floors - floors.min(initial=np.inf)) / STEP_M).astype(int)
    walked = np.zeros((*space.clearance_m.shape[:2], steps.max(initial=0) + 1), bool)
    place = (cells[:, 0], cells[:, 1], steps)
    walked[place] = True
    return cells, connected_parts(walked)[place]


def _held_above(space: FreeSpace, cells: np.ndarray, clear_m: float) -> FreeSpace:
    """The space of these cells (n, 3), for cameras `clear_m` from every surface: the margin beyond
    this distance is kept from the edge of the space too, and none is more than a cell beyond it.
    """
    above = np.zeros(space.clearance_m.shape, bool)
    above[tuple(cells.T)] = True
    # there is no margin above or below
    inward_m = space.cell_m * cells_to_the_edge(above)
    allowed_m = np.where(with_neighbours(above), clear_m + inward_m, 0.0)

    def measure(points: np.ndarray) -> np.ndarray:
        index = np.rint((points - space.low_m) / space.cell_m).astype(int)
        inside = index.clip(0, np.array(above.shape) - 1)
        found = np.where((inside == index).all(1), allowed_m[tuple(inside.T)], 0.0)
        return np.minimum(found, space.measure(points))

    clearance_m = np.where(above, np.minimum(allowed_m, space.clearance_m), 0.0)
    return FreeSpace(space.low_m, space.cell_m, clearance_m, measure)


def _in_largest_part(free: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Those of the cells (n, 3) that are in the connected part of free (i, j, k) with most of
    them.
    """
    part = connected_parts(free)[tuple(cells.T)]
    counts = np.bincount(part)
    counts[0] = 0
    return cells[(part == counts.argmax()) & (part > 0)]


def _in_rooms(places: np.ndarray, caster: Caster, rays: np.ndarray) -> np.ndarray:
    """(n,) whether a place is surrounded by walls.

    Back faces mean that it is inside an object, unless all walls show their back faces.
    """
    distance, back = _cast_from(caster, places, rays)
    free = back.mean(1) < _BACKS
    if free.sum() <= _FEW * len(free):
        free = np.ones(len(places), bool)
    around = np.isfinite(distance)[:, np.abs(rays[:, 2]) < 0.3].mean(1)
    return free & (around >= _ENCLOSED * around[free].max(initial=0.0))


def _cast_from(
    caster: Caster, places: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From places (n, 3) along unit directions (d, 3): distance (n, d), inf without a hit, and
    whether a back face was hit (n, d).
    """
    shape = (len(places), len(directions), 3)
    hits = caster.cast(np.broadcast_to(places[:, None], shape), np.broadcast_to(directions, shape))
    distance = hits.distance.astype(float)
    return distance, np.isfinite(distance) & ((hits.normal * directions).sum(-1) > 0)
