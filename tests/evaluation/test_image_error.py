"""PSNR and SSIM against scikit-image: by figures that it gave, and, where it is installed, by
itself.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.image_error import psnr_db, ssim
from judges import judge_module

#: height, width, standard deviation of the noise -> scikit-image 0.26: SSIM by default, SSIM of
#: Wang et al., PSNR in dB
MEASURED = {
    (48, 64, 5): (0.8838612463592753, 0.8459340661506386, 34.16552594980252),
    (11, 11, 20): (0.8945181487638516, 0.8237468193818022, 22.570670872409863),
}


def images(height, width, sigma, rng):
    """A ramp and the same with noise, (h, w, 3) uint8."""
    v, u = np.mgrid[0:height, 0:width]
    ramp = np.stack([u * 255 / width, v * 255 / height, (u + v) * 255 / (width + height)], -1)
    return ramp.astype(np.uint8), (ramp + rng.normal(size=ramp.shape) * sigma).clip(0, 255).astype(
        np.uint8
    )


def test_figures_are_those_of_scikit_image():
    rng = np.random.default_rng(0)
    made = {size: images(*size, rng) for size in ((48, 64, 5), (48, 64, 40), (11, 11, 20))}
    for size, (uniform, gaussian, psnr) in MEASURED.items():
        truth, image = made[size]
        found = ssim(truth, image, "uniform"), ssim(truth, image), psnr_db(truth, image)
        assert found == pytest.approx((uniform, gaussian, psnr), abs=1e-9)


def test_any_images_agree_with_scikit_image():
    metrics = judge_module("skimage.metrics", "scikit-image")
    wang = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    rng = np.random.default_rng(1)
    for size in ((61, 13, 100), (11, 40, 2), (120, 160, 30)):
        colour = images(*size, rng)
        for (truth, image), axis in ((colour, -1), ([one[..., 1] for one in colour], None)):
            expected = metrics.structural_similarity(truth, image, channel_axis=axis)
            assert ssim(image, truth, "uniform") == pytest.approx(expected, abs=1e-6)
            expected = metrics.structural_similarity(truth, image, channel_axis=axis, **wang)
            assert ssim(image, truth) == pytest.approx(expected, abs=1e-6)
            expected = metrics.peak_signal_noise_ratio(truth, image, data_range=255)
            assert psnr_db(image, truth) == pytest.approx(expected, abs=1e-6)


def test_equal_images_have_no_error_and_others_are_refused():
    truth, _ = images(12, 12, 0, np.random.default_rng(0))
    assert psnr_db(truth, truth) == np.inf and ssim(truth, truth) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(InputError, match="images of one size"):
        psnr_db(truth, truth[:, 1:])
    with pytest.raises(InputError, match="at least 11 pixels a side"):
        ssim(truth[:10], truth[:10])
    for other in (truth[:0], truth[0, 0], truth[None, None], np.uint8(3)):
        for error in (psnr_db, ssim):
            with pytest.raises(
                InputError, match=r"expected images \(h, w\) or \(h, w, 3\), found \("
            ):
                error(other, other)
    for other in (truth.tolist(), truth / 255, truth.astype(np.uint16), truth > 9):
        for error in (psnr_db, ssim):
            with pytest.raises(InputError, match=r"expected 8-bit images \(uint8\)"):
                error(truth, other)
