"""Perturbations of the images.

Each function takes a segment, a level in the unit given in perturbations.toml, and fixed settings
by keyword.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from iclnuim.sensor.depth import ReleasedDepthNoise
from iclnuim.sensor.noise_model import DEPTH, RGB, gaussian
from iclnuim.sensor.rgb import PaperRgbNoise, ReleasedRgbNoise
from iclnuim.sensor.transfer import light_from_srgb8, srgb8

from .segment import Images, Segment


def flat_texture(segment: Segment, removed_percent: float) -> Segment:
    """Colour is moved towards the mean of its image."""
    kept = 1 - removed_percent / 100

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        mean = colour.mean((0, 1))
        return _bytes(mean + kept * (colour - mean)), depth_z_m

    return segment.with_images(change)


def holes(segment: Segment, percent: float, size_px: float) -> Segment:
    """Depth is missing in patches of about size_px that cover this share of the image; each frame
    has other patches.
    """

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        h, w = depth_z_m.shape
        coarse = gaussian(segment.generator(number), (int(h // size_px) + 3, int(w // size_px) + 3))
        field = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
        return colour, np.where(field > np.percentile(field, percent), depth_z_m, np.float32(0))

    return segment.with_images(change)


def range_cut(segment: Segment, max_m: float) -> Segment:
    """No depth beyond max_m."""
    return segment.with_images(
        lambda number, colour, z: (colour, np.where(z <= max_m, z, np.float32(0)))
    )


def noise(segment: Segment, factor: float) -> Segment:
    """The noise model `released` for depth and colour, with its standard deviations and offsets
    multiplied by `factor`.
    """
    depth, rgb = ReleasedDepthNoise(), ReleasedRgbNoise()
    scaled = {
        name: factor * getattr(depth, name)
        for name in ("sigma_s_px", "offset_px", "sigma_d", "disparity_bias")
    }
    depth = replace(depth, **scaled)
    r, g, b = (factor**2 * v for v in rgb.variance)
    red, green, blue = (factor**2 * v for v in rgb.variance_per_value)
    rgb = replace(rgb, variance=(r, g, b), variance_per_value=(red, green, blue))

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        noisy_m = depth.apply(depth_z_m, segment.true_camera, segment.generator(number, DEPTH))
        return rgb.apply(light_from_srgb8(colour), segment.generator(number, RGB)), noisy_m

    return segment.with_images(change)


def low_light(segment: Segment, stops: float) -> Segment:
    """Radiance halved `stops` times, with the read and shot noise of the model `paper`; depth is
    unchanged.
    """
    rgb = PaperRgbNoise(exposure=2.0**-stops)
    return segment.with_images(
        lambda number, colour, z: (
            rgb.apply(light_from_srgb8(colour), segment.generator(number, RGB)),
            z,
        )
    )


def exposure_steps(segment: Segment, stops: float, every: float) -> Segment:
    """Exposure changes by this number of stops, alternately down and up, every `every` frames."""
    return _gained(segment, lambda number: -stops * (number // int(every) % 2))


def exposure_hunting(segment: Segment, stops: float, hz: float) -> Segment:
    """An oscillating automatic exposure: it swings by this number of stops up and down, `hz` times
    per second.
    """
    return _gained(
        segment, lambda number: stops * float(np.sin(2 * np.pi * hz * segment.stamps_s[number]))
    )


def _gained(segment: Segment, stops_of: Callable[[int], float]) -> Segment:
    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        return srgb8(light_from_srgb8(colour) * np.float32(2.0 ** stops_of(number))), depth_z_m

    return segment.with_images(change)


def gamma_steps(segment: Segment, gamma: float, every: float) -> Segment:
    """Values are raised to the power `gamma` and unchanged alternately, for `every` frames each."""
    table = _bytes(255 * (np.arange(256) / 255) ** gamma)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        return table[colour] if number // int(every) % 2 else colour, depth_z_m

    return segment.with_images(change)


def black_frames(segment: Segment, percent: float) -> Segment:
    """Some frames, never the first, have black colour and no depth."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        black = number != segment.numbers[0] and segment.generator(number).random() < percent / 100
        return (np.zeros_like(colour), np.zeros_like(depth_z_m)) if black else (colour, depth_z_m)

    return segment.with_images(change)


def misregistered(segment: Segment, shift_px: float) -> Segment:
    """Depth is shifted by this number of pixels to the right of its colour."""
    by = int(shift_px)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        moved = np.zeros_like(depth_z_m)
        moved[:, by:] = depth_z_m[:, : depth_z_m.shape[1] - by]
        return colour, moved

    return segment.with_images(change)


def calibration_off(segment: Segment, percent: float) -> Segment:
    """The camera given to the method has focal lengths and a principal point that are too large by
    this percentage.
    """
    c, factor = segment.camera, 1 + percent / 100
    values = {name: factor * getattr(c, name) for name in ("fx", "fy", "cx", "cy")}
    return replace(segment, camera=replace(c, **values))


def guess_off(segment: Segment, degrees: float) -> Segment:
    """The initial guess of each alignment is rotated by this angle."""
    return replace(segment, guess_off_deg=degrees)


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)
