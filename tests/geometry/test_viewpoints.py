"""Viewpoints that are chosen: at eye height above the floor, in one connected part of the scene, or
refused with advice.
"""

from itertools import pairwise

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.handheld_plan import FreeSpace

pytest.importorskip("embreex")
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.distance import TriangleDistance
from iclnuim.raycast.viewpoints import viewpoints  # noqa: E402

#: Corner of a unit cube -> its six faces, normals outside; a room shows its inner sides.
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def box(low, high, inside=False, leave_out=()):
    faces = [face[::-1] if inside else face for k, face in enumerate(FACES) if k not in leave_out]
    corners = CORNERS * np.subtract(high, low) + low
    return np.array([corners[list(t)] for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def space_and_caster(*parts):
    triangles = np.concatenate(parts)
    corners = triangles.reshape(-1, 3)
    rows = np.arange(len(corners)).reshape(-1, 3)
    distance = TriangleDistance(corners, rows).distance
    return FreeSpace.between(corners.min(0), corners.max(0) + [0, 0, 0.5], distance), RayCaster(
        corners, rows
    )


TABLE = box((1, 1, 0.7), (3.4, 2.2, 0.75))
CUPBOARD = box((0, 3.0, 0), (3.0, 4, 0.95))


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("leave_out", [(), (5,), (5, 1, 3)])
def test_places_are_at_eye_height_above_the_floor_ceiling_or_not(leave_out, inside):
    room = box((0, 0, 0), (6, 4, 2.6), inside, leave_out)
    space, caster = space_and_caster(room, TABLE, CUPBOARD)
    heights = [w.position_m[2] for w in viewpoints(space, caster, 6, 0.25, 0)]
    assert min(heights) >= 1.2 - 1e-3 and max(heights) <= 1.7 + 1e-3


def test_places_lie_in_one_room_where_no_way_leads_to_the_other():
    rooms = box((0, 0, 0), (4, 4, 2.6), True), box((4.2, 0, 0), (9, 4, 2.6), True)
    space, caster = space_and_caster(*rooms)
    places = np.array([w.position_m for w in viewpoints(space, caster, 6, 0.25, 0)])
    assert (places[:, 0] > 4.2).all()  # the larger one
    for a, b in pairwise(places):
        space.route(a, b, 0.25)


def test_a_room_too_low_to_stand_in_is_refused_with_what_helps():
    space, caster = space_and_caster(box((0, 0, 0), (4, 3, 1.2), True))
    with pytest.raises(
        InputError,
        match=r"1.2 to 1.7 m above it.*found 0 in a scene .* high; try .*clearance_m.*unit_m",
    ):
        viewpoints(space, caster, 4, 0.25, 0)


def test_no_route_is_found_out_without_a_search():
    rooms = box((0, 0, 0), (20, 20, 2.6), True), box((20.2, 0, 0), (40, 20, 2.6), True)
    space, _ = space_and_caster(*rooms)
    with pytest.raises(InputError, match="a route between them"):
        space.route(np.array([1.0, 1, 1.4]), np.array([39.0, 19, 1.4]), 0.25)


@pytest.mark.parametrize(("step_m", "is_connected"), [(0.15, True), (0.45, False)])
def test_people_step_up_to_a_platform_but_not_onto_a_table(step_m, is_connected):
    """A platform over two fifths of the room: places above it are used if a step leads there."""
    room, platform = box((0, 0, 0), (6, 4, 2.6), True), box((3.6, 0, 0), (6, 4, step_m))
    space, caster = space_and_caster(room, platform)
    places = np.array([w.position_m for w in viewpoints(space, caster, 12, 0.25, 0)])
    assert (places[:, 0] > 3.6).any() == is_connected


def test_a_terrace_before_an_open_room_is_no_room():
    """There at most 3 of 5 level rays hit something of those that do in the room."""
    room = box((0, 0, 0), (6, 4, 2.6), True, leave_out=(5,))
    open_side = room[(room[..., 1] != 4).any(1)]
    terrace = box((0, 4, -0.1), (6, 9, 0), leave_out=())
    space, caster = space_and_caster(open_side, terrace)
    places = np.array([w.position_m for w in viewpoints(space, caster, 12, 0.25, 0)])
    assert places[:, 1].max() < 4.2
