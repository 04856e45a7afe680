"""Changes of the images alone. Each function takes a stretch, a level in the unit that perturbations.toml names, and fixed settings by keyword."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from iclnuim.sensor.depth import ReleasedDepthNoise
from iclnuim.sensor.noise_model import DEPTH, RGB, gaussian
from iclnuim.sensor.rgb import PaperRgbNoise, ReleasedRgbNoise
from iclnuim.sensor.transfer import light_from_srgb8, srgb8

from .stretch import Images, Stretch


def flat_texture(stretch: Stretch, removed_percent: float) -> Stretch:
    """Colour moves towards the mean of its image."""
    kept = 1 - removed_percent / 100

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        mean = colour.mean((0, 1))
        return _bytes(mean + kept * (colour - mean)), depth_z_m

    return stretch.with_images(change)


def holes(stretch: Stretch, percent: float, size_px: float) -> Stretch:
    """Depth is missing in patches, of about size_px and others in each frame, that cover this share of the image."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        h, w = depth_z_m.shape
        coarse = gaussian(stretch.generator(number), (int(h // size_px) + 3, int(w // size_px) + 3))
        field = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
        return colour, np.where(field > np.percentile(field, percent), depth_z_m, np.float32(0))

    return stretch.with_images(change)


def range_cut(stretch: Stretch, max_m: float) -> Stretch:
    """No depth beyond max_m."""
    return stretch.with_images(lambda number, colour, z: (colour, np.where(z <= max_m, z, np.float32(0))))


def noise(stretch: Stretch, factor: float) -> Stretch:
    """The model `released`, of depth and colour, its standard deviations and offsets times `factor`."""
    depth, rgb = ReleasedDepthNoise(), ReleasedRgbNoise()
    scaled = {name: factor * getattr(depth, name) for name in ("sigma_s_px", "offset_px", "sigma_d", "disparity_bias")}
    depth = replace(depth, **scaled)
    r, g, b = (factor**2 * v for v in rgb.variance)
    red, green, blue = (factor**2 * v for v in rgb.variance_per_value)
    rgb = replace(rgb, variance=(r, g, b), variance_per_value=(red, green, blue))

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        noisy_m = depth.apply(depth_z_m, stretch.true_camera, stretch.generator(number, DEPTH))
        return rgb.apply(light_from_srgb8(colour), stretch.generator(number, RGB)), noisy_m

    return stretch.with_images(change)


def low_light(stretch: Stretch, stops: float) -> Stretch:
    """Light halved `stops` times, with the read and shot noise of the model `paper`; depth as it was."""
    rgb = PaperRgbNoise(exposure=2.0**-stops)
    return stretch.with_images(
        lambda number, colour, z: (rgb.apply(light_from_srgb8(colour), stretch.generator(number, RGB)), z)
    )


def exposure_steps(stretch: Stretch, stops: float, every: float) -> Stretch:
    """Light changes by so many stops, down and up in turn, `every` frames."""
    return _gained(stretch, lambda number: -stops * (number // int(every) % 2))


def exposure_hunting(stretch: Stretch, stops: float, hz: float) -> Stretch:
    """An automatic exposure that overshoots: light swings by so many stops up and down, `hz` times a second."""
    return _gained(stretch, lambda number: stops * float(np.sin(2 * np.pi * hz * stretch.stamps_s[number])))


def _gained(stretch: Stretch, stops_of: Callable[[int], float]) -> Stretch:
    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        return srgb8(light_from_srgb8(colour) * np.float32(2.0 ** stops_of(number))), depth_z_m

    return stretch.with_images(change)


def gamma_steps(stretch: Stretch, gamma: float, every: float) -> Stretch:
    """Values to the power `gamma` and as they were in turn, `every` frames."""
    table = _bytes(255 * (np.arange(256) / 255) ** gamma)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        return table[colour] if number // int(every) % 2 else colour, depth_z_m

    return stretch.with_images(change)


def black_frames(stretch: Stretch, percent: float) -> Stretch:
    """Frames, the first never, whose colour is black and whose depth is missing."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        black = number != stretch.numbers[0] and stretch.generator(number).random() < percent / 100
        return (np.zeros_like(colour), np.zeros_like(depth_z_m)) if black else (colour, depth_z_m)

    return stretch.with_images(change)


def misregistered(stretch: Stretch, shift_px: float) -> Stretch:
    """Depth lies so many pixels to the right of its colour."""
    by = int(shift_px)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        moved = np.zeros_like(depth_z_m)
        moved[:, by:] = depth_z_m[:, : depth_z_m.shape[1] - by]
        return colour, moved

    return stretch.with_images(change)


def calibration_off(stretch: Stretch, percent: float) -> Stretch:
    """The method is told focal lengths that are too long, and a centre too far to the right and down, by this share of themselves."""
    c, factor = stretch.camera, 1 + percent / 100
    values = {name: factor * getattr(c, name) for name in ("fx", "fy", "cx", "cy")}
    return replace(stretch, camera=replace(c, **values))


def guess_off(stretch: Stretch, degrees: float) -> Stretch:
    """Each alignment starts so many degrees off what it would have started from."""
    return replace(stretch, guess_off_deg=degrees)


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)
