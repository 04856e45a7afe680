"""RGB noise: variances, correlation and transfer function come out as set."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.sensor.models import RGB_MODELS, rgb_model
from iclnuim.sensor.noise_model import frame_generator, gaussian
from iclnuim.sensor.rgb import PaperRgbNoise, ReleasedRgbNoise
from iclnuim.sensor.transfer import (
    light_from_srgb,
    linear_from_srgb8,
    srgb8,
    srgb8_in_place,
    srgb_from_light,
)


def _patch(light, shape=(200, 300, 3)):
    return np.full(shape, light, np.float32)


def test_8_bits_come_back_exactly_and_the_transfer_function_is_srgb():
    values = np.arange(256, dtype=np.uint8)
    assert np.array_equal(srgb8(linear_from_srgb8(values)), values)
    assert np.array_equal(srgb8(linear_from_srgb8(values).astype(np.float16)), values)
    light = np.linspace(0, 1, 10001)
    assert np.abs(light_from_srgb(srgb_from_light(light)) - light).max() < 1e-6
    assert np.abs(srgb8(light).astype(float) - srgb_from_light(light) * 255).max() < 0.56
    assert srgb8(np.array([np.nan, -1, np.inf, 7, -np.inf, 0.2159])).tolist() == [
        0,
        0,
        255,
        255,
        0,
        128,
    ]
    # OpenCV knows no sRGB curve; two values that stand in the standard's tables
    assert srgb_from_light(np.array([0.5])) == pytest.approx(0.735357, abs=1e-6)


def test_the_table_of_even_steps_is_the_same_curve():
    light = np.linspace(-0.2, 1.2, 200_001).astype(np.float32)
    exact = srgb_from_light(light.astype(float)) * 255
    assert np.abs(srgb8_in_place(light.copy()).astype(float) - exact).max() < 0.5 + 0.03
    assert np.array_equal(
        srgb8_in_place(linear_from_srgb8(np.arange(256, dtype=np.uint8))), np.arange(256)
    )


def test_light_that_is_no_number_or_has_no_end_is_black_or_white():
    light = np.full((20, 30, 3), np.inf, np.float16)
    light[:10] = np.nan
    image = PaperRgbNoise().apply(light, frame_generator(1, 1, 1))
    assert (image[:10] < 30).all() and (image[10:] == 255).all()


def test_the_gaussian_is_one():
    from scipy.stats import kstest

    samples = gaussian(frame_generator(1, 2, 1), (1000, 1000)).astype(float).ravel()
    assert abs(samples.mean()) < 0.004 and samples.std() == pytest.approx(1, abs=0.003)
    assert (samples**4).mean() == pytest.approx(3, abs=0.03)
    assert kstest(samples[:100_000], "norm").pvalue > 0.001
    assert abs(np.corrcoef(samples[:-1], samples[1:])[0, 1]) < 0.004


def test_streams_frames_and_seeds_are_independent():
    base = gaussian(frame_generator(1, 2, 0), (100_000,))
    for other in [(1, 2, 1), (1, 3, 0), (2, 2, 0), (2, 1, 0)]:
        assert abs(np.corrcoef(base, gaussian(frame_generator(*other), (100_000,)))[0, 1]) < 0.015


@pytest.mark.parametrize("light", [0.1, 0.3, 0.6])
def test_paper_noise_has_the_variance_of_its_line_before_the_transfer_function(light):
    model = PaperRgbNoise(sigma_c=0.004, sigma_s=0.03)
    noisy = model.noisy_light(_patch(light), frame_generator(1, 1, 1)).astype(float)
    assert noisy.var() == pytest.approx(0.004**2 + light * 0.03**2, rel=0.03)
    # and after it: times its slope squared, plus the rounding's 1/12
    values = model.apply(_patch(light), frame_generator(1, 1, 1)).astype(float)
    slope = (
        255
        * (srgb_from_light(np.array(light + 1e-4)) - srgb_from_light(np.array(light - 1e-4)))
        / 2e-4
    )
    assert values.var() == pytest.approx(slope**2 * noisy.var() + 1 / 12, rel=0.06)


def test_paper_noise_at_mid_grey_is_that_of_the_released_frames():
    values = (
        PaperRgbNoise()
        .apply(_patch(light_from_srgb(128 / 255)), frame_generator(1, 1, 1))
        .astype(float)
    )
    assert values.std() == pytest.approx(2.0, rel=0.06)


def test_paper_noise_at_black_is_about_one_step_of_8_bits():
    values = PaperRgbNoise().apply(_patch(0.0), frame_generator(1, 1, 1)).astype(float)
    assert values.std() == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("name", RGB_MODELS)
def test_every_model_shows_the_light_as_rendered(name):
    values = rgb_model(name).apply(_patch(0.2), frame_generator(1, 1, 1)).astype(float)
    assert values.mean() == pytest.approx(255 * srgb_from_light(np.array(0.2)), abs=0.7)


def test_exposure_multiplies_the_light_and_longer_exposure_means_less_noise_for_the_same_picture():
    light = _patch(0.1)
    assert np.array_equal(
        rgb_model("none", {"exposure": 2.0}).apply(light, frame_generator(0, 0, 1)),
        srgb8(light * 2),
    )
    noise = [
        PaperRgbNoise(exposure=e)
        .noisy_light(_patch(0.1 * e), frame_generator(0, 0, 1))
        .astype(float)
        .std()
        / e
        for e in (0.5, 1.0, 4.0)
    ]
    assert noise == sorted(noise, reverse=True)


@pytest.mark.parametrize("value", [40, 100, 180])
def test_released_noise_has_its_variances_correlation_and_truncation(value):
    light = _patch(light_from_srgb(value / 255), (400, 600, 3))
    error = ReleasedRgbNoise().apply(light, frame_generator(3, 1, 1)).astype(float) - value
    for k, (a, b) in enumerate(zip((1.48, 0.95, 1.61), (0.0266, 0.0105, 0.0246), strict=True)):
        channel = error[..., k]
        assert channel.mean() == pytest.approx(-0.5, abs=0.03)
        assert channel.var() == pytest.approx(a + b * value, rel=0.03)
        noise_share = 1 - 1 / 12 / channel.var()  # cutting adds uncorrelated 1/12
        for pixels, correlation in ((1, 0.6), (2, 0.2), (3, 0.0)):
            found = np.corrcoef(channel[:, :-pixels].ravel(), channel[:, pixels:].ravel())[0, 1]
            assert found == pytest.approx(correlation * noise_share, abs=0.015)
        assert abs(np.corrcoef(channel[:-1].ravel(), channel[1:].ravel())[0, 1]) < 0.015
    assert np.abs(np.corrcoef(error.reshape(-1, 3).T) - np.eye(3)).max() < 0.015


def test_black_and_white_stay_in_range_and_input_types_agree():
    for name in RGB_MODELS:
        model = rgb_model(name)
        assert model.apply(_patch(5.0), frame_generator(1, 1, 1)).max() == 255
        assert model.apply(_patch(0.0), frame_generator(1, 1, 1)).min() == 0
        half = np.random.default_rng(0).random((50, 60, 3)).astype(np.float16)
        a, b = (model.apply(x, frame_generator(1, 1, 1)) for x in (half, half.astype(np.float32)))
        assert np.array_equal(a, b)
        with pytest.raises(InputError, match="an image .h, w, 3."):
            model.apply(half[..., 0], frame_generator(1, 1, 1))


def test_correlations_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="three neighbouring pixels"):
        ReleasedRgbNoise(correlation_1px=0.95).neighbour_weights()
