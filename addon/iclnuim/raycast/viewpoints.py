"""Viewpoints in the free space of a scene, where a person could hold a camera."""

import numpy as np

from ..errors import InputError
from ..geometry.handheld_plan import MARGINS_M, FreeSpace, Waypoint, rounded
from ..geometry.points import farthest_points
from .caster import RayCaster

#: Heights of eyes and cameras above the floor.
_LOW_EYES_M = 1.2
_HIGH_EYES_M = 1.7
#: Maximum step of a person on a floor, including stairs; furniture is higher.
_STEP_M = 0.2
#: Maximum share of rays from a free place that hit back faces.
_BACKS = 0.1
#: A place is in a room if the share of horizontal rays that hit a surface is at least this share of
#: the largest one.
_ENCLOSED = 0.6
#: If no more than this share of the places is free, the walls show their back faces to the room,
#: and back faces are ignored.
_FEW = 0.2


def viewpoints(
    space: FreeSpace, caster: RayCaster, count: int, clear_m: float, seed: int
) -> list[Waypoint]:
    """`count` waypoints above one connected floor, ordered for short routes.

    Raises InputError if there are not enough free places.
    """
    if not 2 <= count <= 100:
        raise InputError("2 to 100 viewpoints", found=count)
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(64, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places = np.zeros((0, 3))
    largest = 0
    for margin_m in MARGINS_M:
        places = _camera_places(space, caster, clear_m + margin_m, rays, rng)
        largest = max(largest, len(places))
        if len(places) >= count:
            break
    if len(places) < count:
        raise _too_few(space, count, largest)
    places = _in_short_order(farthest_points(places, count))
    return [Waypoint(rounded(p), rounded(_gaze(p, places, caster, rays))) for p in places]


def _too_few(space: FreeSpace, count: int, found: int) -> InputError:
    fewer = f"auto:{found}, " if found > 1 else ""
    height = space.cell_m * (space.clearance_m.shape[2] - 1)
    return InputError(
        f"a floor with {count} places free of surfaces {_LOW_EYES_M} to {_HIGH_EYES_M} m above it, "
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


def _camera_places(
    space: FreeSpace, caster: RayCaster, clear_m: float, rays: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(n, 3) places where a person can hold a camera: those in rooms, above the largest connected
    floor.

    Table tops are separate floors, because the step to them is too high. So are rooms that are not
    connected.
    """
    from scipy import ndimage

    cells = np.argwhere(space.clearance_m >= clear_m)
    places = space.low_m + space.cell_m * cells
    if not len(cells):
        return places
    below = _cast_from(caster, places, np.array([[0.0, 0.0, -1.0]]))[0][:, 0]
    slack = max(space.cell_m - 0.3, 0.0)  # with coarse cells there may be no layer at eye height
    at_eyes = (below >= _LOW_EYES_M - slack) & (below <= _HIGH_EYES_M + slack)
    if not at_eyes.any():
        return places[at_eyes]
    cells = cells[at_eyes]
    places = places[at_eyes]
    below = below[at_eyes]
    floors = places[:, 2] - below
    steps = np.rint((floors - floors.min()) / _STEP_M).astype(int)
    walked = np.zeros((*space.clearance_m.shape[:2], steps.max() + 1), bool)
    walked[cells[:, 0], cells[:, 1], steps] = True
    floor = ndimage.label(walked, np.ones((3, 3, 3)))[0][cells[:, 0], cells[:, 1], steps]
    part = ndimage.label(space.clearance_m >= clear_m, np.ones((3, 3, 3)))[0][tuple(cells.T)]
    group = floor * (part.max() + 1) + part
    places[:, 2] = floors + below.clip(_LOW_EYES_M, _HIGH_EYES_M)
    sampled = rng.permutation(len(places))[:3000]  # enough to choose from, and soon cast
    sampled = sampled[_in_rooms(places[sampled], caster, rays)]
    names, counts = np.unique(group[sampled], return_counts=True)
    return places[sampled[group[sampled] == names[counts.argmax()]]] if len(sampled) else places[:0]


def _in_rooms(places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """(n,) whether a place is surrounded by walls.

    Back faces mean that it is inside an object, unless all walls show their back faces.
    """
    distance, back = _cast_from(caster, places, rays)
    free = back.mean(1) < _BACKS
    if free.mean() <= _FEW:
        free = np.ones(len(places), bool)
    around = np.isfinite(distance)[:, np.abs(rays[:, 2]) < 0.3].mean(1)
    return free & (around > 0) & (around >= _ENCLOSED * around[free].max(initial=0.0))


def _cast_from(
    caster: RayCaster, places: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From places (n, 3) along unit directions (d, 3): distance (n, d), inf without a hit, and
    whether a back face was hit (n, d).
    """
    shape = (len(places), len(directions), 3)
    hits = caster.cast(np.broadcast_to(places[:, None], shape), np.broadcast_to(directions, shape))
    distance = hits.distance.astype(float)
    return distance, np.isfinite(distance) & ((hits.normal * directions).sum(-1) > 0)


def _gaze(place: np.ndarray, places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """A target across the room: in the direction of the centre of all viewpoints or of a large
    distance, slightly downwards.
    """
    middle = places.mean(0) - place
    level = rays[np.abs(rays[:, 2]) < 0.3]
    far = np.minimum(_cast_from(caster, place[None], level)[0][0], 10.0)
    towards = level @ (middle / max(float(np.linalg.norm(middle)), 1e-6))
    ahead = level[int((far * (1.2 + towards)).argmax())]
    along = np.array([ahead[0], ahead[1], 0.0]) / np.hypot(ahead[0], ahead[1])
    return place + 2.0 * along + [0.0, 0.0, -0.25]
