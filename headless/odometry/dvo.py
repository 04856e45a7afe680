"""DVO: C. Kerl, J. Sturm, D. Cremers, "Robust odometry estimation for RGB-D cameras", ICRA 2013.

The whole grey image, inverse compositional, Student-t weights (section III), coarse to fine on levels 3 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from .minimise import Descent, Limits, descend
from .photometric import Light, PhotometricTerm, flat
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
    reference: str = "frame"


PRESETS = {
    "paper": DvoSettings(),
    "best": DvoSettings(
        iterations=6,
        least_decrease=1e-3,
        smallest_step=2e-5,
        depth="mean",
        least_gradient=3.0,
        both=True,
        spread=150.0,
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
        for level in chosen:
            light = Light(s.least_gradient, s.most_dz_m, nu=s.nu, both=s.both, spread=s.spread)
            term = PhotometricTerm(reference[level], current[level], light, each_time=level == chosen[0])
            descent = Descent(s.iterations, s.least_decrease, s.smallest_step, undo=True)
            levels.append((term, descent, reference[level].grey.size))
        return descend(levels, guess, Limits(least_inliers=s.least_inliers))
