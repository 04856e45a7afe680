"""Perturbations of light, air and lens: smoke, flicker, shadows that move, the dots of a projector,
dirt.

All are computed in scene-linear light, of which 1 is white, with the exact depth and the true
poses. Depth stays as it is, except in smoke. The room's own light stands for the reflectance of its
surfaces where another light falls on them.
"""

from collections.abc import Callable

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.sensor.noise_model import gaussian
from iclnuim.sensor.transfer import linear_from_srgb8, srgb8

from .filters import random_field
from .registry import perturbation
from .segment import Images, Segment

#: Contrast at which an object is still visible: 5 % defines the meteorological optical range
#: (WMO-No. 8, Guide to Instruments).
_VISIBLE = 0.05
#: Width of the blurred edge of dirt, in standard deviations of its random field.
_SOFT = 0.6
#: Side of a random field that repeats, in cells.
_CELLS = 64


@perturbation
def smoke(segment: Segment, visibility_m: float, airlight: float, min_signal: float) -> Segment:
    """Homogeneous smoke. Koschmieder's law: L exp(-b d) + airlight (1 - exp(-b d)) at distance d,
    where b = -ln(0.05) / visibility_m.

    The light of a depth sensor crosses the smoke twice: depth is missing where exp(-2 b d) is below
    min_signal.
    """
    slant = ray_lengths(segment.true_camera)
    extinction = np.float32(-np.log(_VISIBLE) / visibility_m)
    air = np.float32(airlight)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        kept = np.where(depth_z_m > 0, np.exp(-extinction * depth_z_m * slant), np.float32(0))
        light = air + kept[..., None] * (linear_from_srgb8(colour) - air)
        return srgb8(light), np.where(np.square(kept) >= min_signal, depth_z_m, np.float32(0))

    return segment.with_images(change)


@perturbation
def flicker(segment: Segment, percent: float, hz: float, readout_ms: float) -> Segment:
    """Lamps on the mains: light varies as 1 + m sin(2 pi hz t), at twice the mains frequency, and
    each row of a rolling shutter has its own time.

    percent: m, the modulation, as a percentage. The exposure is short.
    """
    height = segment.true_camera.height
    row_s = (np.arange(height) + 0.5) / height * readout_ms / 1e3

    def gain(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        wave = np.sin(2 * np.pi * hz * (segment.stamps_s[number] + row_s))
        rows = (1 + percent / 100 * wave).astype(np.float32)
        return np.broadcast_to(rows[:, None], depth_z_m.shape)

    return _times(segment, gain)


@perturbation
def moving_shadows(segment: Segment, percent: float, size_m: float, speed_m_s: float) -> Segment:
    """Sunlight through leaves that move: shadows about size_m wide cross all surfaces at speed_m_s,
    and take this percentage of the light.

    The shadows are a random field on the floor plane, projected along the sun's direction on the
    exact surface points.
    """
    pattern = _framed(gaussian(segment.generator(segment.numbers[0]), (_CELLS, _CELLS)))
    rays = segment.true_camera.rays().astype(np.float32)

    def gain(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        stamp_s = segment.stamps_s[number]
        T_world_camera = segment.pose(stamp_s)
        points = rays * depth_z_m[..., None] @ T_world_camera.rotation.T.astype(np.float32)
        points += T_world_camera.translation.astype(np.float32)
        x_m = points[..., 0] + 0.8 * points[..., 2] - speed_m_s * stamp_s
        y_m = points[..., 1] + 0.5 * points[..., 2]
        shade = np.clip(0.5 + _sampled(pattern, x_m / size_m, y_m / size_m), 0, 1)
        return 1 - np.float32(percent / 100) * shade

    return _times(segment, gain)


@perturbation
def emitter_dots(segment: Segment, strength: float, baseline_m: float, pitch_px: float) -> Segment:
    """The camera sees the dots of the depth sensor's projector, which move with the camera: they
    are `strength` times the room's light at 1 m.

    A dot at the projector's pixel u appears at u - fx baseline / Z; irradiance falls with the
    squared distance. One dot per square of pitch_px.
    """
    camera = segment.true_camera
    slant = ray_lengths(camera)
    dots = _dots(segment, int(pitch_px))
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float32)

    def gain(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        z = np.where(depth_z_m > 0, depth_z_m, np.float32(1e3))
        seen = _sampled(dots, u + np.float32(camera.fx * baseline_m) / z, v)
        return 1 + np.float32(strength) * seen / np.square(z * slant)

    return _times(segment, gain)


@perturbation
def lens_dirt(segment: Segment, percent: float, size_px: float, grey: float) -> Segment:
    """Dirt on the lens, out of focus, covers this share of the colour image; it stays at the same
    pixels in every frame.
    """
    field = random_field(segment, segment.numbers[0], size_px)
    depth_inside = (np.percentile(field, percent) - field) / _SOFT
    cover = np.clip(0.5 + depth_inside, 0, 1).astype(np.float32)[..., None]

    def change(number: int, colour: np.ndarray) -> np.ndarray:
        return srgb8((1 - cover) * linear_from_srgb8(colour) + cover * np.float32(grey))

    return segment.with_colour(change)


def ray_lengths(camera: PinholeCamera) -> np.ndarray:
    """(h, w) distance of a surface divided by its planar depth."""
    return np.linalg.norm(camera.rays(), axis=-1).astype(np.float32)


def _times(segment: Segment, gain: Callable[[int, np.ndarray], np.ndarray]) -> Segment:
    """The segment with its light multiplied by gain(number, depth), (h, w)."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        return srgb8(linear_from_srgb8(colour) * gain(number, depth_z_m)[..., None]), depth_z_m

    return segment.with_images(change)


def _dots(segment: Segment, pitch_px: int) -> np.ndarray:
    """A pattern, _framed, with one dot of about 3 pixels at a random place in each square of
    pitch_px, with a maximum of 1.
    """
    rng = segment.generator(segment.numbers[0])
    dots = np.zeros((_CELLS * pitch_px, _CELLS * pitch_px), np.float32)
    corners = np.arange(_CELLS) * pitch_px
    row = rng.integers(0, pitch_px, (_CELLS, _CELLS))
    column = rng.integers(0, pitch_px, (_CELLS, _CELLS))
    dots[corners[:, None] + row, corners[None] + column] = 1
    blurred = cv2.GaussianBlur(dots, (0, 0), 1.0)
    return _framed(np.asarray(blurred / blurred.max(), np.float32))


def _framed(pattern: np.ndarray) -> np.ndarray:
    """(h + 1, w + 1) a pattern (h, w) that repeats in both directions, with its first row and
    column once more at the end.
    """
    return np.pad(pattern, ((0, 1), (0, 1)), mode="wrap")


def _sampled(framed: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A repeating pattern, _framed, at any place, bilinear."""
    h, w = framed.shape[0] - 1, framed.shape[1] - 1
    u = np.mod(x, w).astype(np.float32)
    v = np.mod(y, h).astype(np.float32)
    found = cv2.remap(framed, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32)
