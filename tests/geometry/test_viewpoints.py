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
    heights = viewpoints(space, caster, 6, 0.25, 0)[0][:, 2]
    assert min(heights) >= 1.2 - 1e-3 and max(heights) <= 1.7 + 1e-3


def test_places_lie_in_one_room_where_no_way_leads_to_the_other():
    rooms = box((0, 0, 0), (4, 4, 2.6), True), box((4.2, 0, 0), (9, 4, 2.6), True)
    space, caster = space_and_caster(*rooms)
    places = viewpoints(space, caster, 6, 0.25, 0)[0]
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
    places = viewpoints(space, caster, 12, 0.25, 0)[0]
    assert (places[:, 0] > 3.6).any() == is_connected


def test_a_terrace_before_an_open_room_is_no_room():
    """There at most 3 of 5 level rays hit something of those that do in the room."""
    room = box((0, 0, 0), (6, 4, 2.6), True, leave_out=(5,))
    open_side = room[(room[..., 1] != 4).any(1)]
    terrace = box((0, 4, -0.1), (6, 9, 0), leave_out=())
    space, caster = space_and_caster(open_side, terrace)
    places = viewpoints(space, caster, 12, 0.25, 0)[0]
    assert places[:, 1].max() < 4.2


def test_the_space_of_a_person_ends_at_the_edges_of_the_floor_and_its_furniture():
    """Spline and shake may lean a cell of 0.1 m over them, and the margins of a route not."""
    floor, bed = box((0, 0, -0.1), (6, 4, 0)), box((2, 0, 0), (4, 2, 0.4))
    wall = box((0, 4, 0), (6, 4.1, 2.6))
    _, held = viewpoints(*space_and_caster(floor, bed, wall), 6, 0.25, 0)
    sideways = np.array([1.3, 1.5, 1.74, 1.87, 2.1, 2.3])
    over_the_edge = np.column_stack([sideways, np.ones(6), np.full(6, 1.45)])
    clear = held.measure(over_the_edge)
    assert (clear[:3] >= 0.25 + 0.15).all() and 0.25 < clear[3] < 0.25 + 0.15
    assert clear[4] in (0.0, 0.25) and clear[5] == 0
    heights = np.column_stack([np.ones(4), np.ones(4), [0.9, 1.25, 1.65, 2.0]])
    assert (held.measure(heights) >= 0.25).tolist() == [False, True, True, False]
    assert held.measure(np.array([[1.0, 9.0, 1.4], [-99.0, 1.0, 1.4]])).tolist() == [0, 0]


def test_rows_of_seats_are_passed_along_the_steps_beside_them():
    """The steps are below every point of the routes, or the edge of a seat, by a cell at most."""
    room = box((0, -1, 0), (7, 5, 4), True)
    steps = [box((0, k, 0), (7, k + 1, 0.15 * (k + 1))) for k in range(5)]

    def seats(edge_m):
        low, high = (1.5 + edge_m, 0.4 + edge_m, 0), (6.9 - edge_m, 0.8 - edge_m, 0.6)
        return [box(np.add(low, (0, k, 0)), np.add(high, (0, k, 0.15 * k))) for k in range(5)]

    space, caster = space_and_caster(room, *steps, *seats(0.0))
    places, held = viewpoints(space, caster, 8, 0.25, 0)
    assert np.ptp(places[:, 2]) > 0.6
    _, narrower = space_and_caster(room, *steps, *seats(space.cell_m))
    for a, b in pairwise(places):
        shares = np.linspace(0, 1, 20)[:, None]
        for corner, following in pairwise(held.route(a, b, 0.25)):
            points = corner + shares * (following - corner)
            down = np.broadcast_to([0, 0, -1.0], points.shape)
            below = narrower.cast(points, down).distance
            assert below.min() > 1.0 and below.max() < 1.9
