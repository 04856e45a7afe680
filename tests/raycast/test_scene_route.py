"""Waypoints through a scene: how far from it they may lie, and how far the route may leave them."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.handheld_plan import PlanSettings, Waypoint
from iclnuim.raycast.scene_route import chosen_waypoints, space_around


def quad(origin, u, v):
    """Vertices (4, 3) and triangles (2, 3) of a parallelogram."""
    origin, u, v = (np.array(a, float) for a in (origin, u, v))
    return np.stack([origin, origin + u, origin + u + v, origin + v]), [[0, 1, 2], [0, 2, 3]]


def surface(*quads):
    """Vertices and triangles of several parallelograms."""
    vertices, triangles = [], []
    for k, (corners, faces) in enumerate(quads):
        vertices.append(corners)
        triangles.append(np.array(faces) + 4 * k)
    return np.concatenate(vertices), np.concatenate(triangles)


def wall(half_width_m):
    """A wall at x = 1 with a way round its sides, at y = +-half_width_m."""
    return surface(quad((1, -half_width_m, -9), (0, 2 * half_width_m, 0), (0, 0, 18)))


WAYPOINTS = [Waypoint((0.0, 0.0, 1.0)), Waypoint((2.0, 0.0, 1.0))]


@pytest.mark.parametrize("half_width_m, detour", [(1.4, True), (2.6, False)])
def test_a_route_leaves_the_box_of_its_waypoints_by_two_metres(half_width_m, detour):
    space = space_around(WAYPOINTS, *wall(half_width_m))
    start, end = (np.array(w.position_m) for w in WAYPOINTS)
    if detour:
        corners = space.route(start, end, 0.3)
        assert np.abs(corners[:, 1]).max() > half_width_m
    else:
        with pytest.raises(InputError, match="a route between them"):
            space.route(start, end, 0.3)


def test_a_waypoint_may_lie_somewhat_outside_a_small_scene():
    scene = surface(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    space_around([Waypoint((-18.0, 0.0, 0.0)), Waypoint((-17.0, 0.0, 0.0))], *scene)
    with pytest.raises(InputError, match="at most 20 m outside it"):
        space_around([Waypoint((-25.0, 0.0, 0.0))], *scene)


def room(panel_x_m):
    """A closed room of 4 x 4 x 2.5 m, and a small panel outside it."""
    x, y, z = np.diag([4.0, 4.0, 2.5])
    floor, left, front = quad((0, 0, 0), x, y), quad((0, 0, 0), y, z), quad((0, 0, 0), x, z)
    panel = quad((panel_x_m, 2, 1), (0, 0.1, 0), (0, 0, 0.1))
    return surface(floor, left, front, quad(z, x, y), quad(x, y, z), quad(y, x, z), panel)


@pytest.mark.parametrize("panel_x_m, belongs", [(4.4, True), (4.8, False)])
def test_a_niche_belongs_to_the_room_and_what_is_behind_the_window_does_not(panel_x_m, belongs):
    waypoints, space = chosen_waypoints(*room(panel_x_m), 3, PlanSettings())
    assert len(waypoints) == 3
    high_m = space.low_m + space.cell_m * (np.array(space.clearance_m.shape) - 1)
    assert (high_m[0] >= panel_x_m) == belongs
