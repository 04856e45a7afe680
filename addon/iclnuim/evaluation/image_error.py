"""Image error: PSNR and SSIM, the measures for views rendered by mapping systems."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ..errors import InputError
from ..settings import Settings, setting

_GAUSSIAN = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
#: Weights of a window along each axis, and the factor from population variance to sample variance.
_WINDOWS = MappingProxyType(
    {"gaussian": (_GAUSSIAN / _GAUSSIAN.sum(), 1.0), "uniform": (np.full(7, 1 / 7), 49 / 48)}
)
#: K1 and K2 of SSIM.
_K1 = 0.01
_K2 = 0.03
#: White of 8-bit images.
_WHITE = 255.0


@dataclass(frozen=True)
class ViewSettings(Settings):
    """Measurement of rendered views."""

    group: ClassVar[str] = "rendered views"

    ssim_window: str = setting(
        "gaussian",
        "window of SSIM",
        choices={"gaussian": "11 x 11, sigma 1.5", "uniform": "7 x 7, scikit-image's default"},
        source="Wang et al., TIP 2004",
    )
    lpips: bool = setting(
        True, "also LPIPS (AlexNet), if the packages lpips and torch are installed", label="LPIPS"
    )


def psnr_db(image: np.ndarray, truth: np.ndarray) -> float:
    """Peak signal-to-noise ratio of 8-bit images (h, w) or (h, w, 3), in dB, over all pixels and
    channels; inf if they are equal.

    Raises InputError for images of different size, or that are not uint8.
    """
    image, truth = _both(image, truth)
    squared = float(((image - truth) ** 2).mean())
    return 10 * float(np.log10(_WHITE**2 / squared)) if squared else float("inf")


def ssim(image: np.ndarray, truth: np.ndarray, window: str = "gaussian") -> float:
    """Mean structural similarity of 8-bit images (h, w) or (h, w, 3), averaged over the channels; 1
    if they are equal.

    Wang et al., IEEE Transactions on Image Processing 13(4), 2004, equation 13. window: `gaussian`,
    the authors' (11 x 11, sigma 1.5, population variance), or `uniform`, 7 x 7 with sample
    variance. Windows that are not inside the image are not used. The results equal scikit-image's
    structural_similarity: with gaussian_weights=True, sigma=1.5, use_sample_covariance=False, or
    with its defaults. Raises InputError for images of different size or smaller than the window, or
    that are not uint8.
    """
    image, truth = _both(image, truth)
    weights, sample = _WINDOWS[window]
    if min(image.shape[:2]) < len(weights):
        raise InputError(f"images of at least {len(weights)} pixels a side", found=image.shape[:2])
    x = _weighted(image, weights)
    y = _weighted(truth, weights)
    xx = sample * (_weighted(image * image, weights) - x * x)
    yy = sample * (_weighted(truth * truth, weights) - y * y)
    xy = sample * (_weighted(image * truth, weights) - x * y)
    c1 = (_K1 * _WHITE) ** 2
    c2 = (_K2 * _WHITE) ** 2
    similar = (2 * x * y + c1) * (2 * xy + c2)
    return float((similar / ((x * x + y * y + c1) * (xx + yy + c2))).mean())


def _both(image: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    image = np.asarray(image)
    truth = np.asarray(truth)
    if not truth.size or truth.ndim not in (2, 3):
        raise InputError("images (h, w) or (h, w, 3)", found=truth.shape)
    if image.shape != truth.shape:
        raise InputError(f"images of one size, {truth.shape}", found=image.shape)
    if other := next((i.dtype for i in (image, truth) if i.dtype != np.uint8), None):
        raise InputError(
            "8-bit images (uint8)",
            found=other,
            hint="np.rint(255 * image).astype(np.uint8) for values of 0..1",
        )
    return image.astype(float), truth.astype(float)


def _weighted(image: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted means over the windows inside the image."""
    for axis in (0, 1):
        count = image.shape[axis] - len(weights) + 1
        moved = image.swapaxes(0, axis)
        image = sum(w * moved[k : k + count] for k, w in enumerate(weights)).swapaxes(0, axis)
    return image
