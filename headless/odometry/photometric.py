"""The photometric term on one pyramid level, for every odometer that has one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import kernels
from .pyramid import Level
from .system import System

#: Grey levels (standard deviation) below which an image is black, white or covered.
LEAST_CONTRAST = 1.0


def flat(*frames: list[Level]) -> bool:
    """Whether one of the pyramids holds nothing to align by light."""
    return any(float(levels[-1].grey.std()) < LEAST_CONTRAST for levels in frames)


@dataclass
class PhotometricTerm:
    """Equations in grey levels. nu > 0: Student-t weights, sigma kept between calls; each_time re-estimates it."""

    reference: Level
    current: Level
    least_gradient: float = 0.0
    most_dz_m: float = 0.05
    most_depth_m: float = 1e9
    nu: float = 0.0
    each_time: bool = True
    sigma: float = 5.0
    residual: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.residual = np.empty(self.reference.grey.shape, np.float32)

    def __call__(self, T: np.ndarray, iteration: int) -> System:
        one, two = self.reference, self.current
        gx, gy = one.gradients
        kernels.photometric_residuals(
            np.linalg.inv(T),
            one.k,
            one.grey,
            one.depth_z_m,
            gx,
            gy,
            two.grey,
            two.depth_z_m,
            self.least_gradient,
            self.most_dz_m,
            self.most_depth_m,
            self.residual,
        )
        if self.nu > 0 and (iteration == 0 or self.each_time):
            self.sigma = max(kernels.student_scale(self.residual, self.nu, self.sigma, 20), 1e-3)
        rows = np.zeros((len(self.residual), kernels.SUMS))
        kernels.photometric_sums(one.k, one.depth_z_m, gx, gy, self.residual, self.sigma, self.nu, rows)
        return System.of_rows(rows)
