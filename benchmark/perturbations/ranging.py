"""Perturbations by the principle of the depth sensor: a second projector, wrapped phase, few zones.

Colour stays as it is.
"""

import numpy as np

from .lighting import ray_lengths
from .registry import perturbation
from .segment import Segment

#: The speed of light (exact, SI).
_LIGHT_M_S = 299_792_458.0


@perturbation
def interference(
    segment: Segment, percent: float, window_px: float, search_px: float, baseline_m: float
) -> Segment:
    """A second structured-light projector disturbs the matching of this share of the windows: in
    half of them depth is missing, and in the others the disparity is wrong by up to search_px (A.
    Maimone and H. Fuchs, "Reducing interference between multiple structured light depth sensors
    using motion", IEEE VR 2012). Other windows are disturbed in each frame.
    """
    scale = np.float32(segment.true_camera.fx * baseline_m)
    side = int(window_px)

    def change(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        h, w = depth_z_m.shape
        rng = segment.generator(number)
        windows = (int(h // window_px) + 1, int(w // window_px) + 1)
        window = np.ix_(np.arange(h) // side, np.arange(w) // side)
        drawn = rng.random(windows)[window]
        error_px = rng.uniform(-search_px, search_px, windows)[window].astype(np.float32)
        disparity = scale / np.maximum(depth_z_m, np.float32(1e-3)) + error_px
        wrong = np.where(disparity > 1, scale / np.maximum(disparity, 1), np.float32(0))
        disturbed = np.where(drawn < percent / 100, np.float32(0), depth_z_m)
        disturbed = np.where(drawn < percent / 200, wrong, disturbed)
        return np.where(depth_z_m > 0, disturbed, np.float32(0))

    return segment.with_depth(change)


@perturbation
def wrapped_phase(segment: Segment, mhz: float) -> Segment:
    """A time-of-flight sensor with one modulation frequency measures distance modulo c / (2 f) (M.
    Hansard and others, "Time-of-Flight Cameras: Principles, Methods and Applications", Springer
    2012).
    """
    slant = ray_lengths(segment.true_camera)
    range_m = np.float32(_LIGHT_M_S / (2e6 * mhz))
    return segment.with_depth(lambda number, z: np.mod(z * slant, range_m) / slant)


@perturbation
def few_zones(segment: Segment, size_px: float) -> Segment:
    """A sensor with few zones, such as 8 x 8: pixels of a zone of size_px have its mean depth."""
    side = int(size_px)

    def change(number: int, depth_z_m: np.ndarray) -> np.ndarray:
        h, w = depth_z_m.shape
        total = _zone_sums(depth_z_m, side)
        count = _zone_sums(depth_z_m > 0, side)
        mean = (total / np.maximum(count, 1)).astype(np.float32)
        return mean[np.ix_(np.arange(h) // side, np.arange(w) // side)]

    return segment.with_depth(change)


def _zone_sums(values: np.ndarray, side: int) -> np.ndarray:
    rows, columns = (np.arange(0, length, side) for length in values.shape)
    return np.add.reduceat(np.add.reduceat(values.astype(np.float64), rows, 0), columns, 1)
