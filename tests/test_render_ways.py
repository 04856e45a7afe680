"""The error of path tracing from images with few samples, and the way to light a run that is chosen."""

import math

import numpy as np
import pytest
from iclnuim import render_ways
from iclnuim.errors import InputError
from iclnuim.job import RenderJob
from iclnuim.render_ways import Convergence, Quality, Way, chosen


@pytest.mark.parametrize("scale", [8.0, 20.0, 60.0])
def test_the_error_of_independent_samples_is_predicted_from_their_means(scale):
    """Means of the first 4, 16 and 64 of the same samples, around a known image."""
    rng = np.random.default_rng(3)
    means = {n: np.zeros(20000) for n in (4, 16, 64, 256)}
    total = np.zeros(20000)
    for n in range(1, 257):
        total += rng.normal(0, scale, 20000)
        if n in means:
            means[n] = total / n
    found = compared(means)
    for n in (4, 16, 64, 256):
        true = render_ways.psnr_db(render_ways.square(means[n], np.zeros(20000)))
        assert found.psnr_db(n) == pytest.approx(true, abs=0.5)


@pytest.mark.parametrize(("power", "off_db"), [(0.25, 0.01), (0.3, 3)])
def test_an_error_that_decreases_everywhere_by_the_same_factor_is_predicted(power, off_db):
    """As that of a blur which becomes narrower: much larger than the differences. One that
    decreases faster than by half seems larger.
    """
    blur = np.random.default_rng(4).normal(0, 60, 20000)
    images = {n: blur * n**-power for n in (4, 16, 64, 256)}
    found = compared(images, denoised=True)
    for n in (4, 16, 64, 256):
        true = render_ways.psnr_db(render_ways.square(images[n], np.zeros(20000)))
        assert true - off_db < found.psnr_db(n) < true + 0.01


def test_a_few_bright_pixels_of_the_last_image_do_not_decide_how_the_error_decreases():
    """A light that more samples find by chance makes the second difference as large as the first."""
    rng = np.random.default_rng(5)
    noise = {n: rng.normal(0, 20 * n**-0.25, 20000) for n in (4, 16, 64)}
    plain_db = compared(noise, denoised=True).psnr_db(16)
    noise[64][:40] += 150
    assert compared(noise, denoised=True).psnr_db(16) > plain_db - 2


def compared(images, denoised=False):
    return Convergence.of([images[n] for n in (4, 16, 64)], (4, 16, 64), denoised)


@pytest.mark.parametrize("levels", [(0, 3, 5), (0, 3, 3.1), (0, 2, 5), (0, 0, 0), (0, 100, 200)])
def test_more_samples_are_never_worse(levels):
    """Also where the images hardly differ, or differ more with more samples."""
    images = [np.full((2, 2), level, float) for level in levels]
    found = Convergence.of(images, (1, 4, 16), denoised=True)
    errors = [found.psnr_db(n) for n in render_ways.PATH_SAMPLES]
    assert all(math.isfinite(one) for one in errors)
    assert all(a <= b for a, b in zip(errors, errors[1:], strict=False))


def test_a_finer_light_map_has_a_smaller_error():
    assert render_ways.map_psnr_db(0.01) > render_ways.map_psnr_db(0.1)


def ways(*rows):
    """(samples, core-seconds, dB) of each; two cores."""
    return [Way("path", n, None, core_s, core_s / 2, db) for n, core_s, db in rows]


def test_the_cheapest_way_that_holds_a_psnr_is_chosen():
    given = ways((4, 10, 38), (16, 30, 43), (64, 100, 47))
    assert chosen(given, Quality.of("40dB")).samples == 16
    assert chosen(given, Quality.of("38dB")).samples == 4
    assert chosen(given, Quality.of("60dB")).samples == 64, "none holds it: the best"


def test_the_best_way_within_a_time_is_chosen():
    given = ways((4, 10, 38), (16, 30, 43), (64, 100, 47))
    assert chosen(given, Quality.of("20s")).samples == 16
    assert chosen(given, Quality.of("2min")).samples == 64
    assert chosen(given, Quality.of("1s")).samples == 4, "none is so fast: the fastest"


def test_a_light_map_is_chosen_where_it_is_cheaper_and_holds():
    baked = Way("baked", 1, 512, 20, 10, 41, bake_s=8)
    given = [*ways((4, 10, 38), (16, 30, 43)), baked]
    assert chosen(given, Quality.of("40dB")) == baked
    assert chosen(given, Quality.of("42dB")).samples == 16
    assert baked.settings == {"light": "baked", "samples": 1, "map_size": 512}


@pytest.mark.parametrize(
    "text", ["", "40", "dB", "0dB", "-3dB", "ten min", "10 m", "1e3s", "nandB"]
)
def test_a_quality_that_is_neither_a_psnr_nor_a_time_is_refused(text):
    with pytest.raises(InputError, match="a PSNR such as 40dB, or a time such as 90s") as error:
        RenderJob("a", "room.blend", "kt2", quality=text)
    assert error.value.setting == "quality"


def test_only_a_quality_that_was_asked_for_is_in_a_recipe():
    plain = RenderJob("a", "room.blend", "kt2")
    assert "quality" not in plain.to_dict()
    asked = plain.changed(quality="10min")
    assert asked.to_dict()["quality"] == "10min"
    assert RenderJob.from_dict(asked.to_dict()) == asked
