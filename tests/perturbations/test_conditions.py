"""Smoke, lamps, projectors, people and other sensors follow the laws that their docstrings state."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.benchmark.perturbations import lighting, people, ranging
from iclnuim.sensor.transfer import light_from_srgb8


def wall(segment, distance_m, value=128):
    """The segment with a grey wall parallel to the image."""
    h, w = segment.true_camera.height, segment.true_camera.width
    images = np.full((h, w, 3), value, np.uint8), np.full((h, w), distance_m, np.float32)
    return replace(segment, load=lambda number: images)


def light(segment, number=None):
    return light_from_srgb8(segment.load(segment.numbers[0] if number is None else number)[0])


def test_contrast_in_smoke_is_five_percent_at_the_visibility_and_its_square_halfway(segment):
    camera = segment.true_camera
    row, column = round(camera.cy), round(camera.cx)
    for distance_m, kept in ((2.0, 0.05), (1.0, np.sqrt(0.05))):
        bright, dark = (
            lighting.smoke(wall(segment, distance_m, value), 2.0, 0.5, 0.01) for value in (255, 0)
        )
        contrast = (light(bright) - light(dark))[row, column]
        assert contrast == pytest.approx(kept, abs=0.006)
        assert (bright.load(segment.numbers[0])[1][row, column] > 0) == (kept**2 >= 0.01)


def test_flicker_has_the_time_of_each_row(segment):
    number, height = segment.numbers[5], segment.true_camera.height
    ratio = light(lighting.flicker(wall(segment, 2.0), 50, 100, 20), number) / light(
        wall(segment, 2.0), number
    )
    for row in (0, 30, 77, 119):
        stamp_s = segment.stamps_s[number] + (row + 0.5) / height * 0.02
        assert ratio[row].mean() == pytest.approx(
            1 + 0.5 * np.sin(2 * np.pi * 100 * stamp_s), abs=0.01
        )


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


def test_dots_move_by_their_disparity_and_fade_with_the_squared_distance(segment):
    camera = segment.true_camera
    baseline_m = 8 / camera.fx  # 8 pixels at 1 m, 4 at 2 m
    gains = []
    for distance_m in (1.0, 2.0):
        plain = wall(segment, distance_m, 60)
        gains.append(
            (light(lighting.emitter_dots(plain, 4, baseline_m, 16)) / light(plain))[..., 0] - 1
        )
    near, far = gains
    moved = far[:, 4:] * 4
    assert near.max() > 1 and np.abs(near[:, :-4] - moved).max() < 0.1 * near.max()


def test_dirt_covers_its_share_of_colour_at_the_same_pixels_of_every_frame(segment):
    dirty = lighting.lens_dirt(segment, 30, 24, 0.0)
    bright = lighting.lens_dirt(wall(segment, 2.0, 255), 30, 24, 0.0)
    cover = 1 - light(bright)[..., 0]
    assert (cover > 0.5).mean() == pytest.approx(0.3, abs=0.01)
    for number in segment.numbers[:3]:
        colour, depth_z_m = dirty.load(number)
        assert colour[cover > 0.999].max() <= 1 and np.array_equal(
            depth_z_m, segment.load(number)[1]
        )


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


def test_half_of_the_disturbed_windows_are_missing_and_half_have_wrong_disparity(segment):
    plain = wall(segment, 1.0)
    depth_z_m = ranging.interference(plain, 40, 5, 2, 0.075).load(segment.numbers[0])[1]
    assert (depth_z_m == 0).mean() == pytest.approx(0.2, abs=0.03)
    wrong = (depth_z_m > 0) & (np.abs(depth_z_m - 1) > 1e-6)
    assert wrong.mean() == pytest.approx(0.2, abs=0.03)
    scale = segment.true_camera.fx * 0.075
    assert np.abs(scale / depth_z_m[wrong] - scale).max() <= 2 + 1e-3


def test_a_wrapped_distance_is_the_distance_modulo_half_a_wavelength(segment):
    number, slant = segment.numbers[0], np.linalg.norm(segment.true_camera.rays(), axis=-1)
    true_m, measured_m = (
        s.load(number)[1] * slant for s in (segment, ranging.wrapped_phase(segment, 100))
    )
    turns = (true_m - measured_m) / 1.49896229
    assert (
        np.abs(turns - np.rint(turns)).max() < 1e-5
        and measured_m.max() < 1.499
        and turns.max() > 0.5
    )


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
