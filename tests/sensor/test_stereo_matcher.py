"""An independent judge of `d435`: OpenCV's semi-global matcher on two views of a projected pattern."""

import cv2
import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.geometry.camera import PinholeCamera

CAMERA = PinholeCamera(424, 240, 424.0, 424.0, 211.5, 119.5)
F_B = 424 * 0.05
DEPTHS_M = (1.0, 1.4, 2.0, 2.8, 4.0)
#: Noise of a grey value, such that the matcher's error is that of a textured target.
GREY_SIGMA = 12.0


def pattern(rng, shape):
    """Blurred dots, as an imager of finite resolution sees them: (h, w) float32."""
    dots = (rng.random(shape) < 0.12).astype(np.float32) * 255
    return cv2.GaussianBlur(dots, (0, 0), 0.8) * 2


def views(depth_z_m, rng):
    """Left and right image, uint8. The pattern is projected from the left imager's place; a pixel
    of the right view sees the nearest of the surfaces that land there.
    """
    height, width = depth_z_m.shape
    left = pattern(rng, depth_z_m.shape)
    disparity = F_B / depth_z_m
    right = pattern(rng, depth_z_m.shape)
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    for surface in sorted(np.unique(disparity)):
        from_u = u + np.float32(surface)
        seen = cv2.remap(left, from_u, v, cv2.INTER_CUBIC)
        own = cv2.remap((disparity == surface).astype(np.float32), from_u, v, cv2.INTER_NEAREST)
        right = np.where(own > 0, seen, right)
    noisy = (image + GREY_SIGMA * rng.standard_normal(image.shape) for image in (left, right))
    return [np.clip(image, 0, 255).astype(np.uint8) for image in noisy]


def matched(depth_z_m, seed):
    """Depth (h, w) by the matcher, 0 where it has none."""
    left, right = views(depth_z_m, np.random.default_rng(seed))
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=64, blockSize=9, P1=0, P2=0, disp12MaxDiff=1
    )
    disparity = matcher.compute(left, right).astype(float) / 16
    return np.where(disparity > 0, F_B / np.maximum(disparity, 1e-3), 0)


def modelled(depth_z_m, seed):
    return noisy_depth(depth_z_m, "d435", CAMERA, seed, albedo=0.8).astype(float)


def errors(sensor, depth_m):
    """Errors (4, h, w) of disparity on four walls around a depth, whose disparities are a quarter of
    a pixel apart: a matcher's error changes within a pixel. Away from the left edge; the mean of
    each wall is subtracted.
    """
    found = []
    for seed, part in enumerate((-0.375, -0.125, 0.125, 0.375)):
        true_px = F_B / depth_m + part
        wall = np.full((240, 424), F_B / true_px, np.float32)
        noisy = sensor(wall, seed)[20:-20, 90:-20]
        assert (noisy > 0).mean() > 0.99
        error = F_B / np.where(noisy > 0, noisy, np.nan) - true_px
        error -= np.nanmean(error)
        found.append(np.where(np.abs(error) < 1, error, 0))
    return np.stack(found)


@pytest.fixture(scope="module")
def error_px():
    """(the matcher's, the model's) by depth."""
    return [{z: errors(sensor, z) for z in DEPTHS_M} for sensor in (matched, modelled)]


def test_sigma_of_both_grows_with_the_square_of_depth_and_differs_by_one_factor(error_px):
    sigma_m = np.array([[e[z].std() * z**2 / F_B for z in DEPTHS_M] for e in error_px])
    for of_one in sigma_m:
        assert 1.8 < np.polyfit(np.log(DEPTHS_M), np.log(of_one), 1)[0] < 2.2
    ratio = sigma_m[0] / sigma_m[1]
    assert np.abs(ratio / np.exp(np.log(ratio).mean()) - 1).max() < 0.25


def half_length_px(error):
    """The lag at which the correlation along rows falls to one half."""
    variance = (error**2).mean()
    falls = [(error[..., k:] * error[..., :-k]).mean() / variance for k in range(1, 14)]
    return np.interp(-0.5, -np.array(falls), np.arange(1, 14))


@pytest.mark.parametrize("depth_m", DEPTHS_M)
def test_errors_of_both_are_correlated_over_the_same_length(error_px, depth_m):
    lengths = [half_length_px(e[depth_m]) for e in error_px]
    assert lengths[1] == pytest.approx(lengths[0], rel=0.3)


def test_the_shadow_of_both_is_on_the_left_side():
    depth = np.full((240, 424), F_B / 8, np.float32)
    depth[80:160, 200:280] = F_B / 24
    for sensor in (matched, modelled):
        missing = sensor(depth, 1)[100:140] == 0
        left, right = missing[:, 170:205].sum(1).mean(), missing[:, 275:310].sum(1).mean()
        assert left > 6 and right < left / 4
