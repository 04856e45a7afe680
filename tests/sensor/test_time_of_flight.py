"""`azure_kinect`: what is printed of the device comes out, and light adds as phasors."""

import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.multipath import longer_way_m
from iclnuim.sensor.time_of_flight import AzureKinectDepthNoise

#: A narrow view: one distance, one angle.
NARROW = PinholeCamera(160, 120, 8000.0, 8000.0, 79.5, 59.5)
WIDE = PinholeCamera.parse("320x240")
QUIET = {"base_m": 0, "noise_m": 0, "wiggle_m": 0, "dark_bias_m": 0, "amplitude_noise": 0}
EXACT = {**QUIET, "depth_step_m": 1e-6, "multipath": 0}
RADIANS_PER_M = 4 * np.pi * 2e8 / 299792458


def wall(depth_m, camera=NARROW):
    return np.full((camera.height, camera.width), depth_m, np.float32)


def seen(depth_z_m, albedo=0.95, camera=NARROW, seed=0, **settings):
    noisy = noisy_depth(depth_z_m, "azure_kinect", camera, seed, settings=settings, albedo=albedo)
    return noisy.astype(float)


@pytest.mark.parametrize(("depth_m", "printed_mm"), [(1.0, 1.0), (3.0, 3.6)])
def test_sigma_is_what_is_quoted_of_tolgyessy_and_others(depth_m, printed_mm):
    error_mm = 1000 * (seen(wall(depth_m)) - depth_m)
    assert error_mm.std() == pytest.approx(printed_mm, rel=0.15)


@pytest.mark.parametrize("albedo", [0.15, 0.5, 0.95])
@pytest.mark.parametrize("depth_m", [0.55, 1.0, 2.0, 3.2])
def test_over_the_operating_range_the_errors_stay_within_the_printed_ones(depth_m, albedo):
    """Microsoft: sigma of at most 17 mm, systematic error below 11 mm + 0.1 % of the distance."""
    noisy = seen(wall(depth_m), albedo)
    assert (noisy > 0).mean() > 0.99
    error_m = noisy[noisy > 0] - depth_m
    assert 0.0005 <= error_m.std() <= 0.017
    assert abs(error_m.mean()) < 0.011 + 0.001 * depth_m


@pytest.mark.parametrize(("albedo", "angle_deg"), [(0.15, 0), (0.6, 0), (0.6, 60), (0.95, 75)])
def test_surfaces_are_seen_to_the_distance_at_which_15_percent_ends_at_3_86_m(
    plane, albedo, angle_deg
):
    reach_m = 3.86 * np.sqrt(albedo * np.cos(np.radians(angle_deg)) / 0.15)
    for share, is_measured in ((0.95, True), (1.05, False)):
        noisy = seen(plane(NARROW, angle_deg, share * reach_m), albedo, **EXACT)
        assert (noisy[:, 60:100] > 0).all() == is_measured
        assert (noisy[:, 60:100] > 0).any() == is_measured


def test_the_edge_of_the_range_is_ragged_by_the_noise_of_the_amplitude():
    share = (seen(wall(3.86), 0.15) > 0).mean()
    assert 0.4 < share < 0.6
    assert (seen(wall(0.499)) == 0).all() and (seen(wall(0.501)) > 0).all()


@pytest.mark.parametrize(("albedo", "angle_deg"), [(0.25, 0), (0.95, 60)])
def test_variance_grows_as_the_reflected_light_falls(plane, albedo, angle_deg):
    """Shot noise: half of the light has the square root of twice the noise."""
    quiet = {"base_m": 0, "wiggle_m": 0, "multipath": 0, "depth_step_m": 1e-6}
    depth = plane(NARROW, angle_deg, 2.0)
    error_m = seen(depth, albedo, **quiet) - depth
    white_m = seen(wall(2.0), 0.95, **quiet) - 2.0
    reflected = albedo * np.cos(np.radians(angle_deg)) / 0.95
    assert error_m.std() == pytest.approx(white_m.std() / np.sqrt(reflected), rel=0.05)


def test_the_bias_repeats_four_times_in_a_period_and_grows_on_dark_surfaces():
    model = AzureKinectDepthNoise()
    ranges_m = np.linspace(1, 3, 4001, dtype=np.float32)[None]
    white = model.bias_m(ranges_m, np.float32(1))
    assert np.abs(white).max() == pytest.approx(0.002, rel=0.01)
    crossings = (np.diff(np.signbit(white[0])) != 0).sum()
    assert crossings == pytest.approx(2 * 4 * 2 / (299792458 / 2 / 2e8), abs=1)
    assert model.bias_m(ranges_m, np.float32(0)) - white == pytest.approx(0.002)


def step(near_m, far_m):
    depth = wall(far_m)
    depth[:, 80:] = near_m
    return depth


def test_pixels_at_an_edge_fly_between_the_two_surfaces():
    noisy = seen(step(1.0, 1.15), **EXACT)[60]
    assert np.allclose(noisy[:79], 1.15, atol=1e-4) and np.allclose(noisy[81:], 1.0, atol=1e-4)
    flying = noisy[79:81]
    assert ((flying > 1.002) & (flying < 1.148)).all() and flying[0] > flying[1]
    # two phasors: 1 part of the other surface's light, 3 of its own
    own, other = 3 / 1.15**2, 1 / 1.0**2
    expected = 1.15 + np.angle(own + other * np.exp(-0.15j * RADIANS_PER_M)) / RADIANS_PER_M
    assert flying[0] == pytest.approx(expected, abs=1e-4)


def test_surfaces_half_a_period_apart_cancel_and_leave_a_hole():
    apart_m = np.pi / RADIANS_PER_M
    noisy = seen(step(1.5, 1.5 + apart_m), **EXACT)[60]
    assert noisy[79] == 0 and (noisy[:79] > 0).all() and (noisy[81:] > 0).all()


def test_planes_have_no_edges_and_no_light_from_themselves(plane):
    depth = plane(WIDE, 60, 2.0)
    for settings in (EXACT, {**EXACT, "multipath": 1}):
        noisy = seen(depth, camera=WIDE, **settings)
        assert np.abs(noisy / depth - 1)[noisy > 0].max() < 1e-4


def test_distances_wrap():
    noisy = seen(wall(4.0), **EXACT, unambiguous_m=3.0)
    assert np.allclose(noisy, 1.0, atol=1e-3)


def corner(apex_m):
    """Two walls that meet at a right angle in a vertical line straight ahead."""
    return (apex_m / (1 + np.abs(WIDE.rays()[..., 0]))).astype(np.float32)


def one_bounce(point_m, normal, others_m, other_normals, areas_m2, albedo):
    """Error of a point by direct summation over small patches, in double precision."""

    def irradiance(p, n):
        r = np.linalg.norm(p, axis=-1)
        return np.abs((p * n).sum(-1)) / r**3

    way = others_m - point_m
    d = np.linalg.norm(way, axis=-1)
    cos_here = np.maximum((way * normal).sum(-1) / d, 0)
    cos_there = np.maximum(-(way * other_normals).sum(-1) / d, 0)
    light = albedo * irradiance(others_m, other_normals) * areas_m2
    light = light * cos_here * cos_there / (np.pi * d**2)
    ratio = light / irradiance(point_m, normal)
    r_other = np.linalg.norm(others_m, axis=-1)
    longer = (r_other + d - np.linalg.norm(point_m)) / 2
    return np.angle(1 + (ratio * np.exp(1j * RADIANS_PER_M * longer)).sum()) / RADIANS_PER_M


@pytest.mark.parametrize("apex_m", [1.0, 2.0])
def test_the_longer_way_in_a_corner_is_that_of_a_direct_summation(apex_m):
    depth = corner(apex_m)
    error = longer_way_m(depth, WIDE, np.full(depth.shape, 0.8, np.float32), RADIANS_PER_M, 1.0)
    rays = WIDE.rays()
    points = depth[..., None] * rays
    inward = np.sqrt(0.5)
    left, right = np.array([inward, 0, -inward]), np.array([-inward, 0, -inward])
    on_left = np.s_[:, :160]
    cosine = np.abs(rays[on_left] @ left) / np.linalg.norm(rays[on_left], axis=-1)
    size = depth[on_left] ** 2 / (WIDE.fx * WIDE.fy)
    areas = size / (np.linalg.norm(rays[on_left], axis=-1) * cosine)
    for column in (185, 200, 240, 280):
        expected = one_bounce(points[120, column], right, points[on_left], left, areas, 0.8)
        assert error[120, column] == pytest.approx(expected, abs=max(0.15 * abs(expected), 0.0015))


def test_corners_are_too_far_and_more_so_with_bright_walls():
    depth = corner(1.5)
    near_it = np.s_[100:140, 168:190]
    errors = [
        (seen(depth, albedo, WIDE, **{**EXACT, "multipath": 1}) - depth)[near_it]
        for albedo in (0.3, 0.8)
    ]
    assert (errors[0] > 0).all() and (errors[1] > 1.5 * errors[0]).all()
    assert 0.01 < errors[1].max() < 0.05


def test_without_colour_it_says_what_it_lacks():
    with pytest.raises(InputError, match="colour or albedo for the depth noise azure_kinect"):
        noisy_depth(wall(1.0), "azure_kinect", NARROW)
