"""Calibration gives back what was put in, to 5 %."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.calibration import calibrate_depth, calibrate_rgb
from iclnuim.sensor.depth import PaperDepthNoise
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.sensor.rgb import PaperRgbNoise

EXPOSURES = (0.25, 0.5, 1.0, 2.0, 4.0)


def _series(sigma_c, sigma_s, repeats=12):
    """A scene from near black to white under five exposures."""
    scene = np.geomspace(0.004, 1.0, 160 * 120).reshape(120, 160, 1) * np.array([1.0, 0.8, 0.6])
    images = []
    for k, exposure in enumerate(EXPOSURES):
        model = PaperRgbNoise(exposure=exposure, sigma_c=sigma_c, sigma_s=sigma_s)
        images.append(
            np.stack(
                [model.apply(scene, frame_generator(1, 100 * k + r, 1)) for r in range(repeats)]
            )
        )
    return images


@pytest.mark.parametrize(("sigma_c", "sigma_s"), [(0.004, 0.02), (0.002, 0.03), (0.0005, 0.0156)])
def test_response_and_noise_line_come_back(sigma_c, sigma_s):
    found = calibrate_rgb(EXPOSURES, _series(sigma_c, sigma_s))
    assert found.response == "srgb"
    assert found.sigma_s == pytest.approx(sigma_s, rel=0.05)
    assert found.sigma_c == pytest.approx(sigma_c, rel=0.05)


@pytest.mark.parametrize("gamma", [1.0, 1.8])
def test_another_response_is_named(gamma):
    rng = np.random.default_rng(1)
    scene = np.geomspace(0.01, 1.0, 120 * 160).reshape(120, 160, 1) * np.ones(3)
    images = []
    for exposure in EXPOSURES:
        light = np.clip(scene * exposure + 0.004 * rng.standard_normal((8, *scene.shape)), 0, 1)
        images.append(np.rint(255 * light ** (1 / gamma)).astype(np.uint8))
    found = calibrate_rgb(EXPOSURES, images)
    assert found.response == ("linear" if gamma == 1 else "gamma")
    assert found.gamma == pytest.approx(gamma, rel=0.03)


def _walls(model, plane, angles, depth_m=2.0, frames=30):
    camera = PinholeCamera.parse("160x120")
    walls = []
    for k, angle in enumerate(angles):
        wall = plane(camera, angle, depth_m)
        walls.append(
            np.stack(
                [
                    model.apply(wall, camera, frame_generator(k, f, 0))[4:-4, 4:-4]
                    for f in range(frames)
                ]
            )
        )
    return walls


@pytest.mark.parametrize(("sigma_d", "sigma_s"), [(1 / 6, 0.5), (0.4, 1.0)])
def test_disparity_noise_and_shift_come_back_from_walls_of_two_slopes(plane, sigma_d, sigma_s):
    model = PaperDepthNoise(sigma_d=sigma_d, sigma_s_px=sigma_s, lateral=False)
    found = calibrate_depth(_walls(model, plane, (20, 45, 60)))
    assert not found.fixed_sigma_s and found.frames == 90
    assert found.sigma_d == pytest.approx(sigma_d, rel=0.05)
    assert found.sigma_s_px == pytest.approx(sigma_s, rel=0.05)


def test_one_wall_gives_the_disparity_noise_for_the_shift_it_is_told(plane):
    model = PaperDepthNoise(lateral=False)
    wall = _walls(model, plane, (25,))
    wall[0][:, 20:50, 30:60] = 1.2  # something before the wall
    wall[0][::3, 60:70] = 0
    found = calibrate_depth(wall)
    assert found.fixed_sigma_s and found.sigma_d == pytest.approx(1 / 6, rel=0.05)


def test_a_room_instead_of_a_wall_and_equal_repeats_are_refused(plane):
    model = PaperDepthNoise(lateral=False)
    (wall,) = _walls(model, plane, (25,))
    v, u = np.mgrid[0 : wall.shape[1], 0 : wall.shape[2]]
    relief = wall + 0.05 * np.sin(u / 15) * np.cos(v / 20)
    moving = np.stack([np.roll(relief[k], 5 * k, axis=1) for k in range(len(relief))])
    for depth_z_m in (relief, moving):
        with pytest.raises(
            InputError,
            match="expected a flat wall in front of a camera that does not move, found deviations of",
        ):
            calibrate_depth([depth_z_m])
    images = _series(0.01, 0.01)
    for repeats in ([0, 0, 0], [0, 1, 1]):
        with pytest.raises(InputError, match="differ by their noise, found the same image twice"):
            calibrate_rgb(EXPOSURES, [stack[repeats] for stack in images])


@pytest.mark.parametrize(("value", "used"), [(4, False), (9, True), (241, True), (246, False)])
def test_values_near_black_and_white_are_not_used(value, used):
    rng = np.random.default_rng(1)
    images = [(value + rng.integers(-1, 2, (6, 20, 20, 3))).astype(np.uint8) for _ in range(2)]
    with pytest.raises(InputError) as error:  # in the end both exposures look the same
        calibrate_rgb([1.0, 2.0], images)
    assert ("neither black nor white" in str(error.value)) != used


@pytest.mark.parametrize(("period_px", "flat"), [(16, True), (32, False)])
def test_waves_of_a_wall_count_as_relief_from_two_blocks_of_16_pixels_on(period_px, flat):
    u = np.arange(160)
    rng = np.random.default_rng(1)
    disparity = 175.0 + 3 * np.sin(2 * np.pi * u / period_px) + rng.normal(0, 0.3, (4, 120, 160))
    if flat:
        assert calibrate_depth([351.3 / disparity]).frames == 4
        return
    with pytest.raises(InputError, match="a flat wall"):
        calibrate_depth([351.3 / disparity])


@pytest.mark.parametrize("exposure", [0.0, -1.0, float("inf"), float("nan")])
@pytest.mark.filterwarnings("error")
def test_an_exposure_that_is_not_positive_and_finite_is_refused(exposure):
    with pytest.raises(
        InputError, match=f"finite and > 0, with images each, found 1, {exposure:g}"
    ):
        calibrate_rgb([1.0, exposure], [np.zeros((2, 4, 4, 3), np.uint8)] * 2)


def test_too_little_is_said_in_one_line():
    with pytest.raises(InputError, match="two or more exposures"):
        calibrate_rgb([1.0], [np.zeros((3, 4, 4, 3), np.uint8)])
    with pytest.raises(InputError, match="two or more 8-bit images"):
        calibrate_rgb([1.0, 2.0], [np.zeros((1, 4, 4, 3), np.uint8)] * 2)
    with pytest.raises(InputError, match="neither black nor white"):
        calibrate_rgb([1.0, 2.0], [np.zeros((2, 4, 4, 3), np.uint8)] * 2)
    with pytest.raises(InputError, match="a wall that fills the depth images, found 0 %"):
        calibrate_depth([np.zeros((3, 20, 20))])
