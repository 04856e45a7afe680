"""ICP+RGB-D: T. Whelan et al., "Robust real-time visual odometry for dense RGB-D mapping", ICRA 2013, section IV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .geometric import Planes, PlaneTerm
from .icp import Icp, IcpSettings
from .minimise import Descent, Limits, Linearise, descend
from .photometric import Light, flat, steps
from .protocol import Result
from .pyramid import Level
from .system import System


@dataclass(frozen=True)
class IcpRgbdSettings(IcpSettings):
    """weights: "consistent"; "kintinuous2013" repeats a slip (matrix weighted by w^2, right-hand side by w);
    "information" takes each term by its own variance (spread, spread_rgbd), which makes it independent of units.
    rough_spread: spread of planes of a sensor's frames, whose errors reach farther; rough_scale: what they say
    of the motion's length may be off by such a share, for their depth is biased: `released` noise has 0.16 % a metre,
    and so 0.6 % of a motion seen from 2 m; rough_prior_m: prior_m of such frames, as where there is light alone.
    """

    spread_rgbd: float = 0.0
    rough_spread: float = 0.0
    rough_scale: float = 0.0
    rough_prior_m: float = 0.0
    nu_rgbd: float = 0.0
    esm: bool = False
    tiles: bool = False
    weight_rgbd: float = 0.1
    weights: str = "consistent"
    least_gradients: tuple[float, ...] = (12, 5, 3)
    most_dz_m: float = 0.07


PRESETS = {
    "paper": IcpRgbdSettings(),
    "kintinuous2013": IcpRgbdSettings(weights="kintinuous2013"),
    "best": IcpRgbdSettings(
        iterations=(0, 2, 2, 2),
        strides=(1, 2, 1, 1),
        filter=False,
        most_angle_deg=12.0,
        smallest_step=5e-6,
        both=True,
        spread=30.0,
        prior_m=0.003,
        nu=10.0,
        weights="information",
        spread_rgbd=75.0,
        nu_rgbd=5.0,
        esm=True,
        tiles=True,
        least_gradients=(12, 2, 3, 3),
        rough_step=3,
        rough_spread=300.0,
        rough_scale=0.1,
        rough_prior_m=0.01,
        reference="kept",
    ),
}


class IcpRgbd(Icp):
    name = "icp_rgbd"
    settings: IcpRgbdSettings

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        if flat(reference, current):
            return super().align(reference, current, guess)
        s, levels = self.settings, []
        rough = s.rough_step and current[0].normal_step == s.rough_step
        chosen = [n for n in reversed(range(len(reference))) if s.iterations[n]]
        for n in chosen:
            spread = s.rough_spread if rough else s.spread
            planes = Planes(s.most_distance_m, s.most_angle_deg, s.strides[n], s.nu, s.both, spread)
            plane = PlaneTerm(reference[n], current[n], planes)
            light = Light(s.least_gradients[n], s.most_dz_m, 13.0, s.nu_rgbd, s.esm, s.spread_rgbd, s.tiles)
            descent = Descent(s.iterations[n], -np.inf, s.smallest_step)
            for term, _, _ in steps(reference[n], current[n], light, descent, n == chosen[-1]):
                levels.append((_joint(plane, term, s, s.rough_scale if rough else 0.0), descent, plane.pixels))
        prior_m = s.rough_prior_m if rough and s.rough_prior_m else s.prior_m
        return descend(levels, guess, Limits(s.largest_step_m, prior_m=prior_m))


def _joint(plane: PlaneTerm, light: Linearise, settings: IcpRgbdSettings, doubt: float) -> Linearise:
    def linearise(T: np.ndarray, iteration: int) -> System:
        w = settings.weight_rgbd
        geometry, colour = plane(T, iteration), light(T, iteration)
        if doubt:
            geometry = geometry.without_scale(T[:3, 3], doubt)
        if settings.weights == "information":
            return geometry.plus(colour)
        return geometry.plus(colour.scaled(w * w, w if settings.weights == "kintinuous2013" else None))

    return linearise
