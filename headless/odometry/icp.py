"""ICP: point-to-plane with projective association, R. Newcombe et al., "KinectFusion", ISMAR 2011, section 3.5."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from .geometric import Planes, PlaneTerm
from .minimise import Descent, Limits, descend
from .protocol import Frame, Result
from .pyramid import Level, pyramid
from .system import DEGENERATE


@dataclass(frozen=True)
class IcpSettings:
    """Iterations and strides from fine to coarse; filter: bilateral (13 x 13, 4.5 px, 30 mm)."""

    iterations: tuple[int, ...] = (10, 5, 4)
    strides: tuple[int, ...] = (1, 1, 1)
    filter: bool = True
    most_distance_m: float = 0.10
    most_angle_deg: float = 20.0
    normal_step: int = 1
    nu: float = 0.0
    both: bool = False
    smallest_step: float = 0.0
    spread: float = 0.0
    prior_m: float = 0.0
    largest_step_m: float = 0.3
    reference: str = "frame"


PRESETS = {
    "paper": IcpSettings(),
    "best": IcpSettings(
        iterations=(0, 4, 3),
        strides=(1, 2, 1),
        filter=False,
        smallest_step=5e-6,
        both=True,
        most_angle_deg=12.0,
        nu=10.0,
        spread=30.0,
        prior_m=0.003,
    ),
}


class Icp:
    name = "icp"

    def __init__(self, settings: IcpSettings) -> None:
        self.settings, self.reference = settings, settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        if self.settings.filter:
            frame = replace(frame, depth_z_m=filtered(frame.depth_z_m))
        return pyramid(frame, camera, len(self.settings.iterations), normal_step=self.settings.normal_step)

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        s, levels = self.settings, []
        for n in (n for n in reversed(range(len(reference))) if s.iterations[n]):
            planes = Planes(s.most_distance_m, s.most_angle_deg, s.strides[n], s.nu, s.both, s.spread)
            term = PlaneTerm(reference[n], current[n], planes)
            levels.append((term, Descent(s.iterations[n], -np.inf, s.smallest_step), term.pixels))
        return descend(
            levels, guess, Limits(s.largest_step_m, least_eigenvalue=0.0 if s.spread else DEGENERATE, prior_m=s.prior_m)
        )


def filtered(depth_z_m: np.ndarray) -> np.ndarray:
    """Bilateral; what is missing lies too far off to weigh, and stays missing."""
    smooth = cv2.bilateralFilter(depth_z_m, 13, 0.03, 4.5)
    return np.where(depth_z_m > 0, smooth, np.float32(0))
