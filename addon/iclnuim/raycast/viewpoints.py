"""Viewpoints chosen in a scene's free space: in rooms, at the height of eyes, far from one another, looking across."""

import numpy as np

from ..errors import InputError
from ..geometry.handheld_plan import FreeSpace, Waypoint, rounded
from ..geometry.points import farthest_points
from .caster import RayCaster

_CANDIDATES, _RAYS = 3000, 64
#: Places above a floor that eyes and cameras are held at.
_EYES_M = (1.0, 1.8)
#: A free place sees no more backs than this; of free places those in rooms see nearly as many surfaces as any.
_BACKS, _ENCLOSED = 0.1, 0.9


def chosen(space: FreeSpace, caster: RayCaster, count: int, clear_m: float, seed: int) -> list[Waypoint]:
    """`count` waypoints in an order with short routes. Raises InputError where there is no room for them."""
    if not 2 <= count <= 100:
        raise InputError("2 to 100 viewpoints", found=count)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(space.clearance_m >= clear_m + space.cell_m)
    if len(cells) > _CANDIDATES:
        cells = cells[rng.choice(len(cells), _CANDIDATES, replace=False)]
    places = space.low_m + space.cell_m * cells
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places = _inside(places, caster, rays)
    if len(places) < count:
        found = f"{len(places)} free places"
        raise InputError(f"room for {count} viewpoints", found=found, hint="giving the {viewpoints}")
    places = farthest_points(places, count)
    left, order = list(range(1, count)), [0]
    while left:  # from one to the nearest that is left
        here = places[order[-1]]
        order.append(left.pop(int(np.argmin([np.linalg.norm(places[k] - here) for k in left]))))
    places = places[order]
    return [Waypoint(rounded(p), rounded(_gaze(p, places, caster, rays))) for p in places]


def _inside(places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """Those in rooms; at eye height above what lies below, where there are enough of them."""
    if not len(places):
        return places
    distance, back = _look(caster, places, rays)
    fronts = (np.isfinite(distance) & ~back).mean(1)
    free = (back.mean(1) < _BACKS) & (fronts > 0)
    free &= fronts >= _ENCLOSED * fronts[free].max(initial=0.0)
    places = places[free]
    below = _look(caster, places, np.array([[0.0, 0.0, -1.0]]))[0][:, 0] if len(places) else np.zeros(0)
    standing = (below > _EYES_M[0]) & (below < _EYES_M[1])
    return places[standing] if standing.sum() >= 50 else places


def _look(caster: RayCaster, places: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From places (n, 3) along unit directions (d, 3): distance (n, d), inf where nothing is met, and whether a back was met (n, d)."""
    shape = (len(places), len(directions), 3)
    hits = caster.cast(np.broadcast_to(places[:, None], shape), np.broadcast_to(directions, shape))
    distance = hits.distance.astype(float)
    return distance, np.isfinite(distance) & ((hits.normal * directions).sum(-1) > 0)


def _gaze(place: np.ndarray, places: np.ndarray, caster: RayCaster, rays: np.ndarray) -> np.ndarray:
    """A point ahead, across the room: towards the middle of all viewpoints, or where it is far, a little down."""
    middle = places.mean(0) - place
    level = rays[np.abs(rays[:, 2]) < 0.3]
    far = np.minimum(_look(caster, place[None], level)[0][0], 10.0)
    towards = level @ (middle / max(float(np.linalg.norm(middle)), 1e-6))
    ahead = level[int((far * (1.2 + towards)).argmax())]
    return place + 2.0 * np.array([ahead[0], ahead[1], 0.0]) / np.hypot(*ahead[:2]) + [0.0, 0.0, -0.25]
