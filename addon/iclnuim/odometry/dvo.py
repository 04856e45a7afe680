"""DVO: C. Kerl, J. Sturm, D. Cremers, "Robust odometry estimation for RGB-D cameras", ICRA 2013.

The whole grey image, inverse compositional, Student-t weights (section III), coarse to fine on levels 3 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from .minimise import Descent, Limits, descend
from .photometric import Light, flat, steps
from .protocol import Frame, Result, failure
from .pyramid import Level, pyramid


@dataclass(frozen=True)
class DvoSettings:
    """`paper`: median-picked depth, all pixels. Lengths in metres, gradients in grey levels a pixel."""

    levels: tuple[int, ...] = (3, 2, 1)
    iterations: int = 100
    least_decrease: float = 5e-7
    smallest_step: float = 1e-7
    depth: str = "median-pick"
    least_gradient: float = 0.0
    most_dz_m: float = 0.05
    nu: float = 5.0
    both: bool = False
    spread: float = 0.0
    #: failure test of dvo_slam: the share of pixels that keep a residual
    least_inliers: float = 0.3
    tiles: bool = False
    prior_m: float = 0.0
    reference: str = "frame"


PRESETS = {
    "paper": DvoSettings(),
    "best": DvoSettings(
        iterations=4,
        least_decrease=1e-3,
        smallest_step=2e-5,
        depth="mean",
        least_gradient=2.0,
        both=True,
        spread=75.0,
        tiles=True,
        prior_m=0.03,
        least_inliers=0.01,
        reference="kept",
    ),
}


class Dvo:
    name = "dvo"

    def __init__(self, settings: DvoSettings) -> None:
        self.settings, self.reference = settings, settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        return pyramid(frame, camera, max(self.settings.levels) + 1, depth=self.settings.depth)

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        if flat(reference, current):
            return failure("image: no contrast")
        s, levels = self.settings, []
        chosen = [n for n in s.levels if n < len(reference)] or [len(reference) - 1]
        light = Light(s.least_gradient, s.most_dz_m, nu=s.nu, both=s.both, spread=s.spread, tiles=s.tiles)
        descent = Descent(s.iterations, s.least_decrease, s.smallest_step, undo=True)
        for n in chosen:
            each_time = s.tiles or n == chosen[0]
            levels += steps(reference[n], current[n], light, descent, n == chosen[-1], each_time)
        return descend(levels, guess, Limits(least_inliers=s.least_inliers, prior_m=s.prior_m))
