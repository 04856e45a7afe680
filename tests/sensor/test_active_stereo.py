"""`d435`: what is printed of the device comes out, and the geometry of two imagers holds."""

import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.windows import correlated, largest
from scipy import ndimage

DEVICE = PinholeCamera(424, 240, 424.0, 424.0, 211.5, 119.5)
F_B = 424 * 0.05
QUIET = {"subpixel_px": 0, "step_px": 1e-5, "depth_step_m": 1e-5}
PLAIN = {**QUIET, "fat_px": 0, "ragged_px": 0}


def wall(depth_m, camera=DEVICE):
    return np.full((camera.height, camera.width), depth_m, np.float32)


def seen(depth_z_m, albedo=0.8, camera=DEVICE, seed=0, rgb=None, **settings):
    noisy = noisy_depth(depth_z_m, "d435", camera, seed, settings=settings, rgb=rgb, albedo=albedo)
    return noisy.astype(float)


def sigma(depth_m, camera=DEVICE, **settings):
    """Of three frames of a wall: one frame has few independent windows."""
    errors = []
    for seed in range(3):
        noisy = seen(wall(depth_m, camera), camera=camera, seed=seed, **settings)
        errors.append(noisy[noisy > 0] - depth_m)
    return np.concatenate(errors).std()


@pytest.mark.parametrize(
    ("depth_m", "printed_mm"), [(0.5, 0.94), (1.0, 3.77), (2.0, 15.1), (4.0, 60.4)]
)
def test_sigma_is_that_of_intels_formula_at_848_pixels_and_90_degrees(depth_m, printed_mm):
    """Tuning paper: RMS error = Z^2 x 0.08 px / (424 px x 50 mm)."""
    assert sigma(depth_m) * 1000 == pytest.approx(printed_mm, rel=0.15)


def test_sigma_stays_below_what_others_print_as_the_worst():
    # Ahn and others 2019, as quoted by Castagno and Atkins 2020: as much as 4 cm at 2 m
    assert sigma(2.0) < 0.04
    # data sheet: RMS error of at most 2 % of the distance up to 2 m
    assert all(sigma(depth_m) < 0.02 * depth_m for depth_m in (0.5, 1.0, 2.0))
    # arXiv 2501.07421, abstract: below 1 cm up to 1 m
    assert sigma(1.0) < 0.01


def test_the_error_grows_with_the_square_of_depth_and_is_the_devices_on_any_image():
    depths = np.array([1.0, 2.0, 4.0])
    other = PinholeCamera(424, 240, 300.0, 300.0, 211.5, 119.5)
    for camera in (DEVICE, other):
        slope = np.polyfit(np.log(depths), np.log([sigma(z, camera) for z in depths]), 1)[0]
        assert slope == pytest.approx(2, abs=0.1)
    assert sigma(2.0, other) == pytest.approx(sigma(2.0), rel=0.1)


def test_disparity_has_no_bias():
    noisy = np.concatenate([seen(wall(2.0), seed=k)[:, 60:].ravel() for k in range(4)])
    windows = noisy.size / 81
    assert abs((F_B / noisy - F_B / 2).mean()) < 4 * 0.08 / np.sqrt(windows)


@pytest.mark.parametrize("focal_px", [424.0, 848.0])
def test_errors_are_correlated_as_far_as_matching_windows_overlap(focal_px):
    camera = PinholeCamera(424, 240, focal_px, focal_px, 211.5, 119.5)
    side = 9 * focal_px / 424
    noisy = np.stack([seen(wall(1.0, camera), camera=camera, seed=k) for k in range(4)])
    error = 1 / noisy[:, :, 80:] - 1
    for lag in (2, 4, 8):
        measured = (error[..., lag:] * error[..., :-lag]).mean() / (error**2).mean()
        assert measured == pytest.approx(1 - lag / side, abs=0.08)
    apart = int(side) + 1
    assert abs((error[..., apart:] * error[..., :-apart]).mean() / (error**2).mean()) < 0.08


def test_nearer_than_126_disparities_and_beyond_10_m_nothing_is_measured():
    nearest = F_B / 126
    for depth_m, is_measured in (
        (0.99 * nearest, False),
        (1.01 * nearest, True),
        (9.99, True),
        (10.01, False),
    ):
        noisy = seen(wall(depth_m), albedo=1.0, **QUIET, pattern_range_m=100)
        assert (noisy[:, 130:] > 0).all() == is_measured
        assert (noisy > 0).any() == is_measured


@pytest.mark.parametrize("depth_m", [0.4, 1.0, 3.0])
def test_the_band_at_the_left_edge_is_as_wide_as_the_disparity(depth_m):
    """Data sheet, invalid depth band: B F / Z."""
    missing = (seen(wall(depth_m), **QUIET) == 0).sum(1)
    assert np.abs(missing - F_B / depth_m).max() <= 1


def box(near_m, far_m):
    """A near square in front of a wall; its columns are 200..259."""
    depth = wall(far_m)
    depth[80:160, 200:260] = near_m
    return depth


@pytest.mark.parametrize(("near_m", "far_m"), [(0.5, 2.0), (1.0, 3.0), (1.0, 1.2)])
def test_a_near_object_has_a_shadow_on_its_left_side_only(near_m, far_m):
    noisy = seen(box(near_m, far_m), **PLAIN)[120]
    shadow = np.flatnonzero(noisy[70:] == 0) + 70
    width = F_B * (1 / near_m - 1 / far_m)
    assert len(shadow) == pytest.approx(width, abs=1.5)
    assert shadow.max() == 199 and (noisy[260:] > 0).all()


def test_a_narrow_object_hides_only_what_is_behind_it():
    depth = wall(2.0)
    depth[:, 200:204] = 0.5
    missing = np.flatnonzero(seen(depth, **PLAIN)[120, 70:] == 0) + 70
    shift = round(F_B / 0.5 - F_B / 2)
    inner, outer = (set(range(200 - shift + k, 204 - shift - k)) for k in (1, -2))
    assert inner <= set(missing) <= outer


def test_edges_grow_by_their_parameter_on_both_sides_and_keep_the_near_depth():
    noisy = seen(box(1.0, 2.0), **QUIET, ragged_px=0, fat_px=3)
    near = np.abs(noisy - 1.0) < 1e-3
    rows, columns = np.flatnonzero(near.any(1)), np.flatnonzero(near.any(0))
    assert (rows.min(), rows.max()) == (77, 162)
    assert (columns.min(), columns.max()) == (197, 262)
    ragged = np.abs(seen(box(1.0, 2.0), **QUIET, ragged_px=1, fat_px=3) - 1.0) < 1e-3
    edge = [np.flatnonzero(row).max() for row in ragged[90:150]]
    assert np.std(edge) > 0.3 and np.mean(edge) == pytest.approx(262, abs=1)


def test_a_slanted_surface_without_noise_stays_as_it_is(plane):
    depth = plane(DEVICE, 60, 2.0)
    noisy = seen(depth, **QUIET)
    assert np.abs(noisy / depth - 1)[noisy > 0].max() < 1e-3


@pytest.mark.parametrize("albedo", [0.04, 0.2, 0.8])
def test_the_range_of_the_pattern_grows_with_the_root_of_the_albedo(albedo):
    """Keselman and others 2017, section 4.2.8."""
    reach_m = 10 * np.sqrt(albedo / 0.95)
    for share, is_measured in ((0.97, True), (1.06, False)):
        noisy = seen(wall(share * reach_m), albedo=albedo, **QUIET)
        assert (noisy[:, 200:220] > 0).all() == is_measured


def test_black_cardboard_at_63_cm_is_measured():
    """Curto and Araujo, Sensors 2022, table 3, of the D415: 0.0000 % invalid."""
    assert (seen(wall(0.63), albedo=0.04)[:, 60:] > 0).all()


def test_dark_surfaces_out_of_the_patterns_reach_are_matched_by_their_texture():
    grey = np.full((240, 424, 3), 0.03, np.float32)
    checked = grey.copy()
    checked[:, ::8] = 0.02
    assert (seen(wall(4.0), None, rgb=grey) == 0).all()
    assert (seen(wall(4.0), None, rgb=checked)[:, 40:-8] > 0).all()


def test_saturated_and_grazing_surfaces_are_missing(plane):
    lamp = np.full((240, 424, 3), 0.5, np.float32)
    lamp[100:120, 300:340] = 1.5
    missing = seen(wall(2.0), None, rgb=lamp) == 0
    assert missing[100:120, 300:340].all() and not missing[:, 60:290].any()
    narrow = PinholeCamera(200, 200, 8000, 8000, 99.5, 99.5)
    for angle_deg, is_measured in ((75, True), (82, False)):
        noisy = seen(plane(narrow, angle_deg, 8.0), 1.0, narrow, **QUIET, pattern_range_m=1e3)
        assert (noisy[50:150, 100:150] > 0).all() == is_measured


def test_given_normals_decide_instead_of_those_of_the_depth_image():
    rays = DEVICE.rays()
    along = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    side = np.cross(along, [0.0, 1.0, 0.0])
    for normals, is_measured in ((-along, True), (side, False)):
        noisy = noisy_depth(wall(2.0), "d435", DEVICE, albedo=0.8, normals=normals)
        assert (noisy[:, 60:] > 0).all() == is_measured


def test_what_it_lacks_or_what_does_not_fit_is_one_line():
    with pytest.raises(InputError, match=r"colour or albedo for the depth noise d435.*rgb="):
        noisy_depth(wall(1.0), "d435", DEVICE)
    with pytest.raises(InputError, match="colour of the depth's size"):
        noisy_depth(wall(1.0), "d435", DEVICE, rgb=np.zeros((9, 9, 3), np.float32))
    with pytest.raises(InputError, match=r"albedo in 0\.\.1"):
        noisy_depth(wall(1.0), "d435", DEVICE, albedo=80)
    with pytest.raises(InputError, match="rgb for each of 2 images"):
        noisy_depth(np.ones((2, 240, 424), np.float32), "d435", DEVICE, rgb=np.zeros((240, 424, 3)))


def test_a_batch_has_the_bytes_of_its_frames_and_8_bit_colour_those_of_its_light():
    from iclnuim import linear_from_srgb8

    rng = np.random.default_rng(3)
    depth = rng.uniform(1, 1.2, (3, 240, 424)).astype(np.float32)
    colour = rng.integers(0, 256, (3, 240, 424, 3), dtype=np.uint8)
    batch = noisy_depth(depth, "d435", DEVICE, seed=5, frame=7, rgb=colour)
    for k in range(3):
        light = linear_from_srgb8(colour[k])
        alone = noisy_depth(depth[k], "d435", DEVICE, seed=5, frame=7 + k, rgb=light)
        assert batch[k].tobytes() == alone.tobytes()
    assert batch[0].tobytes() != batch[1].tobytes()


@pytest.mark.parametrize("reach", [0, 1, 5])
def test_largest_of_a_window_is_scipys(reach):
    image = np.random.default_rng(1).standard_normal((40, 60)).astype(np.float32)
    expected = ndimage.maximum_filter(image, 2 * reach + 1, mode="constant", cval=-np.inf)
    assert (largest(image, reach) == expected).all()


@pytest.mark.parametrize("side", [1, 2, 9, 10.4])
def test_correlated_noise_has_variance_1(side):
    field = correlated(np.random.default_rng(2), (600, 700), side)
    windows = field.size / round(side) ** 2
    assert field.shape == (600, 700) and field.dtype == np.float32
    assert field.var() == pytest.approx(1, abs=8 / np.sqrt(windows))


def test_brightness_stands_for_the_reflectance_unless_albedo_is_given():
    dark = np.full((240, 424, 3), 0.4 * 0.1, np.float32)
    reach_m = 10 * np.sqrt(0.1 / 0.95)
    for rgb, albedo, share, is_measured in (
        (dark, None, 0.97, True),
        (dark, None, 1.06, False),
        (dark, 0.2, 1.06, True),
    ):
        noisy = seen(wall(share * reach_m), albedo, rgb=rgb, **QUIET)
        assert (noisy[:, 200:220] > 0).all() == is_measured
