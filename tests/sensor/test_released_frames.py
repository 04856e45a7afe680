"""The models `released` against the official noisy office frames, run on the official clean ones."""

import numpy as np
import pytest
from iclnuim.formats.png import read_depth16, read_rgb8
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.models import depth_model, rgb_model
from iclnuim.sensor.noise_model import frame_generator
from iclnuim.sensor.transfer import linear_from_srgb8

FRAMES = (30, 60, 104)


@pytest.fixture(scope="module")
def depths(samples):
    """(clean, official noisy, ours) in metres, (3, 480, 640) each."""
    clean, official = (
        np.array(
            [read_depth16(samples / "or_kt3" / kind / "depth" / f"{i}.png") / 5000 for i in FRAMES]
        )
        for kind in ("clean", "noisy")
    )
    model = depth_model("released")
    ours = [
        model.apply(z, PinholeCamera(), frame_generator(1, i, 0))
        for i, z in zip(FRAMES, clean, strict=True)
    ]
    return clean, official, np.array(ours, float)


def _figures(clean, noisy):
    """Shares in percent, errors in metres over |error| < 0.05 Z, disparity in steps."""
    error = noisy - clean
    near = np.abs(error) < 0.05 * clean
    disparity = 351.3 / noisy[near] - 351.3 / clean[near]
    return {
        "missing": 100 * (noisy < 0.6 * clean).mean(),
        "zero": 100 * (noisy == 0).mean(),
        "mean": error[near].mean(),
        "rms": np.sqrt((error[near] ** 2).mean()),
        "disparity std": disparity.std(),
    }


def test_depth_statistics_are_those_of_the_official_frames(depths):
    clean, official, ours = depths
    theirs, found = _figures(clean, official), _figures(clean, ours)
    assert found["missing"] == pytest.approx(theirs["missing"], abs=0.5)
    assert found["zero"] == pytest.approx(theirs["zero"], abs=0.3)
    assert found["mean"] == pytest.approx(theirs["mean"], abs=1.5e-3)
    assert found["rms"] == pytest.approx(theirs["rms"], rel=0.04)
    assert found["disparity std"] == pytest.approx(theirs["disparity std"], rel=0.03)


def test_errors_over_a_twentieth_of_z_are_those_that_the_page_states(depths, repository):
    """A few pixels at edges decide the figures of all pixels: docs/measured/sensor.md has both."""
    page = (repository / "docs/measured/sensor.md").read_text()
    clean, *noisy = depths
    official, ours = (_figures_of_all(clean, depth_z_m) for depth_z_m in noisy)
    assert ours["rms"] == pytest.approx(official["rms"], rel=0.15)
    assert ours["mean"] == pytest.approx(official["mean"], rel=0.15)
    for name, digits in (("rms", 0), ("mean", 1)):
        stated = [f"{1000 * found[name]:.{digits}f} mm" for found in (ours, official)]
        assert " for ".join(stated) in page


def _figures_of_all(clean, noisy):
    error = (noisy - clean)[(noisy > 0) & (clean > 0)]
    return {"mean": error.mean(), "rms": np.sqrt((error**2).mean())}


@pytest.fixture(scope="module")
def colours(samples):
    """(clean, official noisy, ours), (3, 480, 640, 3) each."""
    clean, official = (
        np.array([read_rgb8(samples / "or_kt3" / kind / "rgb" / f"{i}.png") for i in FRAMES])
        for kind in ("clean", "noisy")
    )
    model = rgb_model("released")
    ours = [
        model.apply(linear_from_srgb8(c), frame_generator(1, i, 1))
        for i, c in zip(FRAMES, clean, strict=True)
    ]
    return clean.astype(float), official.astype(float), np.array(ours, float)


def test_rgb_variance_is_that_of_the_official_frames(colours):
    clean, official, ours = colours
    for k in range(3):
        theirs, found = (
            np.mean(
                [
                    (noisy - clean)[..., k][np.abs(clean[..., k] - value) <= 3].var()
                    for value in (50, 100, 150)
                ]
            )
            for noisy in (official, ours)
        )
        assert found == pytest.approx(theirs, rel=0.15), "RGB"[k]


def test_rgb_correlation_of_neighbours_is_that_of_the_official_frames(colours):
    clean, official, ours = colours
    for k in range(3):
        plain = (clean[..., k] > 20) & (clean[..., k] < 235)
        smooth = plain[..., 1:] & plain[..., :-1] & (np.abs(np.diff(clean[..., k], axis=2)) < 3)
        theirs, found = (
            np.corrcoef((noisy - clean)[..., 1:, k][smooth], (noisy - clean)[..., :-1, k][smooth])[
                0, 1
            ]
            for noisy in (official, ours)
        )
        assert found == pytest.approx(theirs, abs=0.08), "RGB"[k]
