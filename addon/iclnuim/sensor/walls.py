"""Recordings of static flat walls by a depth sensor: the plane, and the noise around its mean."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from . import depth_image as images
from .appearance import WHITE_ALBEDO


@dataclass(frozen=True, eq=False)
class WallRecording:
    """`frames` (n, h, w) planar depth in metres, 0 = missing, of a camera and a wall that do not
    move; `albedo`: the wall's diffuse reflectance, 0..1.
    """

    frames: np.ndarray
    camera: PinholeCamera
    albedo: float = WHITE_ALBEDO

    @cached_property
    def share_seen(self) -> np.ndarray:
        """(h, w): the share of frames in which a pixel is measured."""
        return (self.frames > 0).mean(0)

    @cached_property
    def depth_z_m(self) -> np.ndarray:
        """(h, w): the plane, also where nothing is measured."""
        inverse, _ = fitted_plane(*mean_of_seen(inverse_depth(self.frames)))
        return (1 / np.maximum(inverse, 1e-6)).astype(np.float32)

    @cached_property
    def ray_length(self) -> np.ndarray:
        """(h, w): distance along the ray by planar depth."""
        x, y = images.ray_slopes(self.camera)
        return np.sqrt(1 + x * x + y * y)

    @property
    def range_m(self) -> np.ndarray:
        """(h, w): distance of the plane along the ray."""
        return self.depth_z_m * self.ray_length

    @cached_property
    def reflected(self) -> np.ndarray:
        """(h, w): albedo times the cosine between the wall's normal and the ray."""
        secant = images.surface_normals(self.depth_z_m, self.camera).secant
        return (self.albedo / secant).astype(np.float32)

    @cached_property
    def errors(self) -> np.ndarray:
        """(n, h, w): inverse depth in 1/m minus the pixel's mean, whose variance is that of the
        noise; NaN where a pixel is not measured in every frame.
        """
        inverse = inverse_depth(self.frames)
        count = len(inverse)
        errors = (inverse - inverse.mean(0)) * np.sqrt(count / (count - 1))
        return np.where((inverse > 0).all(0), errors, np.nan)

    @cached_property
    def sigma_m(self) -> np.ndarray:
        """(h, w): standard deviation of planar depth from frame to frame; NaN as for `errors`."""
        return np.sqrt((self.errors**2).mean(0)) * self.depth_z_m**2


def inverse_depth(depth_z_m: np.ndarray) -> np.ndarray:
    """1 / Z, 0 where missing."""
    depth_z_m = np.asarray(depth_z_m, float)
    return np.divide(1, depth_z_m, out=np.zeros_like(depth_z_m), where=depth_z_m > 0)


def mean_of_seen(inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean (h, w) over the frames (n, h, w) in which a pixel is not 0, and their number."""
    count = (inverse > 0).sum(0)
    return np.divide(inverse.sum(0), count, out=np.zeros(count.shape), where=count > 0), count


def fitted_plane(
    mean: np.ndarray, count: np.ndarray, rounding: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """The plane (h, w) through means (h, w) of a quantity that is linear on planes, as inverse
    depth is, and which pixels lie on it: those in front of the wall or behind it do not.
    `rounding`: the deviation of the means that rounding alone can cause.

    Raises InputError if less than a tenth of the image was measured.
    """
    height, width = mean.shape
    if (count > 0).mean() < 0.1:
        found = f"{100 * (count > 0).mean():.0f} % measured"
        raise InputError("a wall that fills the depth images", found=found)
    v, u = np.mgrid[0:height, 0:width]
    design = np.column_stack([np.ones(u.size), (u / width).ravel(), (v / height).ravel()])
    values = mean.ravel()
    known = count.ravel() > 0
    keep = known
    for _ in range(4):
        plane = np.linalg.lstsq(design[keep], values[keep], rcond=None)[0]
        off = np.abs(values - design @ plane)
        keep = known & (off <= 4 * 1.4826 * np.median(off[keep]) + rounding)
    return (design @ plane).reshape(height, width), keep.reshape(height, width)
