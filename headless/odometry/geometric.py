"""The point-to-plane term on one pyramid level, for every odometer that has one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from . import kernels
from .pyramid import Level
from .system import System


@dataclass
class PlaneTerm:
    """Equations in metres, of every `stride`-th row and column. nu > 0: Student-t weights."""

    reference: Level
    current: Level
    most_distance_m: float = 0.10
    most_angle_deg: float = 20.0
    stride: int = 1
    nu: float = 0.0
    sigma: float = 0.005
    residual: np.ndarray = field(init=False)
    partner: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        h, w = self.current.depth_z_m.shape
        self.residual = np.empty((-(-h // self.stride), -(-w // self.stride)), np.float32)
        self.partner = np.zeros(self.residual.shape, np.int32)

    def __call__(self, T: np.ndarray, iteration: int) -> System:
        one, two = self.reference, self.current
        kernels.plane_residuals(
            T,
            one.k,
            one.depth_z_m,
            one.normals,
            two.depth_z_m,
            two.normals,
            self.stride,
            self.most_distance_m,
            math.cos(math.radians(self.most_angle_deg)),
            self.residual,
            self.partner,
        )
        if self.nu > 0:
            self.sigma = max(kernels.student_scale(self.residual, self.nu, self.sigma, 10), 1e-5)
        rows = np.zeros((len(self.residual), kernels.SUMS))
        kernels.plane_sums(
            T, one.k, one.normals, two.depth_z_m, self.stride, self.residual, self.partner, self.sigma, self.nu, rows
        )
        return System.of_rows(rows)
