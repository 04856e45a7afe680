"""The other depth noise models: each does what its source says, and all keep the same promises."""

from functools import partial
from statistics import NormalDist

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.appearance import SurfaceAppearance
from iclnuim.sensor.depth import (
    Kinect2012DepthNoise,
    PaperDepthNoise,
    RedwoodDepthNoise,
    ReleasedDepthNoise,
)
from iclnuim.sensor.depth_image import surface_normals
from iclnuim.sensor.models import (
    DEPTH_MODELS,
    RGB_MODELS,
    depth_model,
    rgb_model,
    with_depth_noise,
)
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.settings import declared


def noisy(name, depth_z_m, camera, seed, frame):
    """With the noise of a model, on surfaces that are all alike."""
    rng = frame_generator(seed, frame, 0)
    seen = SurfaceAppearance.given(depth_z_m.shape, albedo=0.8)
    return with_depth_noise(depth_model(name), depth_z_m, camera, rng, seen)


@pytest.mark.parametrize("name", DEPTH_MODELS)
def test_every_model_gives_the_same_bytes_for_the_same_frame_and_others_for_others(
    camera, plane, name
):
    depth = plane(camera, 30, 2.0)
    one, again = (noisy(name, depth, camera, 7, 3) for _ in range(2))
    assert one.dtype == np.float32 and one.shape == depth.shape
    assert one.tobytes() == again.tobytes()
    if name != "none":
        assert one.tobytes() != noisy(name, depth, camera, 7, 4).tobytes()
        assert one.tobytes() != noisy(name, depth, camera, 8, 3).tobytes()


@pytest.mark.parametrize("name", DEPTH_MODELS)
def test_no_model_invents_depth_or_changes_its_input(camera, plane, name):
    depth = plane(camera, 30, 2.0)
    depth[:60], depth[60, :9] = 0, [np.nan, np.inf, -np.inf, -1, 1e10, 0, np.nan, -0.0, np.inf]
    before = depth.tobytes()
    measured = noisy(name, depth, camera, 1, 1)
    assert depth.tobytes() == before
    assert np.isfinite(measured).all() and (measured >= 0).all()
    # the phone's dots fill a cell and a half of ten pixels around them
    reach = 16 if name == "phone" else 8
    assert (measured[: 60 - reach] == 0).all()
    assert (measured[80:-8, 8:-8] > 0).mean() > 0.98
    nothing = np.zeros((240, 320), np.float32)
    assert (noisy(name, nothing, camera, 1, 1) == 0).all()


def test_released_leaves_whole_millimetres_and_a_border_without_normals(camera, plane):
    noisy = ReleasedDepthNoise().apply(plane(camera, 10, 2.0), camera, frame_generator(1, 1, 0))
    millimetres = noisy.astype(float) * 1000
    assert np.abs(millimetres - np.rint(millimetres)).max() < 1e-3
    assert (noisy[0] == 0).mean() > 0.3 and (noisy[:, 0] == 0).mean() > 0.3


def test_released_rounds_to_centimetres_before_the_disparity_and_cuts_to_millimetres_after(
    camera, plane
):
    quiet = {"sigma_s_px": 0, "offset_px": 0, "sigma_d": 0, "disparity_bias": 0}
    depth = plane(camera, 30, 2.0)
    for fine, step_m in (({"disparity_cm": 1e7, "output_step_m": 1e-6}, 0.01), ({}, 0.001)):
        model = ReleasedDepthNoise(**quiet, **fine)
        noisy = model.apply(depth, camera, frame_generator(1, 1, 0))[1:, 1:].astype(float)
        steps = noisy[noisy > 0] / step_m
        assert np.abs(steps - np.rint(steps)).max() < 0.02
        assert 0.4 < (np.rint(steps) % 2).mean() < 0.6


def test_released_is_biased_towards_the_camera_by_half_a_step():
    wall = np.full((240, 320), 3.5, np.float32)
    noisy = ReleasedDepthNoise().apply(
        wall, PinholeCamera.parse("320x240"), frame_generator(1, 1, 0)
    )
    inner = noisy[8:-8, 8:-8].astype(float)
    assert 351.3 / inner.mean() - 351.3 / 3.5 == pytest.approx(0.5, abs=0.25)


@pytest.mark.parametrize("depth_m", [0.8, 1.5, 3.0])
def test_kinect2012_has_the_axial_noise_of_its_formula_on_a_facing_wall(depth_m):
    wall = np.full((240, 320), depth_m, np.float32)
    noisy = Kinect2012DepthNoise().apply(
        wall, PinholeCamera(320, 240, 1e4, 1e4, 159.5, 119.5), frame_generator(1, 1, 0)
    )
    assert noisy.astype(float).std() == pytest.approx(
        0.0012 + 0.0019 * (depth_m - 0.4) ** 2, rel=0.02
    )
    assert noisy.astype(float).mean() == pytest.approx(depth_m, abs=1e-4)


@pytest.mark.parametrize("angle_deg", [20, 50, 70])
def test_kinect2012_shifts_by_its_lateral_sigma(plane, angle_deg):
    camera = PinholeCamera(200, 200, 2000, 2000, 99.5, 99.5)
    depth = plane(camera, angle_deg, 2.0)
    model = Kinect2012DepthNoise(axial_m=0, axial_per_m=0, axial_angle=0)
    noisy = model.apply(depth, camera, frame_generator(1, 1, 0)).astype(float)
    inverse = 1 / depth.astype(float)
    shift = ((1 / noisy - inverse) / np.gradient(inverse, axis=1))[8:-8, 8:-8]
    angle = np.radians(angle_deg)
    assert shift.std() == pytest.approx(0.8 + 0.035 * angle / (np.pi / 2 - angle), rel=0.03)


@pytest.mark.parametrize("depth_m", [0.8, 2.0, 3.5])
@pytest.mark.parametrize("angle_deg", [0, 30, 50, 65, 75])
def test_kinect2012_has_the_axial_sigma_of_its_formula_at_every_angle(plane, angle_deg, depth_m):
    """Nguyen, Izadi, Lovell 2012: 0.0012 + 0.0019 (z - 0.4)^2 + 0.0001 / sqrt(z) t^2 / (pi/2 - t)^2
    metres.
    """
    camera = PinholeCamera(200, 200, 8000, 8000, 99.5, 99.5)  # a narrow view: one angle
    depth = plane(camera, angle_deg, depth_m)
    model = Kinect2012DepthNoise(lateral_px=0, lateral_angle_px=0)
    error_m = model.apply(depth, camera, frame_generator(1, 1, 0)).astype(float) - depth
    angle = np.radians(angle_deg)
    by_angle_m = 0.0001 / np.sqrt(depth_m) * angle**2 / (np.pi / 2 - angle) ** 2
    sigma_m = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2 + by_angle_m
    assert error_m[8:-8, 8:-8].std() == pytest.approx(sigma_m, rel=0.03)


@pytest.mark.parametrize("model", [PaperDepthNoise, Kinect2012DepthNoise])
@pytest.mark.parametrize(("step", "mixed"), [(0.07, True), (0.15, False)])
def test_depth_is_interpolated_across_a_step_within_a_tenth_of_it_only(model, step, mixed):
    camera = PinholeCamera.parse("160x120")
    depth = np.full((120, 160), 2.0, np.float32)
    depth[:, 80:] = 2.0 * (1 + step)
    quiet = {"sigma_d": 0, "disparity_cm": 1e9, "lateral": False}
    if model is Kinect2012DepthNoise:
        quiet = {"axial_m": 0, "axial_per_m": 0, "axial_angle": 0}
    noisy = model(**quiet).apply(depth, camera, frame_generator(1, 1, 0))
    between = (noisy > 2.01) & (noisy < 2.0 * (1 + step) - 0.01)
    assert bool(between.any()) == mixed


def test_redwood_shifts_by_a_quarter_of_a_pixel_and_adds_its_disparity_noise(camera, plane):
    depth = plane(camera, 40, 2.0)
    shifted = RedwoodDepthNoise(snap_px=1, sigma_d=0, steps=1e6)
    moved = shifted.apply(depth, camera, frame_generator(1, 1, 0)) / depth
    beyond_half = 2 * (1 - NormalDist().cdf(0.5 / 0.25))  # along u, where the plane is slanted
    assert (np.abs(moved - 1) > 1e-4).mean() == pytest.approx(beyond_half, rel=0.1)
    noisy = RedwoodDepthNoise(snap_px=1, sigma_s_px=0, steps=1e6)
    noisy_m = noisy.apply(depth, camera, frame_generator(1, 1, 0)).astype(float)
    assert (35.130 / noisy_m - 35.130 / depth).std() == pytest.approx(1 / 36, rel=0.03)


def test_redwood_rounds_disparity_to_eighths_snaps_to_even_pixels_and_ends_at_10_m(camera, plane):
    depth = plane(camera, 40, 2.0)
    noisy = RedwoodDepthNoise().apply(depth, camera, frame_generator(1, 1, 0)).astype(float)
    eighths = 35.130 / noisy * 8
    assert np.abs(eighths - np.rint(eighths)).max() < 1e-3
    assert set(np.diff(np.unique(np.rint(eighths)))) == {1}
    quiet = RedwoodDepthNoise(sigma_s_px=0, sigma_d=0, steps=1e6).apply(
        depth, camera, frame_generator(1, 1, 0)
    )
    assert np.allclose(quiet[::2, ::2], depth[::2, ::2], rtol=1e-5)
    assert np.array_equal(quiet[1::2, 1::2], quiet[::2, ::2])
    for depth_m, seen in ((9.9, True), (10.0, False)):
        far = np.full((240, 320), depth_m, np.float32)
        noisy = RedwoodDepthNoise().apply(far, camera, frame_generator(1, 1, 0))
        assert (noisy > 0).all() == seen and (noisy > 0).any() == seen


@pytest.mark.parametrize("steps", [1.0, 8.0])
def test_redwoods_rounding_of_disparity_has_no_bias(camera, steps):
    """Errors of rounding to the nearest level are even over one level, so their mean is nothing."""
    disparity = np.random.default_rng(4).uniform(10, 50, (240, 320))
    quiet = RedwoodDepthNoise(sigma_s_px=0, snap_px=1, sigma_d=0, steps=steps)
    depth = (35.130 / disparity).astype(np.float32)
    rounded = 35.130 / quiet.apply(depth, camera, frame_generator(1, 1, 0)).astype(float)
    error = (rounded - 35.130 / depth) * steps
    assert np.abs(error).max() < 0.501
    assert abs(error.mean()) < 5 / np.sqrt(12 * error.size)


@pytest.mark.parametrize("angle_deg", [0, 25, 60, 80])
@pytest.mark.parametrize("normals", [surface_normals, partial(surface_normals, backward=True)])
def test_normals_of_planes_are_exact(camera, plane, normals, angle_deg):
    found = normals(plane(camera, angle_deg, 2.0), camera)
    rays = camera.rays()
    normal = np.array([np.sin(np.radians(angle_deg)), 0, np.cos(np.radians(angle_deg))])
    cosine = (rays @ normal) / np.linalg.norm(rays, axis=-1)
    seen = (cosine > 0.05) & (np.arange(320) > 0) & (np.arange(240) > 0)[:, None]
    assert np.abs(1 / found.secant - cosine)[seen].max() < 2e-3
    direction = np.stack([found.x, found.y, found.z], -1)
    with np.errstate(invalid="ignore"):
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    assert np.abs(direction @ normal - 1)[seen].max() < 1e-3


def test_an_unknown_setting_model_or_value_is_one_line():
    with pytest.raises(
        InputError, match="settings of the noise model 'paper'.*sigma_s_px.*found sigma_q"
    ):
        depth_model("paper", {"sigma_q": 1})
    with pytest.raises(
        InputError,
        match="a depth noise model .none, released, paper, kinect2012, redwood, d435, azure_kinect, phone.",
    ):
        depth_model("gauss")
    with pytest.raises(InputError, match="an RGB noise model|a RGB noise model"):
        rgb_model("gauss")
    for bad in (
        {"sigma_d": -1},
        {"sigma_d": "a"},
        {"sigma_d": True},
        {"lateral": 1},
        {"sigma_d": float("nan")},
    ):
        with pytest.raises(InputError, match="of the noise model 'paper'"):
            depth_model("paper", bad)
    with pytest.raises(InputError, match="variance of the noise model 'released' as 3 numbers"):
        rgb_model("released", {"variance": [1, 2]})
    with pytest.raises(InputError, match="at least 2 x 2"):
        depth_model("paper").apply(np.zeros((1, 5)), PinholeCamera(5, 1), frame_generator(0, 0, 0))


@pytest.mark.parametrize("models", [DEPTH_MODELS, RGB_MODELS])
def test_every_setting_has_a_source_and_comes_back_from_its_dictionary(models):
    for model in models.values():
        assert all(setting.source and setting.help for setting in declared(model).values())
        assert model.from_dict(model().to_dict()) == model()


def test_a_users_own_function_is_called_with_its_settings(tmp_path, monkeypatch, camera):
    (tmp_path / "my_noise_of_test.py").write_text(
        "def add(depth_z_m, camera, rng, amount=0.0):\n    return depth_z_m + amount\nvalue = 3\n"
        "def broken(depth_z_m, camera, rng):\n    raise KeyError('lens')\n"
    )
    (tmp_path / "no_python_of_test.py").write_text("def f(:\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    depth = np.ones((240, 320), np.float32)
    model = depth_model("my_noise_of_test:add", {"amount": 0.25})
    assert (model.apply(depth, camera, frame_generator(0, 0, 0)) == 1.25).all()
    assert (model.name, model.to_dict()) == ("my_noise_of_test:add", {"amount": 0.25})
    for wrong in ("no_such_module_at_all:f", "my_noise_of_test:absent", "my_noise_of_test:value"):
        with pytest.raises(InputError, match="expected"):
            depth_model(wrong)
    with pytest.raises(InputError, match="SyntaxError"):
        depth_model("no_python_of_test:f")
    with pytest.raises(
        InputError,
        match=r"call as add\(depth_z_m, camera, rng, much=...\), found .*unexpected keyword",
    ):
        depth_model("my_noise_of_test:add", {"much": 1})
    with pytest.raises(InputError, match=r"call as add\(light, rng\)"):
        rgb_model("my_noise_of_test:add")
    with pytest.raises(InputError, match="KeyError: 'lens' .line 5 of .*my_noise_of_test.py."):
        depth_model("my_noise_of_test:broken").apply(depth, camera, frame_generator(0, 0, 0))
