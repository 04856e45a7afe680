"""Shadows, people and zones where the camera moves; the laws of the levels are in test_laws.py."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.benchmark.perturbations import lighting, people, ranging
from iclnuim.sensor.transfer import linear_from_srgb8


def light(segment, number=None):
    return linear_from_srgb8(segment.load(segment.numbers[0] if number is None else number)[0])


def test_shadows_stay_on_surfaces_when_they_do_not_move_and_darken_by_their_share(segment):
    """Two frames see the same shade at the same point of the world."""
    camera, first, second = segment.true_camera, segment.numbers[0], segment.numbers[2]
    flat = replace(
        segment, load=lambda n: (np.full((120, 160, 3), 200, np.uint8), segment.load(n)[1])
    )
    still = lighting.moving_shadows(flat, 80, 0.5, 0.0)
    T_first_second = segment.pose(segment.stamps_s[first]).inverse() @ segment.pose(
        segment.stamps_s[second]
    )
    points = (
        camera.unproject(segment.load(second)[1]) @ T_first_second.rotation.T
        + T_first_second.translation
    )
    places = camera.project(points)
    u, v = (np.clip(np.rint(places[..., k]), 0, n - 1).astype(int) for k, n in ((0, 160), (1, 120)))
    inside = (np.abs(places[..., 0] - u) <= 0.5) & (np.abs(places[..., 1] - v) <= 0.5)
    difference = np.abs(light(still, second) - light(still, first)[v, u]).max(-1)[inside]
    assert inside.mean() > 0.8 and np.median(difference) < 0.01
    shade = light(still, first)[..., 0] / light(flat, first)[0, 0, 0]
    assert shade.min() == pytest.approx(0.2, abs=0.01) and shade.max() == pytest.approx(1, abs=0.01)


def test_people_are_upright_cylinders_on_their_circle(segment):
    number, camera = segment.middle, segment.true_camera
    crowd = people.people(segment, 9, 1.0, 1.0)
    on = crowd.load(number)[1] < segment.load(number)[1]
    assert 0.1 < on.mean() < 0.9
    T_world_camera = segment.pose(segment.stamps_s[number])
    points = (
        camera.unproject(crowd.load(number)[1])[on] @ T_world_camera.rotation.T
        + T_world_camera.translation
    )
    centre = np.mean(
        [segment.pose(segment.stamps_s[n]).translation for n in segment.numbers], axis=0
    )
    ahead = T_world_camera.rotation[:2, 2]
    angles = np.arctan2(ahead[1], ahead[0]) + 2 * np.pi * np.arange(9) / 9
    axes = centre[:2] + np.stack([np.cos(angles), np.sin(angles)], -1)
    distance_m = np.linalg.norm(points[:, None, :2] - axes, axis=-1)
    assert np.abs(distance_m - 0.25).min(axis=1).max() < 1e-3


def test_zones_have_the_mean_of_the_pixels_that_have_depth(segment):
    h, w = segment.true_camera.height, segment.true_camera.width
    depth_z_m = np.ones((h, w), np.float32)
    depth_z_m[:20, :20] = 0
    depth_z_m[:10, 20:40], depth_z_m[20:30, :20] = 3, 0
    found = ranging.few_zones(
        replace(segment, load=lambda n: (np.zeros((h, w, 3), np.uint8), depth_z_m)), 20
    )
    zones = found.load(segment.numbers[0])[1]
    assert (
        (zones[:20, :20] == 0).all()
        and (zones[:20, 20:40] == 2).all()
        and (zones[20:40, :20] == 1).all()
    )
