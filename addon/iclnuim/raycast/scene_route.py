"""A route through a scene: its waypoints, the free space in which it is planned, and viewing
directions along it, towards what there is to see, with the pitch and the range of our kt0..kt3.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..geometry.handheld import rotation_world_camera
from ..geometry.handheld_plan import (
    SPACINGS_M,
    Clearance,
    FreeSpace,
    HandheldPlan,
    PlanSettings,
    Waypoint,
    along,
    plan,
    rounded,
    routes_between,
)
from ..geometry.scene_axes import is_plausible, shape_of
from ..geometry.se3 import SE3
from .caster import Caster, RayCaster
from .distance import TriangleDistance
from .viewpoints import HIGH_EYES_M, STEP_M, viewpoints

#: The route around obstacles may leave the box of the waypoints by this distance.
DETOUR_M = 2.0
#: Every waypoint within this distance of the scene is accepted.
NEAR_M = 20.0
#: Chosen waypoints keep within this distance of the box that holds most of the scene.
_BEYOND_M = 0.5
#: Less than these shares of a frame, and of all frames on average, are little to see.
LEAST_SEEN = 0.2
MEAN_SEEN = 0.5
#: Every such frame, at half a second, is checked.
_CHECKED_EACH = 15
#: Surfaces that are farther away are not worth a view.
FAR_M = 8.0
#: Pitch of kt0..kt3 of both scenes, and the median distance of what is in view: their quantiles 5,
#: 25, 50, 75 and 95 %.
_PITCHES_RAD = np.radians([-24.0, -17.0, -12.0, -8.0, -1.0])
_RANGES_M = np.array([1.7, 2.1, 2.9, 3.5, 4.0])
#: Yaws that are compared, each with all pitches.
_YAWS_RAD = np.arange(24) * (2 * np.pi / 24)
#: Maximum rotation to the next point, so that all that is seen between is in one of the two views.
_MAX_TURN_RAD = np.radians(45.0)


def planned_in_rooms(
    vertices: np.ndarray,
    triangles: np.ndarray,
    count: int,
    scene: str,
    settings: PlanSettings,
    caster: Caster | None = None,
    measure: Clearance | None = None,
) -> tuple[HandheldPlan, list[str]]:
    """Hand-held motion through `count` viewpoints in the rooms of a scene (vertices (n, 3) in
    metres, triangles (m, 3)), and notes: the viewpoints, and that there is little to see.

    caster, measure: rays and distances of the scene; those of Embree and libigl by default. Raises
    InputError if the scene is not of the size of a building, or too full.
    """
    space = _space_of_building(vertices, triangles, measure)
    caster = caster or RayCaster(vertices, triangles)
    places, held = viewpoints(space, caster, count, settings.clearance_m, settings.seed)
    routes = next(routes_between(list(places), held, settings.clearance_m))
    points, stops = _points_on(routes)
    ahead = directions(points, stops, caster, settings.seed)
    looks = zip(points, points + 2 * ahead, strict=True)
    waypoints = [Waypoint(rounded(point), rounded(target)) for point, target in looks]
    made = plan(waypoints, held, scene, settings)
    clearance_m = float(space.measure(made.motion.trajectory.positions_m).min())
    notes = [_named(waypoints[stop]) for stop in stops]
    notes += _little_seen(made.motion.trajectory.T_world_camera, caster)
    return replace(made, clearance_m=clearance_m), notes


def _space_of_building(
    vertices: np.ndarray, triangles: np.ndarray, measure: Clearance | None = None
) -> FreeSpace:
    """The free space of the box that holds most of the scene, and of a person on its floor."""
    shape = shape_of(vertices, triangles)
    if not is_plausible(shape.extent, "z"):
        size = " x ".join(f"{x:.3g}" for x in shape.extent)
        expected = "a scene of the size of a room or building"
        hint = "another {unit_m}, or explicit viewpoints"
        raise InputError(expected, found=f"{size} m", hint=hint)
    low = np.maximum(shape.low - _BEYOND_M, vertices.min(0))
    high = np.minimum(shape.low + shape.extent + _BEYOND_M, vertices.max(0))
    high[2] = max(high[2], low[2] + HIGH_EYES_M + STEP_M)
    measure = measure or TriangleDistance(vertices, triangles).distance
    return FreeSpace.between(low, high, measure)


def _points_on(routes: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) along the routes, and the indices of the places that these connect."""
    points = [routes[0][:1]]
    stops = [0]
    for route in routes:
        points.append(along(route, SPACINGS_M[1])[1][1:])
        stops.append(stops[-1] + len(points[-1]))
    return np.concatenate(points), np.array(stops)


def _named(waypoint: Waypoint) -> str:
    points = (waypoint.position_m, waypoint.look_at_m or ())
    texts = [",".join(f"{x:.2f}" for x in point) for point in points]
    return f"viewpoint {':'.join(texts)}"


def _little_seen(T_world_camera: SE3, caster: Caster) -> list[str]:
    """A note if frames see less than a fifth, or all of them less than half on average."""
    shares = shares_seen(T_world_camera[::_CHECKED_EACH], caster)
    if shares.min() >= LEAST_SEEN and shares.mean() >= MEAN_SEEN:
        return []
    return [
        f"note: surfaces within {FAR_M:g} m fill {100 * shares.mean():.0f} % of the view on "
        f"average, {100 * shares.min():.0f} % at least: no direction from this floor shows more; "
        "given viewpoints, or another scene unit if its size is wrong, may"
    ]


def space_around(
    waypoints: Sequence[Waypoint],
    vertices: np.ndarray,
    triangles: np.ndarray,
    measure: Clearance | None = None,
) -> FreeSpace:
    """The free space of a scene around given waypoints.

    Raises InputError for a waypoint farther from the scene than NEAR_M, and than the scene is
    large.
    """
    places = np.array([waypoint.position_m for waypoint in waypoints])
    low, high = vertices.min(0), vertices.max(0)
    limit_m = max(NEAR_M, float(np.linalg.norm(high - low)))
    for place in places:
        beyond_m = float(np.linalg.norm(place - place.clip(low, high)))
        if beyond_m > limit_m:
            found = f"{','.join(f'{x:g}' for x in place)}, {beyond_m:.3g} m outside it"
            expected = f"viewpoints in the scene or at most {limit_m:.3g} m outside it"
            raise InputError(expected, found=found)
    measure = measure or TriangleDistance(vertices, triangles).distance
    return FreeSpace.between(places.min(0) - DETOUR_M, places.max(0) + DETOUR_M, measure)


def directions(points: np.ndarray, stops: np.ndarray, caster: Caster, seed: int) -> np.ndarray:
    """Unit viewing directions (n, 3) at points (n, 3) of a route, of which those with the indices
    `stops` are viewpoints.

    Of all sequences of views it is the one that shows most of the surfaces, with little rotation,
    while pitch and range go from viewpoint to viewpoint through those of kt0..kt3, in an order by
    `seed`. As bad as a view of half as many surfaces are a range that is wrong by a factor of 2, a
    pitch that is wrong by its standard deviation, and a rotation by half a turn.
    """
    yaws, pitches = (part.ravel() for part in np.meshgrid(_YAWS_RAD, _PITCHES_RAD))
    views = rotation_world_camera(yaws, pitches, np.zeros_like(yaws))
    distance_m = np.stack([_distances(views, point, caster) for point in points])
    shares = (distance_m <= FAR_M).mean(-1).clip(1e-3)
    ranges_m = np.median(distance_m.clip(1e-3, FAR_M), axis=-1)
    rng = np.random.default_rng(seed)
    pitch = _through(rng.permutation(_PITCHES_RAD), stops)
    range_m = _through(rng.permutation(_RANGES_M), stops)
    costs = np.log2(shares) ** 2 + np.log2(ranges_m / range_m) ** 2
    costs += ((pitches - pitch) / _PITCHES_RAD.std()) ** 2
    yaw_steps = (yaws[:, None] - yaws + np.pi) % (2 * np.pi) - np.pi
    turns_rad = np.hypot(yaw_steps, pitches[:, None] - pitches)
    steps = np.where(turns_rad < 1.01 * _MAX_TURN_RAD, (turns_rad / np.pi) ** 2, np.inf)
    return views[_cheapest(costs, steps), :, 2]


def shares_seen(T_world_camera: SE3, caster: Caster) -> np.ndarray:
    """The share of the view that surfaces within FAR_M fill, for each of n poses."""
    poses = zip(T_world_camera.rotation, T_world_camera.translation, strict=True)
    distance_m = np.array([_distances(rotation, place, caster) for rotation, place in poses])
    return (distance_m <= FAR_M).mean(1)


def _distances(rotations: np.ndarray, place: np.ndarray, caster: Caster) -> np.ndarray:
    """Distances (..., 140) of the surfaces that the default camera sees from a place with rotations
    (..., 3, 3), inf where it sees none.
    """
    x, y = np.meshgrid(np.linspace(-0.66, 0.66, 14), np.linspace(-0.5, 0.5, 10))
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return caster.cast(place, rays @ np.swapaxes(rotations, -1, -2)).distance


def _through(quantiles: np.ndarray, stops: np.ndarray) -> np.ndarray:
    """(n, 1) for the n points up to the last stop: one of the quantiles at each stop, and linear
    between them.
    """
    wanted = np.resize(quantiles, len(stops))
    return np.interp(np.arange(stops[-1] + 1), stops, wanted)[:, None]


def _cheapest(costs: np.ndarray, steps: np.ndarray) -> list[int]:
    """The sequence of choices (n,) with the least sum of their costs (n, v), and of those of each
    step (v, v) from one to the next: by dynamic programming.
    """
    total = costs[0]
    before = []
    for cost in costs[1:]:
        sums = total[:, None] + steps
        before.append(sums.argmin(0))
        total = sums.min(0) + cost
    chosen = [int(total.argmin())]
    for choice in reversed(before):
        chosen.append(int(choice[chosen[-1]]))
    return chosen[::-1]
