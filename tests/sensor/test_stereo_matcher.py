"""An independent judge of `d435`: OpenCV's semi-global matcher on two views of a projected pattern,
which Cycles renders (slow), or which are shifted by the disparity.
"""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.geometry.camera import PinholeCamera

CAMERA = PinholeCamera(424, 240, 424.0, 424.0, 211.5, 119.5)
BASELINE_M = 0.05
F_B = CAMERA.fx * BASELINE_M
DEPTHS_M = (1.0, 1.4, 2.0, 2.8, 4.0)
#: Disparities of the walls around each depth, a quarter of a pixel apart: a matcher's error changes
#: within a pixel.
PARTS_PX = (-0.375, -0.125, 0.125, 0.375)
#: Mean and noise of a grey value under automatic exposure, such that the matcher's error is that of
#: a textured target.
GREY, GREY_SIGMA = 40.0, 12.0


def wall(disparity_px):
    """Left, right, bottom, top and depth in metres of a rectangle that fills both views."""
    return -99, 99, -99, 99, F_B / disparity_px


#: Columns and rows of a near board before the wall of the last scene.
BOARD = np.s_[80:160, 200:280]
BOARD_PX, BEHIND_PX = 24, 8


def board():
    """A pixel's edge is half a pixel from its centre."""
    z = F_B / BOARD_PX
    edges = np.array([200 - 212, 280 - 212, -40, 40]) * z / CAMERA.fx
    return *edges.tolist(), z


SCENES = [[wall(F_B / z + part)] for z in DEPTHS_M for part in PARTS_PX]
SCENES.append([wall(BEHIND_PX), board()])


def disparity(scene):
    """(h, w) in pixels, of the left view."""
    found = np.full((CAMERA.height, CAMERA.width), F_B / scene[0][-1], np.float32)
    if len(scene) > 1:
        found[BOARD] = BOARD_PX
    return found


def dots(rng):
    """Blurred dots, as an imager of finite resolution sees them: (h, w) float32."""
    bright = (rng.random((CAMERA.height, CAMERA.width)) < 0.12).astype(np.float32)
    return cv2.GaussianBlur(bright, (0, 0), 0.8)


def shifted():
    """Left and right view of each scene (scenes, 2, h, w). The pattern is projected from the left
    imager's place; a pixel of the right view sees the nearest of the surfaces that land there.
    """
    found = []
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(np.float32)
    for seed, scene in enumerate(SCENES):
        rng = np.random.default_rng(seed)
        left, right, true_px = dots(rng), dots(rng), disparity(scene)
        for surface in sorted(np.unique(true_px)):
            from_u = u + np.float32(surface)
            seen = cv2.remap(left, from_u, v, cv2.INTER_CUBIC)
            own = (true_px == surface).astype(np.float32)
            own = cv2.remap(own, from_u, v, cv2.INTER_NEAREST)
            right = np.where(own > 0, seen, right)
        found.append([left, right])
    return np.array(found)


def rendered(folder):
    """The same by Cycles, with the projector between the imagers."""
    pytest.importorskip("bpy", reason="needs the bpy package")
    camera = CAMERA.width, CAMERA.height, CAMERA.fx
    asked = {"camera": camera, "baseline_m": BASELINE_M, "scenes": SCENES}
    script = Path(__file__).with_name("stereo_rig.py")
    command = [sys.executable, str(script), str(folder / "views.npz"), json.dumps(asked)]
    subprocess.run(command, check=True, capture_output=True)
    return np.load(folder / "views.npz")["views"]


@pytest.fixture(
    scope="module", params=["shifted", pytest.param("rendered", marks=pytest.mark.slow)]
)
def views(request, tmp_path_factory):
    if request.param == "shifted":
        return shifted()
    return rendered(tmp_path_factory.mktemp("views"))


def matched(pair, seed):
    """Depth (h, w) by the matcher from two views, 0 where it has none."""
    rng = np.random.default_rng(seed)
    exposed = pair * (GREY / pair.mean())
    noisy = (image + GREY_SIGMA * rng.standard_normal(image.shape) for image in exposed)
    left, right = (np.clip(image, 0, 255).astype(np.uint8) for image in noisy)
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=64, blockSize=9, P1=0, P2=0, disp12MaxDiff=1
    )
    found_px = matcher.compute(left, right).astype(float) / 16
    return np.where(found_px > 0, F_B / np.maximum(found_px, 1e-3), 0)


@pytest.fixture(scope="module")
def depths(views):
    """(scenes, h, w) in metres: the matcher's, and the model's."""
    by_matcher = [matched(pair, seed) for seed, pair in enumerate(views)]
    true_z_m = np.stack([F_B / disparity(scene) for scene in SCENES])
    return np.stack(by_matcher), noisy_depth(true_z_m, "d435", CAMERA, albedo=0.8).astype(float)


@pytest.fixture(scope="module")
def error_px(depths):
    """Errors (4, h, w) of disparity by depth, of the matcher and of the model, away from the left
    edge; the mean of each wall is subtracted.
    """

    def of_walls(noisy_m, k):
        found = []
        for part, seen in zip(PARTS_PX, noisy_m[4 * k : 4 * k + 4, 20:-20, 90:-20], strict=True):
            assert (seen > 0).mean() > 0.99
            error = F_B / np.where(seen > 0, seen, np.nan) - (F_B / DEPTHS_M[k] + part)
            error -= np.nanmean(error)
            found.append(np.where(np.abs(error) < 1, error, 0))
        return np.stack(found)

    return [{z: of_walls(noisy_m, k) for k, z in enumerate(DEPTHS_M)} for noisy_m in depths]


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


def test_the_shadow_of_both_is_on_the_left_side_and_as_wide_as_the_baseline_makes_it(depths):
    for noisy_m in depths:
        missing = noisy_m[-1, 100:140] == 0
        left, right = missing[:, 170:205].sum(1).mean(), missing[:, 275:310].sum(1).mean()
        assert left == pytest.approx(BOARD_PX - BEHIND_PX, abs=3) and right < 1
