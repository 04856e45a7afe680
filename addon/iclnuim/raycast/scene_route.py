"""Waypoints of a trajectory through a scene, and the free space in which its route is planned."""

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..geometry.handheld_plan import FreeSpace, PlanSettings, Waypoint
from ..geometry.scene_axes import is_plausible, shape_of
from .caster import RayCaster
from .distance import TriangleDistance
from .viewpoints import viewpoints

#: The route around obstacles may leave the box of the waypoints by this distance.
DETOUR_M = 2.0
#: Every waypoint within this distance of the scene is accepted.
NEAR_M = 20.0
#: Chosen waypoints keep within this distance of the box that holds most of the scene.
_BEYOND_M = 0.5


def chosen_waypoints(
    vertices: np.ndarray, triangles: np.ndarray, count: int, settings: PlanSettings
) -> tuple[list[Waypoint], FreeSpace]:
    """`count` waypoints in the rooms of a scene (vertices (n, 3) in metres, triangles (m, 3)), and
    its free space. Raises InputError if the scene is not of the size of a building, or too full.
    """
    shape = shape_of(vertices, triangles)
    if not is_plausible(shape.extent, "z"):
        size = " x ".join(f"{x:.3g}" for x in shape.extent)
        expected = "a scene of the size of a room or building"
        hint = "another {unit_m}, or explicit viewpoints"
        raise InputError(expected, found=f"{size} m", hint=hint)
    low = np.maximum(shape.low - _BEYOND_M, vertices.min(0))
    high = np.minimum(shape.low + shape.extent + _BEYOND_M, vertices.max(0))
    space = FreeSpace.between(low, high, TriangleDistance(vertices, triangles).distance)
    caster = RayCaster(vertices, triangles)
    return viewpoints(space, caster, count, settings.clearance_m, settings.seed), space


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
