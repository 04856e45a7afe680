"""Noise parameters of a real sensor, estimated from a static scene under several exposures and from
static walls.

This is the inverse of the models `paper`: from images made by these models, their sigmas are
estimated again.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .depth import KINECT_CM_PX
from .transfer import light_from_srgb
from .walls import fitted_plane, inverse_depth, mean_of_seen

#: Values closer than this to black or white may be clipped and are not used for response or noise.
_DARKEST = 6.0
_BRIGHTEST = 244.0
#: Side in pixels of blocks over which the noise of a depth sensor averages out.
_BLOCK = 16


@dataclass(frozen=True)
class RgbCalibration:
    """`response`: "linear", "srgb" or "gamma" (exponent `gamma`). `spreads`: for each response, the
    remaining difference between exposures, as a share of the light. sigma_c and sigma_s, as shares
    of white, are settings of the RGB model `paper`.
    """

    response: str
    gamma: float
    spreads: dict[str, float]
    sigma_c: float
    sigma_s: float


@dataclass(frozen=True)
class DepthCalibration:
    """sigma_d in disparity steps and sigma_s in pixels: the settings of the depth model `paper`.
    `fixed_sigma_s`: sigma_s was assumed, because walls of one slope do not determine both.
    """

    sigma_d: float
    sigma_s_px: float
    fixed_sigma_s: bool
    frames: int


def calibrate_rgb(exposures: Sequence[float], images: Sequence[np.ndarray]) -> RgbCalibration:
    """Estimate response and noise from `images[k]` (repeats, h, w, 3) uint8, taken at
    `exposures[k]` in any unit.

    Raises InputError for fewer than two exposures, fewer than two repeats, equal repeats, or no
    values between black and white.
    """
    gains = np.asarray(exposures, float)
    _check_series(gains, images)
    means = np.stack([stack.mean(0, dtype=np.float64).ravel() for stack in images])
    use = (means > _DARKEST) & (means < _BRIGHTEST)
    use &= use.sum(0) >= 2
    if not use.any():
        raise InputError(
            "pixels that are neither black nor white under two exposures", found="none"
        )
    if any(len({image.tobytes() for image in stack}) < len(stack) for stack in images):
        raise InputError(
            "images of an exposure that differ by their noise", found="the same image twice"
        )
    gamma = _gamma(gains, means, use)
    # v: share of white
    curves = {
        "linear": lambda v: v,
        "srgb": light_from_srgb,
        "gamma": lambda v: v**gamma,
    }
    spreads = {name: _spread(gains, curve(means / 255), use) for name, curve in curves.items()}
    # the free exponent can always fit a power law better: a named curve that is at most 5 % worse
    # is preferred
    named = min(("linear", "srgb"), key=spreads.__getitem__)
    best = "gamma" if spreads["gamma"] * 1.05 < spreads[named] else named
    light, variance = _noise_points(images, curves[best](np.arange(256.0) / 255))
    line = _line(light, variance, np.ones_like(light))
    for _ in range(4):
        line = _line(light, variance, 1 / np.maximum(line[0] + line[1] * light, 1e-12))
    sigma_c, sigma_s = np.sqrt(np.maximum(line, 0))
    return RgbCalibration(best, gamma, spreads, float(sigma_c), float(sigma_s))


def _check_series(gains: np.ndarray, images: Sequence[np.ndarray]) -> None:
    """Raises InputError unless there are two or more exposures with two or more images each."""
    if len(gains) < 2 or len(images) != len(gains) or not (np.isfinite(gains) & (gains > 0)).all():
        found = ", ".join(f"{gain:g}" for gain in gains)
        raise InputError(
            "two or more exposures, finite and > 0, with images each", found=found or "none"
        )
    if any(stack.ndim != 4 or len(stack) < 2 or stack.dtype != np.uint8 for stack in images):
        raise InputError("two or more 8-bit images of each exposure", found="fewer")


def calibrate_depth(walls: Sequence[np.ndarray], sigma_s_px: float = 0.5) -> DepthCalibration:
    """Estimate disparity noise and pixel shift from `walls[k]` (frames, h, w), planar metres of a
    static flat wall, 0 = missing.

    A plane is linear in disparity, so the residual is noise: variance = sigma_d^2 + sigma_s^2 g^2 +
    1/12, where g is the slope in steps per pixel and 1/12 is the variance of rounding. Walls with
    different slopes determine both sigmas; otherwise `sigma_s_px` is assumed. Raises InputError if
    less than a tenth of a wall was measured, or if it is not flat or moves.
    """
    rows = [_wall(np.asarray(wall, float), KINECT_CM_PX / 100) for wall in walls]
    slope2, variance = (np.array(column) for column in zip(*rows, strict=True))
    frames = sum(len(wall) for wall in walls)
    variance = variance - 1 / 12
    apart = len(rows) > 1 and slope2.max() > 4 * slope2.min() + 0.02
    if apart:
        sigma_d2, sigma_s2 = _line(slope2, variance, 1 / np.maximum(variance + 1 / 12, 1e-6))
    else:
        sigma_s2 = sigma_s_px**2
        sigma_d2 = float(np.mean(variance - sigma_s2 * slope2))
    sigma_d, sigma_s = (float(np.sqrt(max(value, 0))) for value in (sigma_d2, sigma_s2))
    return DepthCalibration(sigma_d, sigma_s, not apart, frames)


def _gamma(exposures: np.ndarray, means: np.ndarray, use: np.ndarray) -> float:
    """gamma of value = light^(1/gamma): the slope of log exposure over log value.

    Each pixel's mean is subtracted, then all are pooled.
    """
    weights = use.astype(float)
    log_v = np.log(np.where(use, means, 1))
    log_e = np.broadcast_to(np.log(exposures)[:, None], means.shape)
    count = np.maximum(weights.sum(0), 1)
    x, y = (values - (weights * values).sum(0) / count for values in (log_e, log_v))
    slope = (weights * x * y).sum() / (weights * x * x).sum()
    if not slope > 0.01:
        raise InputError(
            "images that get brighter with the exposure", found=f"a slope of {slope:.3g}"
        )
    return float(1 / slope)


def _spread(exposures: np.ndarray, light: np.ndarray, use: np.ndarray) -> float:
    """The relative difference of light / exposure of a pixel between exposures; 0 for the true
    response.
    """
    scene = np.where(use, light / exposures[:, None], np.nan)[:, use.any(0)]
    return float(np.mean(np.nanstd(scene, 0) / np.nanmean(scene, 0)))


def _noise_points(
    images: Sequence[np.ndarray], light_of_value: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean light and variance over repeats, for groups of pixels of similar light.

    The variance of rounding to 8 bits is subtracted.
    """
    step = np.gradient(light_of_value)
    lights = []
    variances = []
    for stack in images:
        mean_value = stack.mean(0, dtype=np.float64)
        use = (mean_value > _DARKEST) & (mean_value < _BRIGHTEST)
        samples = light_of_value[stack][:, use]
        lights.append(samples.mean(0))
        variances.append(
            samples.var(0, ddof=1) - np.interp(mean_value[use], np.arange(256), step) ** 2 / 12
        )
    light = np.concatenate(lights)
    variance = np.concatenate(variances)
    groups = np.array_split(np.argsort(light), min(60, max(2, len(light) // 50)))
    light, variance = (np.array([values[g].mean() for g in groups]) for values in (light, variance))
    # closer to black or white than this, clipping reduces the variance
    whole = np.minimum(light, 1 - light) > 3.5 * np.sqrt(np.maximum(variance, 0))
    if whole.sum() < 2:
        raise InputError(
            "pixels well between black and white, of two brightnesses",
            found=f"{whole.sum()} groups",
        )
    return light[whole], variance[whole]


def _line(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(2,): a and b of y = a + b x by weighted least squares."""
    design = np.column_stack([np.ones_like(x), x])
    return np.linalg.lstsq(design * weights[:, None], y * weights, rcond=None)[0]


def _wall(depth_z_m: np.ndarray, disparity_m: float) -> tuple[float, float]:
    """(squared slope in (steps per pixel)^2, variance around the plane in steps^2) of one wall."""
    disparity = disparity_m * inverse_depth(depth_z_m)
    fitted, flat = fitted_plane(*mean_of_seen(disparity), rounding=0.5)
    used = (depth_z_m > 0) & flat
    error = (disparity - fitted)[used]
    _refuse_relief(np.where(used, disparity - fitted, np.nan), float(np.var(error)))
    right, down = fitted[0, 1] - fitted[0, 0], fitted[1, 0] - fitted[0, 0]
    return float(right**2 + down**2), float(np.mean(error**2) - np.mean(error) ** 2)


def _refuse_relief(error: np.ndarray, variance: float) -> None:
    """Raises InputError if more than half of the variance of `error` (frames, h, w), NaN where not
    measured, is common to whole blocks of pixels.

    A sensor's noise is independent over such distances. A surface that is not flat, or that moves,
    is not. Rounding may be common, too.
    """
    high = error.shape[1] // _BLOCK
    wide = error.shape[2] // _BLOCK
    blocks = error[:, : high * _BLOCK, : wide * _BLOCK]
    blocks = blocks.reshape(len(error), high, _BLOCK, wide, _BLOCK)
    known = np.isfinite(blocks).mean((2, 4)) > 0.5
    if known.sum() < 4:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # blocks without any measurement
        common = float(np.var(np.nanmean(blocks, (2, 4))[known]))
    if common - 1 / 12 > variance / 2:
        blocks_px = f"blocks of {_BLOCK} x {_BLOCK} pixels"
        found = f"deviations of {common**0.5:.2g} disparity steps over {blocks_px}"
        raise InputError("a flat wall in front of a camera that does not move", found=found)
