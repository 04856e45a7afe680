"""Waypoints through a scene: how far from it they may lie, and how far the route may leave them."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.handheld_plan import PlanSettings, Waypoint
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast import scene_route
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.scene_route import shares_seen, space_around


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
    space = scene_route._space_of_building(*room(panel_x_m))
    high_m = space.low_m + space.cell_m * (np.array(space.clearance_m.shape) - 1)
    assert (high_m[0] >= panel_x_m) == belongs


def slab(low, high):
    """The six sides of an upright box."""
    u, v, w = np.diag(np.subtract(high, low))
    low = np.array(low)
    sides = quad(low, u, v), quad(low, v, w), quad(low, w, u)
    return *sides, quad(low + w, u, v), quad(low + u, v, w), quad(low + v, w, u)


FLOOR = slab((0, 0, -0.1), (4, 4, 0))
SIDES = {
    "back": slab((0, 4, 0), (4, 4.1, 2.6)),
    "left": slab((-0.1, 0, 0), (0, 4, 2.6)),
    "right": slab((4, 0, 0), (4.1, 4, 2.6)),
    "front": slab((0, -0.1, 0), (4, 0, 2.6)),
}
BED = slab((2.4, 2.6, 0), (3.9, 3.9, 0.4))
TABLE = slab((1.2, 1.2, 0), (2.8, 2.8, 0.75))
ROOMS = [
    ("back left right front", BED),
    ("back left right", BED),
    ("back left", BED),
    ("back left", TABLE),
    ("left right", TABLE),
    ("back", BED),
]


@pytest.mark.parametrize(("walls", "furniture"), ROOMS)
def test_every_frame_looks_into_the_room_from_a_person_s_height(walls, furniture):
    """However few walls: as a hand-held camera of kt0..kt3, and never over furniture or edges."""
    sides = [side for name in walls.split() for side in SIDES[name]]
    scene = surface(*FLOOR, *sides, *furniture)
    made, notes = scene_route.planned_in_rooms(*scene, 6, "room", PlanSettings())
    T_world_camera = made.motion.trajectory.T_world_camera
    shares = shares_seen(T_world_camera[::15], RayCaster(*scene))
    assert shares.min() >= 0.4 and shares.mean() >= 0.7
    assert len(notes) == 6 and all(note.startswith("viewpoint ") for note in notes)
    places = T_world_camera.translation
    below = np.broadcast_to([0, 0, -1.0], places.shape)
    heights = RayCaster(*scene).cast(places, below).distance
    assert heights.min() > 1.05 and heights.max() < 1.85
    pitches = np.degrees(np.arcsin(T_world_camera.rotation[:, 2, 2]))
    assert np.percentile(pitches, 5) < -18 and np.percentile(pitches, 95) > -6
    assert made.clearance_m >= 0.25


def test_people_see_over_things_that_are_lower_than_they_are():
    things = [thing for x in (2, 6) for y in (2, 6) for thing in slab((x, y, 0), (x + 1, y + 1, 1))]
    scene = surface(*slab((0, 0, -0.1), (9, 9, 0)), *things)
    made, notes = scene_route.planned_in_rooms(*scene, 6, "room", PlanSettings())
    assert len(notes) == 6
    assert made.motion.trajectory.positions_m[:, 2].min() > 1.1


def test_a_floor_without_surroundings_is_said_to_show_little():
    scene = surface(*slab((0, 0, -0.1), (1.2, 1.2, 0)))
    _, notes = scene_route.planned_in_rooms(*scene, 2, "room", PlanSettings())
    assert "% of the view on average" in notes[-1] and "another scene unit" in notes[-1]


@pytest.mark.parametrize(
    ("shares", "is_said"),
    [
        ([0.15, 1, 1], True),
        ([0.25, 1, 1], False),
        ([0.45, 0.45], True),
        ([0.6, 0.6], False),
    ],
)
def test_little_is_a_fifth_of_a_frame_or_half_of_all(monkeypatch, shares, is_said):
    monkeypatch.setattr(scene_route, "shares_seen", lambda poses, caster: np.array(shares))
    assert bool(scene_route._little_seen(SE3(np.eye(3)[None], np.zeros((1, 3))), None)) == is_said


def test_a_frame_of_each_half_second_is_checked(monkeypatch):
    checked = []

    def shares(poses, caster):
        checked.append(len(poses.translation))
        return np.ones(1)

    monkeypatch.setattr(scene_route, "shares_seen", shares)
    scene_route._little_seen(SE3(np.tile(np.eye(3), (60, 1, 1)), np.zeros((60, 3))), None)
    assert checked == [4]
