"""The photometric term on one pyramid level, for every odometer that has one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import kernels
from .pyramid import Level
from .system import System, inverted

#: Grey levels (standard deviation) below which an image is black, white or covered.
LEAST_CONTRAST = 1.0


def flat(*frames: list[Level]) -> bool:
    """Whether one of the pyramids holds nothing to align by light."""
    return any(float(levels[-1].grey.std()) < LEAST_CONTRAST for levels in frames)


@dataclass(frozen=True)
class Light:
    """What a photometric term uses: grey levels a pixel, metres. nu > 0: Student-t weights."""

    least_gradient: float = 0.0
    most_dz_m: float = 0.05
    most_depth_m: float = 1e9
    nu: float = 0.0
    both: bool = False
    spread: float = 0.0


class PhotometricTerm:
    """Equations in grey levels. sigma is kept between calls; each_time re-estimates it, else the first one does."""

    def __init__(
        self, reference: Level, current: Level, light: Light, each_time: bool = True, sigma: float = 5.0
    ) -> None:
        self.current, self.light, self.each_time, self.sigma = current, light, each_time, sigma
        size = reference.grey.size
        points, greys, J = (np.empty((size, *d), np.float32) for d in ((3,), (), (6,)))
        n = kernels.bright_points(
            reference.k,
            reference.grey,
            reference.depth_z_m,
            light.least_gradient,
            light.most_depth_m,
            points,
            greys,
            J,
        )
        self.points, self.greys, self.J = points[:n], greys[:n], J[:n]
        self.residual, self.mean = np.empty(n, np.float32), np.empty((n if light.both else 0, 6), np.float32)

    def __call__(self, T: np.ndarray, iteration: int) -> System:
        level, nu = self.current, self.light.nu
        kernels.grey_residuals(
            inverted(T),
            level.k,
            self.points,
            self.greys,
            level.grey,
            level.depth_z_m,
            self.light.most_dz_m,
            self.residual,
            self.J,
            self.mean,
        )
        if nu > 0 and (iteration == 0 or self.each_time):
            self.sigma = max(kernels.student_scale(self.residual, nu, self.sigma, 20), 1e-3)
        J = self.mean if self.light.both else self.J
        sums = kernels.sums(self.points, J, self.residual, J, self.residual, self.sigma, nu)
        return System.of_sums(sums).as_information(self.light.spread)
