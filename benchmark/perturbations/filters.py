"""Perturbations of the images, of the camera given to the method and of its initial guess.

Each function takes a segment, a level in the unit given in perturbations.toml, and fixed settings
by keyword. `jpeg_compression`, `pixelate` and the two blurs are corruptions of D. Hendrycks and
T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, with the severities of X. Xu and others, "Customizable perturbation synthesis for robust
SLAM benchmarking" (2024), from which `depth_edge_erosion` is.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from iclnuim.sensor.depth import ReleasedDepthNoise
from iclnuim.sensor.noise_model import DEPTH, RGB, gaussian
from iclnuim.sensor.rgb import PaperRgbNoise, ReleasedRgbNoise
from iclnuim.sensor.transfer import linear_from_srgb8, srgb8

from .registry import perturbation
from .segment import Images, Segment


@perturbation
def flat_texture(segment: Segment, removed_percent: float) -> Segment:
    """Colour is moved towards the mean of its image."""
    kept = 1 - removed_percent / 100

    def change(number: int, colour: np.ndarray) -> np.ndarray:
        mean = colour.mean((0, 1))
        return _bytes(mean + kept * (colour - mean))

    return segment.with_colour(change)


@perturbation
def holes(segment: Segment, percent: float, size_px: float) -> Segment:
    """Depth is missing in patches of about size_px that cover this share of the image; each frame
    has other patches.
    """

    def change(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        field = random_field(segment, number, size_px)
        return np.where(field > np.percentile(field, percent), depth_z_m, np.float32(0))

    return segment.with_depth(change)


@perturbation
def range_cut(segment: Segment, max_m: float) -> Segment:
    """No depth beyond max_m."""
    return segment.with_depth(lambda number, z: np.where(z <= max_m, z, np.float32(0)))


@perturbation
def depth_edge_erosion(segment: Segment, share: float, reach_px: float) -> Segment:
    """Depth is missing at edges, and in squares up to reach_px around a share of the edge pixels.
    Edges are Canny's in the depth image as 256 grey values, with the thresholds of Xu and others.
    """
    side = 2 * int(reach_px) + 1

    def change(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        grey = cv2.normalize(depth_z_m, np.empty_like(depth_z_m), 0, 255, cv2.NORM_MINMAX)
        edges = np.asarray(cv2.Canny(np.asarray(grey).astype(np.uint8), 20, 50)) > 0
        chosen = edges & (segment.generator(number).random(edges.shape) < share)
        squares = cv2.dilate(chosen.astype(np.uint8), np.ones((side, side), np.uint8))
        return np.where(edges | (np.asarray(squares) > 0), np.float32(0), depth_z_m)

    return segment.with_depth(change)


@perturbation
def noise(segment: Segment, factor: float) -> Segment:
    """The noise model `released` for depth and colour, with its standard deviations and offsets
    multiplied by `factor`.
    """
    depth = ReleasedDepthNoise()
    depth = replace(
        depth,
        sigma_s_px=factor * depth.sigma_s_px,
        offset_px=factor * depth.offset_px,
        sigma_d=factor * depth.sigma_d,
        disparity_bias=factor * depth.disparity_bias,
    )
    rgb = ReleasedRgbNoise()
    r, g, b = factor**2 * np.array(rgb.variance)
    red, green, blue = factor**2 * np.array(rgb.variance_per_value)
    rgb = replace(rgb, variance=(r, g, b), variance_per_value=(red, green, blue))

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        noisy_m = depth.apply(depth_z_m, segment.true_camera, segment.generator(number, DEPTH))
        return rgb.apply(linear_from_srgb8(colour), segment.generator(number, RGB)), noisy_m

    return segment.with_images(change)


@perturbation
def low_light(segment: Segment, stops: float) -> Segment:
    """Radiance halved `stops` times, with the read and shot noise of the model `paper`; depth is
    unchanged.
    """
    rgb = PaperRgbNoise(exposure=2.0**-stops)

    def change(number: int, colour: np.ndarray) -> np.ndarray:
        return rgb.apply(linear_from_srgb8(colour), segment.generator(number, RGB))

    return segment.with_colour(change)


@perturbation
def exposure_steps(segment: Segment, stops: float, every: float) -> Segment:
    """Exposure changes by this number of stops, alternately down and up, every `every` frames."""
    return _exposed(segment, lambda number: -stops * (number // int(every) % 2))


@perturbation
def exposure_hunting(segment: Segment, stops: float, hz: float) -> Segment:
    """An oscillating automatic exposure: it swings by this number of stops up and down, `hz` times
    per second.
    """

    def stops_of(number: int) -> float:
        return stops * float(np.sin(2 * np.pi * hz * segment.stamps_s[number]))

    return _exposed(segment, stops_of)


def _exposed(segment: Segment, stops_of: Callable[[int], float]) -> Segment:
    def change(number: int, colour: np.ndarray) -> np.ndarray:
        return srgb8(linear_from_srgb8(colour) * np.float32(2.0 ** stops_of(number)))

    return segment.with_colour(change)


@perturbation
def gamma_steps(segment: Segment, gamma: float, every: float) -> Segment:
    """Values are raised to the power `gamma` and unchanged alternately, for `every` frames each."""
    table = _bytes(255 * (np.arange(256) / 255) ** gamma)

    def change(number: int, colour: np.ndarray) -> np.ndarray:
        return table[colour] if number // int(every) % 2 else colour

    return segment.with_colour(change)


@perturbation
def gaussian_blur(segment: Segment, sigma_px: float) -> Segment:
    """Gaussian blur of colour."""
    return _filtered(segment, lambda x: cv2.GaussianBlur(x, (0, 0), sigma_px))


@perturbation
def defocus_blur(segment: Segment, radius_px: float, smooth_px: float) -> Segment:
    """Mean of colour over a disc with a smoothed edge."""
    reach = max(8, int(radius_px))
    u = np.arange(-reach, reach + 1)
    disc = (u**2 + u[:, None] ** 2 <= radius_px**2).astype(np.float32)
    side = 3 if radius_px <= 8 else 5
    disc = cv2.GaussianBlur(disc / disc.sum(), (side, side), smooth_px)
    return _filtered(segment, lambda x: cv2.filter2D(x, -1, disc))


@perturbation
def pixelate(segment: Segment, share: float) -> Segment:
    """Colour reduced to this share of its size and enlarged again."""

    def change(x: np.ndarray) -> np.ndarray:
        h, w = x.shape[:2]
        small = cv2.resize(x, (int(w * share), int(h * share)), interpolation=cv2.INTER_AREA)
        return cv2.resize(small, (w, h), interpolation=cv2.INTER_NEAREST)

    return _filtered(segment, change)


def _filtered(segment: Segment, change: Callable[[np.ndarray], np.ndarray]) -> Segment:
    """The segment with filtered colour: change(colour (h, w, 3) in 0..1 float32)."""

    def filtered(number: int, colour: np.ndarray) -> np.ndarray:
        x = change(colour.astype(np.float32) / np.float32(255))
        return (np.clip(x, 0, 1) * 255).astype(np.uint8)

    return segment.with_colour(filtered)


@perturbation
def jpeg_compression(segment: Segment, quality: float) -> Segment:
    """JPEG compression of colour."""
    options = [cv2.IMWRITE_JPEG_QUALITY, int(quality)]

    def change(number: int, colour: np.ndarray) -> np.ndarray:
        _, data = cv2.imencode(".jpg", cv2.cvtColor(colour, cv2.COLOR_RGB2BGR), options)
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
        return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))

    return segment.with_colour(change)


@perturbation
def black_frames(segment: Segment, percent: float) -> Segment:
    """Some frames, never the first, have black colour and no depth."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        if number == segment.numbers[0] or segment.generator(number).random() >= percent / 100:
            return colour, depth_z_m
        return np.zeros_like(colour), np.zeros_like(depth_z_m)

    return segment.with_images(change)


@perturbation
def misregistered(segment: Segment, shift_px: float) -> Segment:
    """Depth is shifted by this number of pixels to the right of its colour."""
    by = int(shift_px)

    def change(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        moved = np.zeros_like(depth_z_m)
        moved[:, by:] = depth_z_m[:, : depth_z_m.shape[1] - by]
        return moved

    return segment.with_depth(change)


@perturbation
def calibration_off(segment: Segment, percent: float) -> Segment:
    """The camera given to the method has focal lengths and a principal point that are too large by
    this percentage.
    """
    c = segment.camera
    factor = 1 + percent / 100
    camera = replace(c, fx=factor * c.fx, fy=factor * c.fy, cx=factor * c.cx, cy=factor * c.cy)
    return replace(segment, camera=camera)


@perturbation
def guess_off(segment: Segment, degrees: float) -> Segment:
    """The initial guess of each alignment is rotated by this angle."""
    return replace(segment, guess_off_deg=degrees)


def random_field(segment: Segment, number: int, size_px: float) -> np.ndarray:
    """(h, w) normal random field of a frame, smooth over about size_px."""
    h, w = segment.true_camera.height, segment.true_camera.width
    shape = (int(h // size_px) + 3, int(w // size_px) + 3)
    coarse = gaussian(segment.generator(number), shape)
    return np.asarray(cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC))


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)
