"""How far rendered frames are from a reference, and how far neighbouring frames are from each other. Display values, 0..1."""

from dataclasses import dataclass

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.transfer import srgb_from_light

#: Depth that differs by more than this share is another surface.
_SAME_SURFACE = 0.01


@dataclass(frozen=True)
class Error:
    """psnr_db of each view against the picture that path tracing converges to; median and mean difference of a colour value.

    psnr_to_reference_db and median_to_reference: the same against the reference as it is, whose own noise counts as error.
    """

    psnr_db: tuple[float, ...]
    psnr_to_reference_db: tuple[float, ...]
    median: float
    median_to_reference: float
    bias: float

    @property
    def mean_psnr_db(self) -> float:
        return float(np.mean(self.psnr_db))


def error(frames: np.ndarray, halves: np.ndarray) -> Error:
    """Of scene-linear frames (n, h, w, 3) against references (2, n, h, w, 3) with independent noise.

    The mean of the product of both differences is free of the references' noise: the halves' noise is independent. From
    the median that noise, half the halves' difference, is taken in quadrature.
    """
    a, b = (srgb_from_light(frames) - srgb_from_light(half) for half in halves)
    whole = srgb_from_light(frames) - srgb_from_light(halves.mean(0))
    median, noise = float(np.median(np.abs(whole))), float(np.median(np.abs(a - b))) / 2
    return Error(
        psnr_db=tuple(_decibels(np.mean(x * y)) for x, y in zip(a, b, strict=True)),
        psnr_to_reference_db=tuple(_decibels(np.mean(x**2)) for x in whole),
        median=float(np.sqrt(max(median**2 - noise**2, 0))),
        median_to_reference=median,
        bias=float(whole.mean()),
    )


def _decibels(square: float) -> float:
    return float(-10 * np.log10(max(square, 1e-9)))


def carried_difference(
    rgb_a: np.ndarray,
    depth_a_z_m: np.ndarray,
    rgb_b: np.ndarray,
    depth_b_z_m: np.ndarray,
    T_b_a: SE3,
    camera: PinholeCamera,
) -> np.ndarray:
    """(n,) differences, mean over colours, of frame a's pixels and frame b read (bilinear) where they fall in it.

    Scene-linear frames (h, w, 3) and planar depth (h, w) in metres. Left out: pixels without depth, outside b, or behind
    or beside another surface in b.
    """
    points = T_b_a.apply(camera.unproject(depth_a_z_m).reshape(-1, 3))
    pixels = camera.project(points).reshape(camera.height, camera.width, 2).astype(np.float32)
    z = points[:, 2].reshape(camera.height, camera.width)
    x, y = pixels[..., 0].copy(), pixels[..., 1].copy()
    b = cv2.remap(srgb_from_light(rgb_b).astype(np.float32), x, y, cv2.INTER_LINEAR, borderValue=(np.nan,) * 3)
    nearest, farthest = (
        cv2.remap(f(depth_b_z_m, np.ones((2, 2))), x, y, cv2.INTER_NEAREST) for f in (cv2.erode, cv2.dilate)
    )
    same = (depth_a_z_m > 0) & (np.abs(nearest - z) < _SAME_SURFACE * z) & (np.abs(farthest - z) < _SAME_SURFACE * z)
    difference = np.abs(b - srgb_from_light(rgb_a)).mean(-1)
    return difference[same & np.isfinite(difference)]
