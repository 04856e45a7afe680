"""RGB-D: F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images", ICCV 2011.

Photometric error of the whole image, plain least squares, as Kintinuous runs it.
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
    reference: str = "frame"


PRESETS = {
    "paper": RgbdSettings(),
    "best": RgbdSettings(
        iterations=(0, 4, 5, 5),
        least_gradients=(12, 3, 3, 2),
        most_depth_m=13.0,
        nu=5.0,
        both=True,
        spread=150.0,
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
        for n in reversed(range(len(reference))):
            if s.iterations[n]:
                light = Light(s.least_gradients[n], s.most_dz_m, s.most_depth_m, s.nu, s.both, s.spread)
                term = PhotometricTerm(reference[n], current[n], light)
                levels.append((term, Descent(s.iterations[n], -np.inf, s.smallest_step), reference[n].grey.size))
        return descend(levels, guess, Limits(s.largest_step_m, s.least_inliers))
