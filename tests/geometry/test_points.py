"""Upright boxes: they hold every point, none is smaller, and turning the points turns the box.
Farthest-point sampling.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.points import farthest_points, upright_box


def about_z(yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.mark.parametrize("seed", range(8))
def test_a_box_holds_its_points_and_no_turned_rectangle_has_less_area(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(0.1, 3, 3) @ about_z(rng.uniform(0, 3)).T
    box = upright_box(points)
    own = box.T_world_box.inverse().apply(points)
    assert np.all(np.abs(own) <= box.size_m / 2 + 1e-9)
    assert box.size_m[0] >= box.size_m[1]
    areas = [
        np.prod(np.ptp((points @ about_z(yaw))[:, :2], axis=0))
        for yaw in np.radians(np.arange(0, 90, 0.25))
    ]
    assert box.size_m[0] * box.size_m[1] <= min(areas) * (1 + 1e-3)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2, -2.5, np.pi / 2])
def test_the_box_of_a_turned_cuboid_is_that_cuboid(yaw):
    corners = (np.array(list(np.ndindex(2, 2, 2))) - 0.5) * [1.6, 0.8, 0.72]
    moved = corners @ about_z(yaw).T + [3.0, -2.0, 1.0]
    box = upright_box(moved)
    assert box.size_m == pytest.approx([1.6, 0.8, 0.72])
    assert box.T_world_box.translation == pytest.approx([3.0, -2.0, 1.0])
    assert abs(box.T_world_box.rotation[:, 0] @ about_z(yaw)[:, 0]) == pytest.approx(1.0)
    assert np.linalg.det(box.T_world_box.rotation) == pytest.approx(1.0)
    distance = np.linalg.norm(box.corners()[:, None] - moved, axis=-1).min(1)
    assert distance.max() < 1e-9


def test_a_flat_sheet_a_line_and_a_point_have_boxes_and_nothing_has_none():
    assert upright_box([[0, 0, 1], [2, 0, 1], [2, 3, 1], [0, 3, 1]]).size_m == pytest.approx(
        [3, 2, 0]
    )
    assert upright_box([[0, 0, 0], [1, 1, 2]]).size_m == pytest.approx([np.sqrt(2), 0, 2], abs=1e-8)
    assert upright_box([[5, 6, 7]]).size_m == pytest.approx([0, 0, 0], abs=1e-12)
    with pytest.raises(InputError, match="at least one point"):
        upright_box(np.zeros((0, 3)))


def test_each_chosen_point_is_the_farthest_from_those_before():
    """Wherever the origin is."""
    points = np.random.default_rng(6).normal(size=(60, 3)) + (5, -3, 1)
    chosen = farthest_points(points, 12, first=4)
    assert np.array_equal(chosen[0], points[4])
    for n in range(1, 12):
        apart = np.linalg.norm(points[:, None] - chosen[:n], axis=2).min(axis=1)
        assert np.array_equal(chosen[n], points[apart.argmax()])
    assert len(farthest_points(points, 100)) == 60
