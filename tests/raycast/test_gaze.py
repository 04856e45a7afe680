"""Where a camera looks on its way: what it sees there, how it is tilted, and how it turns."""

from types import SimpleNamespace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("embreex", reason="casts rays")
from iclnuim.raycast.caster import RayCaster  # noqa: E402
from iclnuim.raycast.scene_route import directions, shares_seen


def hall(half_m):
    """A caster in a closed hall of 2 half_m x 2 half_m x 2.8 m about the origin, at eye height."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half_m
    corners[:, 2] = np.tile([-1.4, 1.4], 4)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    sides = np.array(faces)
    return RayCaster(corners, np.concatenate([sides[:, :3], sides[:, [0, 2, 3]]]))


def around_the_hall():
    """Points of a round trip at a radius of 4 m, and the six stops on it."""
    turn = np.linspace(0, 2 * np.pi, 31)
    return 4 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1), np.arange(0, 31, 6)


@pytest.mark.parametrize(("wall_m", "share"), [(6.0, 1.0), (12.0, 0.0)])
def test_surfaces_within_eight_metres_are_seen(wall_m, share):
    plane = np.array([[-99, -99, wall_m], [99, -99, wall_m], [0, 99, wall_m]])
    pose = SE3(np.eye(3)[None], np.zeros((1, 3)))
    assert shares_seen(pose, RayCaster(plane, np.array([[0, 1, 2]]))).tolist() == [share]


def test_pitch_and_range_are_those_of_our_trajectories():
    """In kt0..kt3 90 % of the pitches are -24 to -1 degrees, and of the ranges 1.7 to 4.0 m."""
    points, stops = around_the_hall()
    caster = hall(6.0)
    found = np.concatenate([directions(points, stops, caster, seed) for seed in range(4)])
    pitches = np.degrees(np.arcsin(found[:, 2]))
    assert np.percentile(pitches, [5, 50, 95]) == pytest.approx([-24, -12, -1], abs=4)
    ahead_m = caster.cast(np.tile(points, (4, 1)), found).distance
    assert 3.0 < np.median(ahead_m) < 4.2


def test_the_seed_decides_and_nothing_else():
    points, stops = around_the_hall()
    first = directions(points, stops, hall(6.0), 1)
    assert (directions(points, stops, hall(6.0), 1) == first).all()
    assert (directions(points, stops, hall(6.0), 2) != first).any()


class OneSided:
    """Surfaces 3 m away: from x = 0 within 60 degrees of +x alone, from x = 9 of -x, between them
    all around. It counts the rays.
    """

    rays = 0

    def cast(self, origin, rays):
        self.rays += rays[..., 0].size
        side = {0.0: 1, 9.0: -1}.get(float(origin[0]), 0)
        is_met = side * rays[..., 0] >= abs(side) / 2
        return SimpleNamespace(distance=np.where(is_met, 3.0, np.inf))


@pytest.mark.parametrize(("steps", "turned"), [(2, True), (1, False)])
def test_the_camera_turns_by_an_eighth_from_point_to_point(steps, turned):
    """Two steps are a quarter turn, from which either side can be seen; one is half of it."""
    points = np.zeros((steps + 1, 3))
    points[:, 0] = np.linspace(0, 9, steps + 1)
    found = directions(points, np.array([0, steps]), OneSided(), 0)
    turns = np.degrees(np.arccos(np.sum(found[1:] * found[:-1], 1).clip(-1, 1)))
    assert turns.max() < 47
    assert (found[0, 0] - found[-1, 0] > 1.1) == turned


def test_a_point_takes_ten_thousand_rays_or_two():
    """A few milliseconds, so that a hundred points take less than a second."""
    caster = OneSided()
    directions(np.zeros((1, 3)), np.array([0]), caster, 0)
    assert 10_000 < caster.rays < 20_000
