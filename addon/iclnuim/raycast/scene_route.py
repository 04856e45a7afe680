"""Waypoints of a trajectory through a scene, and the free space in which its route is planned."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..geometry.handheld_plan import (
    SPACINGS_M,
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
from .caster import RayCaster
from .distance import TriangleDistance
from .gaze import FAR_M, directions, shares_seen
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


def planned_in_rooms(
    vertices: np.ndarray, triangles: np.ndarray, count: int, scene: str, settings: PlanSettings
) -> tuple[HandheldPlan, list[str]]:
    """Hand-held motion through `count` viewpoints in the rooms of a scene (vertices (n, 3) in
    metres, triangles (m, 3)), and notes: the viewpoints, and that there is little to see.

    Raises InputError if the scene is not of the size of a building, or too full.
    """
    space = _space_of_building(vertices, triangles)
    caster = RayCaster(vertices, triangles)
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


def _space_of_building(vertices: np.ndarray, triangles: np.ndarray) -> FreeSpace:
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
    return FreeSpace.between(low, high, TriangleDistance(vertices, triangles).distance)


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


def _little_seen(T_world_camera: SE3, caster: RayCaster) -> list[str]:
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
    waypoints: Sequence[Waypoint], vertices: np.ndarray, triangles: np.ndarray
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
    measure = TriangleDistance(vertices, triangles).distance
    return FreeSpace.between(places.min(0) - DETOUR_M, places.max(0) + DETOUR_M, measure)
