"""The photometric term on one pyramid level, for every odometer that has one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import kernels
from .minimise import Descent, Linearise
from .pyramid import Level
from .system import System, inverted
from .tiles import ACROSS, DOWN, Tiles

NONE = np.empty(0)
#: Grey levels (standard deviation) below which an image is black, white or covered.
LEAST_CONTRAST = 1.0


def flat(*frames: list[Level]) -> bool:
    """Whether one of the pyramids holds nothing to align by light."""
    return any(float(levels[-1].grey.std()) < LEAST_CONTRAST for levels in frames)


@dataclass(frozen=True)
class Light:
    """What a photometric term uses: grey levels a pixel, metres. nu > 0: Student-t weights; tiles: see there."""

    least_gradient: float = 0.0
    most_dz_m: float = 0.05
    most_depth_m: float = 1e9
    nu: float = 0.0
    both: bool = False
    spread: float = 0.0
    tiles: bool = False


class PhotometricTerm:
    """Equations in grey levels. sigma is kept between calls; each_time re-estimates it, else the first one does.

    sparse: every second pixel, as on the black fields of a chessboard; neighbours share their error anyway.
    """

    def __init__(
        self,
        reference: Level,
        current: Level,
        light: Light,
        each_time: bool = True,
        tiles: Tiles | None = None,
        sparse: bool = False,
    ) -> None:
        self.current, self.light, self.each_time, self.sigma = current, light, each_time, 5.0
        self.tiles, self.firm = tiles, False
        size = reference.grey.size
        self.pixels = size // 2 if sparse else size
        points, greys, J = (np.empty((size, *d), np.float32) for d in ((3,), (), (6,)))
        tile = np.empty(size, np.int16)
        n = kernels.bright_points(
            reference.k,
            reference.grey,
            reference.depth_z_m,
            light.least_gradient,
            light.most_depth_m,
            ACROSS,
            DOWN,
            sparse,
            points,
            greys,
            J,
            tile,
        )
        self.points, self.greys, self.J, self.tile = points[:n], greys[:n], J[:n], tile[:n]
        self.residual, self.mean = np.empty(n, np.float32), np.empty((n if light.both else 0, 6), np.float32)
        self.parallax = np.empty(n if tiles else 0, np.float32)
        self.sums = np.empty((ACROSS * DOWN, 42))

    def firmly(self, T: np.ndarray, iteration: int) -> System:
        """As a call, with depth believed where the tiles' light agrees with it."""
        self.firm = True
        return self(T, iteration)

    def __call__(self, T: np.ndarray, iteration: int) -> System:
        level, nu = self.current, self.light.nu
        if self.tiles:
            self.tiles.follow(T)
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
            self.tile,
            self.tiles.factor if self.tiles else NONE,
            self.parallax,
        )
        if nu > 0 and (iteration == 0 or self.each_time):
            self.sigma = max(kernels.student_scale(self.residual, nu, self.sigma, 20), 1e-3)
        return self._system(self.mean if self.light.both else self.J).as_information(self.light.spread)

    def _system(self, J: np.ndarray) -> System:
        if self.tiles:
            nu = self.light.nu
            kernels.tile_sums(self.points, J, self.parallax, self.residual, self.sigma, nu, self.tile, self.sums)
            return self.tiles.eliminated(self.sums, self.firm)
        return System.of_sums(kernels.sums(self.points, J, self.residual, J, self.residual, self.sigma, self.light.nu))


def steps(
    reference: Level, current: Level, light: Light, descent: Descent, finest: bool, each_time: bool = True
) -> list[tuple[Linearise, Descent, int]]:
    """What descend() does on a level. With `light.tiles` the coarse levels find the rotation, which all layers of a view
    share, and the finest goes down twice: with the tiles' depth loose, then believed where it can be.
    """
    if not light.tiles or not finest:
        term = PhotometricTerm(reference, current, light, each_time)
        return [(term, replace(descent, turning=light.tiles), term.pixels)]
    term = PhotometricTerm(reference, current, light, each_time, Tiles(), sparse=True)
    # factors that settle, and then their prior, may raise the error for a step
    free = replace(descent, undo=False, least_decrease=-np.inf)
    return [(term, free, term.pixels), (term.firmly, free, term.pixels)]
