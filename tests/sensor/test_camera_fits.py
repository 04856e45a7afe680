"""Walls recorded through a model of a depth camera give back its settings, to 5 %, and its name."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.appearance import SurfaceAppearance
from iclnuim.sensor.calibration import calibrate_depth
from iclnuim.sensor.camera_fits import LIKE, fit_cameras
from iclnuim.sensor.models import depth_model, with_depth_noise
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.sensor.walls import WallRecording

CAMERA = PinholeCamera.parse("320x240,262,262,159.5,119.5")
#: angle, distance in metres, reflectance
WHITE_WALLS = ((20, 0.8, 0.95), (30, 2.0, 0.95), (45, 3.2, 0.95))
FRAMES = 24


def slow(settings):
    return pytest.param(settings, marks=pytest.mark.slow)


def recorded(plane, model, walls, camera=CAMERA, frames=FRAMES):
    recordings = []
    for k, (angle, distance_m, albedo) in enumerate(walls):
        depth_z_m = plane(camera, angle, distance_m)
        seen = SurfaceAppearance.given(depth_z_m.shape, albedo=albedo)
        noisy = [
            with_depth_noise(model, depth_z_m, camera, frame_generator(k, f, 0), seen)
            for f in range(frames)
        ]
        recordings.append(WallRecording(np.stack(noisy), camera, albedo))
    return recordings


def fits(walls):
    """As the command: `paper` is fitted where its noise is possible."""
    try:
        paper = calibrate_depth([wall.frames for wall in walls])
    except InputError:
        paper = None
    return fit_cameras(walls, paper)


def fit(plane, name, settings, walls):
    """The best fit, and how far each determined setting is from the truth, as a share."""
    model = depth_model(name, settings)
    best = fits(recorded(plane, model, walls))[0]
    assert best.model == name and best.misfit < LIKE / 3
    truth = model.to_dict()
    return best, {key: value / truth[key] - 1 for key, value in best.settings.items()}


@pytest.mark.parametrize(
    "settings", [{}, slow({"subpixel_px": 0.15, "window_px": 13.0, "baseline_m": 0.055})]
)
def test_an_active_stereo_camera(plane, settings):
    dark = (70, 1.5, 0.02)  # lost with the distance
    best, errors = fit(plane, "d435", settings, (*WHITE_WALLS, dark))
    # the window is a whole number of this image's pixels
    assert abs(errors.pop("window_px")) < 0.5 / (0.618 * 9) + 0.01
    assert set(errors) == {"baseline_m", "subpixel_px", "pattern_range_m"}
    assert max(map(abs, errors.values())) < 0.05
    assert "fat_px" in best.not_determined


def test_the_nearest_distance_of_active_stereo(plane):
    best, errors = fit(plane, "d435", {}, ((60, 0.3, 0.95),))
    assert abs(errors["search_px"]) < 0.05 and "subpixel_px" in best.not_determined


@pytest.mark.parametrize(
    "settings", [{}, slow({"noise_m": 0.0015, "power": 1.0, "wiggle_m": 0.004})]
)
def test_a_time_of_flight_camera(plane, settings):
    walls = ((20, 0.55, 0.95), *WHITE_WALLS, (55, 1.6, 0.3), (60, 0.6, 0.95))
    best, errors = fit(plane, "azure_kinect", settings, walls)
    told = {"base_m", "noise_m", "power", "wiggle_m", "dark_range_m", "amplitude_noise", "near_m"}
    assert set(errors) == told
    assert max(map(abs, errors.values())) < 0.05


@pytest.mark.parametrize(
    "settings", [{}, slow({"dots": 20, "sigma_m": 0.006, "sigma_per_m": 0.003})]
)
def test_a_phone(plane, settings):
    best, errors = fit(plane, "phone", settings, WHITE_WALLS)
    assert set(errors) == {"dots", "sigma_m", "sigma_per_m"} and errors["dots"] == 0
    assert max(map(abs, errors.values())) < 0.05


def test_the_model_of_the_paper(plane):
    best, errors = fit(
        plane, "paper", {"lateral": False}, ((20, 2.0, 0.95), (45, 2.0, 0.95), (60, 2.0, 0.95))
    )
    assert set(errors) == {"sigma_d", "sigma_s_px"} and max(map(abs, errors.values())) < 0.05


def test_one_distance_determines_no_growth(plane):
    wall = ((5, 1.0, 0.95),)
    settings = {
        fit.model: set(fit.settings)
        for fit in fits(recorded(plane, depth_model("azure_kinect"), wall))
    }
    assert not settings["azure_kinect"] & {"base_m", "noise_m", "power"}
    assert not settings["phone"] & {"sigma_m", "sigma_per_m"}


def test_equal_frames_have_no_noise_to_fit(plane):
    exact = np.repeat(plane(CAMERA, 20, 1.0)[None], 4, 0)
    for frames in (exact, exact[:1]):
        with pytest.raises(InputError, match="two or more depth images of each wall that differ"):
            fits([WallRecording(frames, CAMERA)])
