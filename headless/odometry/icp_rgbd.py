"""ICP+RGB-D: T. Whelan et al., "Robust real-time visual odometry for dense RGB-D mapping", ICRA 2013, section IV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .geometric import Planes, PlaneTerm
from .icp import Icp, IcpSettings
from .minimise import Descent, Limits, Linearise, descend
from .photometric import Light, PhotometricTerm, flat
from .protocol import Result
from .pyramid import Level
from .system import System


@dataclass(frozen=True)
class IcpRgbdSettings(IcpSettings):
    """weights: "consistent"; "kintinuous2013" repeats a slip (matrix weighted by w^2, right-hand side by w);
    "variance" divides each term by its own variance, which makes it independent of units.
    """

    weight_rgbd: float = 0.1
    weights: str = "consistent"
    least_gradients: tuple[float, ...] = (12, 5, 3)
    most_dz_m: float = 0.07


PRESETS = {
    "paper": IcpRgbdSettings(),
    "kintinuous2013": IcpRgbdSettings(weights="kintinuous2013"),
    "best": IcpRgbdSettings(
        iterations=(0, 4, 3),
        filter=False,
        nu=5.0,
        smallest_step=5e-6,
        weights="variance",
        weight_rgbd=0.05,
        least_gradients=(12, 6, 4),
    ),
}


class IcpRgbd(Icp):
    name = "icp_rgbd"
    settings: IcpRgbdSettings

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        if flat(reference, current):
            return super().align(reference, current, guess)
        s, levels = self.settings, []
        for n in (n for n in reversed(range(len(reference))) if s.iterations[n]):
            planes = Planes(s.most_distance_m, s.most_angle_deg, s.strides[n], s.nu, s.cross)
            plane = PlaneTerm(reference[n], current[n], planes)
            light = PhotometricTerm(reference[n], current[n], Light(s.least_gradients[n], s.most_dz_m, 13.0, s.nu))
            descent = Descent(s.iterations[n], -np.inf, s.smallest_step)
            levels.append((_joint(plane, light, s), descent, plane.pixels))
        return descend(levels, guess, Limits(s.largest_step_m))


def _joint(plane: PlaneTerm, light: PhotometricTerm, settings: IcpRgbdSettings) -> Linearise:
    def linearise(T: np.ndarray, iteration: int) -> System:
        w = settings.weight_rgbd
        geometry, colour = plane(T, iteration), light(T, iteration)
        if settings.weights == "variance":
            geometry, colour = geometry.scaled(plane.sigma**-2), colour.scaled((w / light.sigma) ** 2)
        else:
            colour = colour.scaled(w * w, w if settings.weights == "kintinuous2013" else None)
        return geometry.plus(colour)

    return linearise
