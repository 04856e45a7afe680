"""RGB-D: F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images", ICCV 2011.

Photometric error of the whole image, plain least squares, as Kintinuous runs it.
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
class RgbdSettings:
    """Iterations and least gradients (grey levels a pixel) from fine to coarse; depth and steps in metres."""

    iterations: tuple[int, ...] = (10, 7, 7, 7)
    least_gradients: tuple[float, ...] = (12, 5, 3, 1)
    most_depth_m: float = 6.0
    most_dz_m: float = 0.07
    largest_step_m: float = 0.3
    nu: float = 0.0
    both: bool = False
    spread: float = 0.0
    smallest_step: float = 0.0
    least_inliers: float = 0.001
    tiles: bool = False
    prior_m: float = 0.0
    reference: str = "frame"


PRESETS = {
    "paper": RgbdSettings(),
    "best": RgbdSettings(
        iterations=(0, 4, 2, 2),
        least_gradients=(12, 2, 3, 2),
        most_depth_m=13.0,
        nu=5.0,
        both=True,
        spread=75.0,
        tiles=True,
        prior_m=0.03,
        smallest_step=2e-5,
        reference="kept",
    ),
}


class Rgbd:
    name = "rgbd"

    def __init__(self, settings: RgbdSettings) -> None:
        self.settings, self.reference = settings, settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        return pyramid(frame, camera, len(self.settings.iterations))

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        if flat(reference, current):
            return failure("image: no contrast")
        s, levels = self.settings, []
        chosen = [n for n in reversed(range(len(reference))) if s.iterations[n]]
        for n in chosen:
            light = Light(s.least_gradients[n], s.most_dz_m, s.most_depth_m, s.nu, s.both, s.spread, s.tiles)
            descent = Descent(s.iterations[n], -np.inf, s.smallest_step)
            levels += steps(reference[n], current[n], light, descent, n == chosen[-1])
        return descend(levels, guess, Limits(s.largest_step_m, s.least_inliers, prior_m=s.prior_m))
