"""`phone`: a small smooth image from a grid of dots, filled along the edges of colour."""

import numpy as np
import pytest
from iclnuim import noisy_depth, phone_depth
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.appearance import SurfaceAppearance
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.sensor.phone import HIGH, LOW, PhoneDepthNoise

CAMERA = PinholeCamera.parse("640x480")
QUIET = {"sigma_m": 0, "sigma_per_m": 0}


def wall(depth_m, camera=CAMERA):
    return np.full((camera.height, camera.width), depth_m, np.float32)


def grey(value=0.5, camera=CAMERA):
    return np.full((camera.height, camera.width, 3), value, np.float32)


def seen(depth_z_m, rgb=None, seed=0, camera=CAMERA, **settings):
    rgb = grey(camera=camera) if rgb is None else rgb
    return noisy_depth(depth_z_m, "phone", camera, seed, settings=settings, rgb=rgb).astype(float)


def measured(depth_z_m, rgb=None, **settings):
    """(depth, confidence) of the phone's size."""
    appearance = SurfaceAppearance.of_light(grey() if rgb is None else rgb)
    model = PhoneDepthNoise(**settings)
    return model.with_confidence(depth_z_m, CAMERA, frame_generator(0, 0, 0), appearance)


def test_the_image_is_256_by_192_and_each_pixel_of_a_larger_one_is_the_nearest_of_it():
    small = seen(wall(2.0), size="native")
    assert small.shape == (192, 256)
    large = seen(wall(2.0))
    assert large.shape == (480, 640)
    v, u = np.mgrid[0:480, 0:640]
    assert (large == small[((v + 0.5) / 2.5).astype(int), ((u + 0.5) / 2.5).astype(int)]).all()


def test_the_small_camera_sees_the_same_directions():
    small = PhoneDepthNoise().native_camera(CAMERA)
    corners = np.array([[-0.5, -0.5], [639.5, 479.5]])
    for camera, (u, v) in ((CAMERA, corners.T), (small, np.array([[-0.5, 255.5], [-0.5, 191.5]]))):
        slopes = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        assert np.allclose(slopes[0], (corners[:, 0] - CAMERA.cx) / CAMERA.fx)
        assert np.allclose(slopes[1], (corners[:, 1] - CAMERA.cy) / CAMERA.fy)


@pytest.mark.parametrize("angle_deg", [0, 30, 60])
def test_a_plane_of_one_colour_stays_a_plane(plane, angle_deg):
    depth = plane(CAMERA, angle_deg, 2.0)
    noisy = seen(depth, **QUIET, range_m=1e3)
    if angle_deg == 60:  # on the left the plane goes to infinity
        noisy, depth = noisy[:, 100:], depth[:, 100:]
    assert (noisy > 0).all()
    # the dots and the small image are read at whole pixels
    slope = np.abs(np.gradient(1 / depth.astype(float), axis=1)).max()
    assert np.abs(1 / noisy - 1 / depth).max() < 2.5 * slope + 1e-6


@pytest.mark.parametrize("depth_m", [0.5, 1.0, 2.0])
def test_a_wall_is_within_a_centimetre_as_printed_and_smooth(depth_m):
    """Luetzenburg and others 2021: an absolute accuracy of 1 cm."""
    noisy = np.stack([seen(wall(depth_m), seed=k, size="native") for k in range(4)])
    error_m = noisy - depth_m
    assert np.sqrt((error_m**2).mean()) < 0.01 and abs(error_m.mean()) < 0.002
    neighbour = (error_m[..., 1:] * error_m[..., :-1]).mean() / (error_m**2).mean()
    apart = (error_m[..., 40:] * error_m[..., :-40]).mean() / (error_m**2).mean()
    assert neighbour > 0.97 and abs(apart) < 0.1


def test_each_dot_has_its_sigma_and_there_are_576():
    model = PhoneDepthNoise()
    narrow = PinholeCamera(640, 480, 1e5, 1e5, 319.5, 239.5)
    appearance = SurfaceAppearance.of_light(grey())
    rng = frame_generator(0, 0, 0)
    dots = [model.dots_of(wall(2.0), narrow, rng, appearance)[0] for _ in range(8)]
    assert dots[0].size == 576
    assert (1 / np.stack(dots)).std() == pytest.approx(0.004 + 2.0 * 0.004, rel=0.05)


def square(side_px, depth_m=1.0, colour=0.1):
    """A near square before a wall at twice its depth, of its own colour."""
    depth, rgb = wall(2.0 * depth_m), grey()
    top, left = 240 - side_px // 2, 320 - side_px // 2
    depth[top : top + side_px, left : left + side_px] = depth_m
    rgb[top : top + side_px, left : left + side_px] = colour
    return depth, rgb


def test_depth_has_its_edges_where_colour_has_them_and_is_smeared_where_it_has_none():
    depth, rgb = square(200)
    with_edge = np.abs(seen(depth, rgb, **QUIET) / depth - 1)
    without = np.abs(seen(depth, grey(), **QUIET) / depth - 1)
    assert (with_edge > 0.1).mean() < 0.005 < 0.02 < (without > 0.1).mean()


def test_an_edge_of_colour_alone_leaves_depth_as_it_is():
    _, rgb = square(200)
    assert np.abs(seen(wall(2.0), rgb, **QUIET) - 2.0).max() < 1e-3


def test_things_of_10_cm_are_seen_and_narrow_ones_fall_between_the_dots():
    """Luetzenburg and others 2021: accurate from 10 cm on, nothing below 5 cm."""
    wide_px, narrow_px = (round(CAMERA.fx * size_m / 1.0) for size_m in (0.10, 0.02))
    noisy = seen(*square(wide_px), **QUIET)
    assert np.abs(noisy[230:250, 310:330] - 1.0).max() < 0.01
    found = []
    for shift in range(0, 27, 3):
        depth, rgb = (np.roll(image, shift, 1) for image in square(narrow_px))
        near = seen(depth, rgb, **QUIET)[238:242, 318 + shift : 322 + shift]
        found.append(np.abs(near - 1.0).max() < 0.05)
    assert not all(found)


@pytest.mark.parametrize("albedo", [0.05, 0.2, 0.8])
def test_dots_return_to_a_distance_that_grows_with_the_root_of_the_albedo(albedo):
    reach_m = 5 * np.sqrt(albedo / 0.2)
    middle = np.s_[230:250, 310:330]
    for share, is_measured in ((0.97, True), (1.03, False)):
        noisy = seen(wall(share * reach_m), grey(0.4 * albedo), **QUIET)[middle]
        assert (noisy > 0).all() == is_measured and (noisy > 0).any() == is_measured


def test_confidence_is_high_on_a_wall_and_low_at_edges_and_out_of_reach():
    _, level = measured(wall(1.0))
    assert level.shape == (192, 256) and level.dtype == np.uint8
    assert (level == HIGH).mean() > 0.99
    depth, _ = square(200)
    _, level = measured(depth, **QUIET)
    assert level[96, 128] == HIGH and level[96, 10] == HIGH
    assert LOW in level[96, 80:100]
    noisy, level = measured(wall(9.0), grey(0.05))
    assert (noisy == 0).all() and (level == LOW).all()


def test_phone_depth_gives_the_same_depth_with_its_confidence_and_camera():
    depth, rgb = square(200)
    small_m, level, camera = phone_depth(depth, CAMERA, seed=2, rgb=rgb)
    assert (
        small_m.tobytes()
        == noisy_depth(depth, "phone", CAMERA, 2, settings={"size": "native"}, rgb=rgb).tobytes()
    )
    assert level.shape == small_m.shape == (camera.height, camera.width) == (192, 256)
    with pytest.raises(InputError, match="depth of the camera's size 640x480"):
        phone_depth(depth[:100], CAMERA, rgb=rgb)


def test_small_images_keep_their_size_and_seeds_give_the_same_bytes():
    camera = PinholeCamera.parse("80x60")
    depth = wall(1.5, camera)
    one, again = (seen(depth, camera=camera, seed=3) for _ in range(2))
    assert one.shape == (60, 80) and one.tobytes() == again.tobytes()
    assert seen(depth, camera=camera, seed=4).tobytes() != one.tobytes()


def test_without_colour_it_says_what_it_lacks():
    with pytest.raises(InputError, match="colour or albedo for the depth noise phone"):
        noisy_depth(wall(1.0), "phone", CAMERA)
    with pytest.raises(InputError, match="size .*one of image, native"):
        seen(wall(1.0), size="large")
