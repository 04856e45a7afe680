"""ICP: point-to-plane with projective association, R. Newcombe et al., "KinectFusion", ISMAR 2011, section 3.5."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import PinholeCamera
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
    #: of frames whose normals are rough with noise: over +-3 pixels, all within 30 degrees, none outweighed; 0: never
    rough_step: int = 0


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
        rough_step=3,
    ),
}


#: Roughness of a sensor's frames; `released` noise has 0.006.
ROUGH = 1e-3


class Icp:
    name = "icp"

    def __init__(self, settings: IcpSettings) -> None:
        self.settings, self.reference = settings, settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        if self.settings.filter:
            frame = replace(frame, depth_z_m=filtered(frame.depth_z_m))
        s = self.settings
        levels = pyramid(frame, camera, len(s.iterations), normal_step=s.normal_step)
        if s.rough_step and roughness(levels[min(1, len(levels) - 1)]) > ROUGH:
            levels = [replace(level, normal_step=s.rough_step) for level in levels]
        return levels

    def align(self, reference: list[Level], current: list[Level], guess: np.ndarray) -> Result:
        s, levels = self.settings, []
        rough = s.rough_step and current[0].normal_step == s.rough_step
        if rough:
            s = replace(s, most_angle_deg=30.0, nu=0.0)
        for n in (n for n in reversed(range(len(reference))) if s.iterations[n]):
            planes = Planes(
                s.most_distance_m, s.most_angle_deg, s.strides[n], s.nu, s.both, s.spread, 0.25 if rough else 1.0
            )
            term = PlaneTerm(reference[n], current[n], planes)
            levels.append((term, Descent(s.iterations[n], -np.inf, s.smallest_step), term.pixels))
        return descend(
            levels, guess, Limits(s.largest_step_m, least_eigenvalue=0.0 if s.spread else DEGENERATE, prior_m=s.prior_m)
        )


def roughness(level: Level) -> float:
    """1 - cosine of normals three pixels apart, which share no depth, in the median. Clean: below 1e-4."""
    normals = level.normals[::4]
    one, other = normals[:, :-3:4], normals[:, 3::4]
    both = (one[..., 2] != 0) & (other[..., 2] != 0)
    return 1.0 - float(np.median(np.sum(one[both] * other[both], axis=-1))) if both.any() else 0.0


def filtered(depth_z_m: np.ndarray) -> np.ndarray:
    """Bilateral; what is missing lies too far off to weigh, and stays missing."""
    smooth = cv2.bilateralFilter(depth_z_m, 13, 0.03, 4.5)
    return np.where(depth_z_m > 0, smooth, np.float32(0))
