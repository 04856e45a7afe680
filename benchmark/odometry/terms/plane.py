"""Point-to-plane residuals with projective association: R. Newcombe et al., "KinectFusion", ISMAR
2011, section 3.5.
"""

import math
from dataclasses import dataclass

import numpy as np
from iclnuim.geometry.se3 import SE3

from .. import kernels
from ..certainty import GRID, disagreement, jackknife_information
from ..levels import Level, Pair
from ..normal_equations import NormalEquations
from ..solver import MIN_EIGENVALUE, SolverLimits, Stop


@dataclass(frozen=True)
class IcpSettings:
    """Settings of the geometric term and of the odometer. Tuples run from fine to coarse. The
    defaults are KinectFusion's (Newcombe 2011, section 3.5), as Kintinuous runs it.

    A frame is noisy (from a sensor) if its normals three pixels apart differ by more than
    MAX_ROUGHNESS. Its normals are then computed over rough_step pixels.
    """

    # maximum on each level (Newcombe 2011, section 3.5: z_max); 0: level not used
    iterations: tuple[int, ...] = (10, 5, 4)
    strides: tuple[int, ...] = (1, 1, 1)  # distance between the rows and columns that are used
    bilateral: bool = True  # depth filter, 13 x 13, 4.5 px, 30 mm
    # thresholds of distance and normals (Newcombe 2011, section 3.5), in Kintinuous' ICPOdometry
    max_distance_m: float = 0.10
    max_angle_deg: float = 20.0
    nu: float = 0.0  # degrees of freedom of Student's t; 0: least squares
    # products of the residuals along the normals of both images, as information; not squares along
    # one normal
    two_normals: bool = False
    noise_share: float = 1.0  # share of the disagreement of two normals that counts as noise
    rough_step: int = 0  # pixels; 0: no frame counts as noisy
    stop: Stop = Stop()
    limits: SolverLimits = SolverLimits(min_eigenvalue=MIN_EIGENVALUE)
    reference: str = "frame"


class PlaneTerm:
    """Point-to-plane equations in metres on one level. distance_m: RMS distance between the
    surfaces where the term was first linearised.
    """

    def __init__(self, pair: Pair, settings: IcpSettings, level: int) -> None:
        self.settings = settings
        self.reference = pair.reference[level]
        current = pair.current[level]
        self.pixels, self.seen = kernels.surface_points(
            current.camera.intrinsics,
            current.depth_z_m,
            current.normals,
            settings.strides[level],
            GRID,
        )
        count = len(self.seen.points)
        self.residual = np.empty(count, np.float32)
        self.residual1 = np.empty(count, np.float32)
        self.J = np.empty((count, 6), np.float32)
        self.J1 = np.empty((count, 6), np.float32)
        self.sums = np.empty((GRID[0] * GRID[1], 34))
        self.sigma = 0.005  # a first scale; the fixed-point iteration forgets it
        self.disagreement = 0.0
        self.distance_m = math.nan

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        s = self.settings
        self._associate(T)
        if s.nu > 0:
            self.sigma = max(kernels.student_scale(self.residual, s.nu, self.sigma, 10), 1e-5)
        rows = (self.residual, self.J, self.residual, self.J)
        if s.two_normals:
            rows = (self.residual, self.J, self.residual1, self.J1)
        seen = self.seen
        kernels.block_sums(seen.points, rows, (self.sigma, s.nu), seen.blocks, self.sums)
        equations = NormalEquations.of_sums(self.sums.sum(axis=0))
        if math.isnan(self.distance_m):
            self.distance_m = math.sqrt(equations.error) if equations.count else math.inf
        if not s.two_normals:
            return equations
        if iteration == 0:
            self.disagreement = self._disagreement()
        # The disagreement of two corresponding normals is noise. With the depth steps of a sensor,
        # as much noise again can be common to both.
        noise = s.noise_share * self.disagreement * equations.weight
        return jackknife_information(equations.less_noise(noise), self.sums, s.nu)

    def _associate(self, T: SE3) -> None:
        level = self.reference
        kernels.plane_residuals(
            T.matrix,
            level.camera.intrinsics,
            self.seen,
            (level.depth_z_m, level.normals),
            (self.settings.max_distance_m, math.cos(math.radians(self.settings.max_angle_deg))),
            (self.residual, self.J, self.residual1, self.J1),
        )

    def _disagreement(self) -> float:
        """disagreement() of about 2000 pairs of normals."""
        step = len(self.residual) // 2000 + 1
        some = np.isfinite(self.residual[::step])
        return disagreement(np.sum(self.J[::step, :3][some] * self.J1[::step, :3][some], axis=1))


def roughness(level: Level) -> float:
    """Median of 1 - cosine of normals three pixels apart, which have no depth pixel in common."""
    normals = level.normals[::4]
    one = normals[:, :-3:4]
    other = normals[:, 3::4]
    both = (one[..., 2] != 0) & (other[..., 2] != 0)
    if not both.any():
        return 0.0
    return 1.0 - float(np.median(np.sum(one[both] * other[both], axis=-1)))
