"""The corruptions of X. Xu and others, "Customizable perturbation synthesis for robust SLAM
benchmarking" (2024), with their definitions and constants.

Those of colour come from D. Hendrycks and T. Dietterich, "Benchmarking neural network robustness to
common corruptions and perturbations", ICLR 2019. Differences: all random numbers depend only on
seed and frame; depth stays in metres, so that negative noise does not wrap in 16 bits.
"""

from collections.abc import Callable

import cv2
import numpy as np

from .segment import Images, Segment

#: Cells (row, column) of a 10 x 10 grid that a fixed mask removes, in this order.
_CELLS = (
    (0, 0),
    (2, 0),
    (4, 0),
    (6, 0),
    (0, 2),
    (0, 4),
    (0, 6),
    (2, 2),
    (4, 4),
    (8, 8),
    (8, 0),
    (0, 8),
    (6, 6),
)


def gaussian_noise(segment: Segment, sigma: float) -> Segment:
    """Normal noise added to colour."""
    return _colour(segment, lambda x, rng: x + sigma * rng.standard_normal(x.shape, np.float32))


def shot_noise(segment: Segment, photons: float) -> Segment:
    """Shot noise of colour, with this number of photons at white."""
    return _colour(
        segment, lambda x, rng: rng.poisson(x * photons).astype(np.float32) / np.float32(photons)
    )


def impulse_noise(segment: Segment, share: float) -> Segment:
    """A share of the values becomes black or white."""

    def change(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        drawn = rng.random(x.shape, np.float32)
        return np.where(drawn < share / 2, np.float32(0), np.where(drawn < share, np.float32(1), x))

    return _colour(segment, change)


def speckle_noise(segment: Segment, sigma: float) -> Segment:
    """Colour multiplied by normal noise."""
    return _colour(
        segment,
        lambda x, rng: x * (1 + np.float32(sigma) * rng.standard_normal(x.shape, np.float32)),
    )


def gaussian_blur(segment: Segment, sigma_px: float) -> Segment:
    """Gaussian blur of colour."""
    return _colour(segment, lambda x, rng: cv2.GaussianBlur(x, (0, 0), sigma_px))


def defocus_blur(segment: Segment, radius_px: float, smooth_px: float) -> Segment:
    """Mean of colour over a disc with a smoothed edge."""
    reach = max(8, int(radius_px))
    u, v = np.meshgrid(*(np.arange(-reach, reach + 1),) * 2)
    disc = (u**2 + v**2 <= radius_px**2).astype(np.float32)
    side = 3 if radius_px <= 8 else 5
    disc = cv2.GaussianBlur(disc / disc.sum(), (side, side), smooth_px)
    return _colour(segment, lambda x, rng: cv2.filter2D(x, -1, disc))


def contrast(segment: Segment, kept: float) -> Segment:
    """Colour is moved towards its mean."""
    return _colour(segment, lambda x, rng: (x - x.mean((0, 1))) * np.float32(kept) + x.mean((0, 1)))


def brightness(segment: Segment, added: float) -> Segment:
    """A constant added to the value (HSV) of colour."""

    def change(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        hsv = cv2.cvtColor(x, cv2.COLOR_RGB2HSV)
        hsv[..., 2] = np.clip(hsv[..., 2] + added, 0, 1)
        return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)

    return _colour(segment, change)


def jpeg_compression(segment: Segment, quality: float) -> Segment:
    """JPEG compression of colour."""

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        data = cv2.imencode(
            ".jpg",
            cv2.cvtColor(colour, cv2.COLOR_RGB2BGR),
            [cv2.IMWRITE_JPEG_QUALITY, int(quality)],
        )[1]
        return np.asarray(
            cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        ), depth_z_m

    return segment.with_images(change)


def pixelate(segment: Segment, share: float) -> Segment:
    """Colour reduced to this share of its size and enlarged again."""

    def change(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        h, w = x.shape[:2]
        small = cv2.resize(x, (int(w * share), int(h * share)), interpolation=cv2.INTER_AREA)
        return cv2.resize(small, (w, h), interpolation=cv2.INTER_NEAREST)

    return _colour(segment, change)


def depth_noise(segment: Segment, share: float) -> Segment:
    """Normal noise with this share of the image's mean and standard deviation."""

    def change(z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        noise = share * (z.mean() + z.std() * rng.standard_normal(z.shape, np.float32))
        return np.where(z > 0, np.maximum(z + noise, 0), 0)

    return _depth(segment, change)


def depth_edge_erosion(segment: Segment, share: float, reach_px: float) -> Segment:
    """Depth is missing at edges, and in squares around a share of the edge pixels."""
    side = 2 * int(reach_px) + 1

    def change(z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        grey = np.asarray(cv2.normalize(z, np.empty_like(z), 0, 255, cv2.NORM_MINMAX)).astype(
            np.uint8
        )
        edges = np.asarray(cv2.Canny(grey, 20, 50)) > 0
        chosen = (edges & (rng.random(z.shape) < share)).astype(np.uint8)
        return np.where(
            edges | (np.asarray(cv2.dilate(chosen, np.ones((side, side), np.uint8))) > 0), 0, z
        )

    return _depth(segment, change)


def depth_fixed_mask(segment: Segment, cells: float) -> Segment:
    """Depth is missing in this number of cells of a 10 x 10 grid, the same in each frame."""

    def change(z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        h, w = (side // 10 for side in z.shape)
        left = z.copy()
        for row, column in _CELLS[: int(cells)]:
            left[row * h : (row + 1) * h, column * w : (column + 1) * w] = 0
        return left

    return _depth(segment, change)


def depth_range(segment: Segment, max_m: float) -> Segment:
    """No depth beyond max_m, and none nearer than 0.2 m + (4.4 m - max_m) / 2."""
    min_m = 0.2 + (4.4 - max_m) / 2
    return _depth(segment, lambda z, rng: np.where((z >= min_m) & (z <= max_m), z, 0))


def _colour(
    segment: Segment, change: Callable[[np.ndarray, np.random.Generator], np.ndarray]
) -> Segment:
    """The segment with changed colour: change(colour (h, w, 3) in 0..1 float32, generator)."""

    def changed(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        x = change(colour.astype(np.float32) / np.float32(255), segment.generator(number))
        return (np.clip(x, 0, 1) * 255).astype(np.uint8), depth_z_m

    return segment.with_images(changed)


def _depth(
    segment: Segment, change: Callable[[np.ndarray, np.random.Generator], np.ndarray]
) -> Segment:
    """The segment with changed depth: change(depth (h, w) in metres, generator)."""
    return segment.with_images(
        lambda n, colour, z: (colour, change(z, segment.generator(n)).astype(np.float32))
    )
