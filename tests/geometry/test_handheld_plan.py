"""Hand-held trajectories through free space: round obstacles, through doors, never nearer than
asked; distances here follow from formulas.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry import handheld
from iclnuim.geometry.handheld_plan import FreeSpace, PlanSettings, Waypoint, plan

LOW, HIGH = np.array([0.0, 0.0, 0.0]), np.array([6.0, 4.0, 2.5])


def box_distance(points, low, high):
    """To the surface of a box from outside, 0 inside."""
    return np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0.0), axis=1)


def clearance(points, door=True):
    """In a room of 6 x 4 x 2.5 m with a wall across at x = 3 that has a door of 1 m at y = 3..4, or
    none.
    """
    walls = np.minimum(points - LOW, HIGH - points).min(1)
    end = 3.0 if door else 4.0
    return np.minimum(
        walls, box_distance(points, np.array([2.95, 0, 0]), np.array([3.05, end, 2.5]))
    )


def planned(waypoints, measure=clearance, **settings):
    space = FreeSpace.between(LOW - 0.5, HIGH + 0.5, measure)
    return plan([Waypoint(*w) for w in waypoints], space, "test", PlanSettings(**settings))


ENDS = [((1.0, 1.0, 1.3), (3.0, 1.0, 1.2)), ((5.0, 1.0, 1.3),)]


@pytest.fixture(scope="module")
def through_the_door():
    return planned(ENDS)


@pytest.mark.parametrize("seed", [0, 7])
def test_the_route_leads_through_the_door_and_keeps_clear(through_the_door, seed):
    made = planned(ENDS, seed=seed) if seed else through_the_door
    positions = made.motion.trajectory.positions_m
    assert clearance(positions).min() == pytest.approx(made.clearance_m)
    assert made.clearance_m >= 0.25
    crossing = positions[np.abs(positions[:, 0] - 3.0) < 0.1]
    assert (crossing[:, 1] > 3.25).all() and len(crossing)
    assert positions[0] == pytest.approx([1, 1, 1.3], abs=0.04)
    assert positions[-1] == pytest.approx([5, 1, 1.3], abs=0.04)


def test_the_camera_looks_where_it_was_told():
    made = planned(
        [((1.0, 1.0, 1.3), (1.0, 3.0, 1.3)), ((2.0, 2.0, 1.3), (0.0, 2.0, 1.3))], shake=0.0
    )
    gaze = made.motion.trajectory.T_world_camera.rotation[:, :, 2]
    assert gaze[0] == pytest.approx([0, 1, 0], abs=1e-3)
    assert gaze[-1] == pytest.approx([-1, 0, 0], abs=1e-3)


def test_the_recipe_makes_the_same_path_again(through_the_door):
    made = through_the_door
    again = handheld.make(made.recipe)
    assert (again.trajectory.positions_m == made.motion.trajectory.positions_m).all()
    assert made.motion.scale == pytest.approx(1.0, abs=2e-6)
    assert again.trajectory.length_m() == pytest.approx(made.recipe.length_m, abs=1e-4)


def test_the_pace_is_about_the_one_asked_for(through_the_door):
    made = through_the_door
    speed = made.motion.trajectory.length_m() / made.motion.trajectory.stamps_s[-1]
    assert 0.2 < speed < 0.36


def test_a_wall_without_a_door_is_no_route():
    with pytest.raises(InputError, match="a route between them"):
        planned(ENDS, measure=lambda points: clearance(points, door=False))


def test_a_door_too_narrow_for_the_clearance_is_no_route():
    with pytest.raises(InputError, match="a route between them"):
        planned(ENDS, clearance_m=0.55)


def test_a_viewpoint_at_a_wall_is_named():
    with pytest.raises(InputError, match="viewpoint 1 .*0.10 m away"):
        planned([((1.0, 1.0, 1.3),), ((2.85, 1.0, 1.3),)])


def test_one_viewpoint_is_no_trajectory():
    with pytest.raises(InputError, match="two viewpoints"):
        planned(ENDS[:1])


def test_a_straight_route_stays_straight():
    space = FreeSpace.between(LOW, HIGH, clearance)
    assert len(space.route(np.array([1.0, 1, 1]), np.array([2.0, 3, 1]), 0.3)) == 2


@pytest.mark.parametrize(("first_deg", "last_deg"), [(60, 100), (160, 210), (-20, -100)])
def test_the_camera_turns_the_short_way_from_one_gaze_to_the_next(first_deg, last_deg):
    """Along a straight route in an open hall, also across the angle where numbers begin again."""

    def waypoint(x, deg):
        yaw = np.radians(deg)
        return ((x, 2.0, 1.3), (x + np.cos(yaw), 2.0 + np.sin(yaw), 1.3))

    made = planned(
        [waypoint(1.0, first_deg), waypoint(5.0, last_deg)],
        measure=lambda points: np.minimum(points - LOW, HIGH - points).min(1),
        shake=0.0,
    )
    gaze = made.motion.trajectory.T_world_camera.rotation[:, :, 2]
    middle = np.radians((first_deg + last_deg) / 2)
    beside = gaze[:, :2] @ [np.cos(middle), np.sin(middle)] / np.linalg.norm(gaze[:, :2], axis=1)
    half_way = np.degrees(np.arccos(beside.clip(-1, 1)))
    assert half_way.max() < abs(last_deg - first_deg) / 2 + 5
    assert half_way[len(half_way) // 2] < 5


def test_a_route_of_which_no_part_can_be_left_out_has_all_its_cells():
    class Winding(FreeSpace):
        def _is_clear(self, *_):
            return False

    space = Winding(np.zeros(3), 1.0, np.ones((6, 1, 1)), clearance)
    corners = space.route(np.array([0.1, 0, 0]), np.array([4.9, 0, 0]), 0.5)
    assert corners[:, 0].tolist() == [0.1, 0, 1, 2, 3, 4, 5, 4.9]
