"""What depth says of a motion, at little cost: which parts of an image can be believed, and whether a motion can be."""

import math
from dataclasses import replace

import numpy as np

from ..geometry.se3 import SE3
from . import kernels
from .certainty import disagreement
from .protocol import Result, Status
from .solver import MAX_SIGMA_M, Level, System, small_twist

#: Every so many rows and columns are looked at.
STRIDE = 4
#: Farther apart, or with normals that differ by more, two points are no match (KinectFusion's distance).
MAX_DISTANCE_M, MIN_COSINE = 0.10, math.cos(math.radians(30.0))
#: Degrees of freedom of Student's t, and its first scale.
NU, SIGMA_M = 10.0, 0.005
#: With a smaller share of the points matched, depth shows another place and says nothing.
MIN_MATCHED = 0.2
#: Off by 2 cm a motion is wrong; where depth calls for one that is a third of this away, it is reported.
MAX_OFF_M = 0.02 / 3
#: Information (6, 6) of a motion found by depth alone about the one that it is to judge: 30 mm, where depth does not know.
PRIOR = np.eye(6) / 0.03**2
#: While the points move by less than this, their equations are taken along.
MAX_TAKEN_M = 0.002
#: Standard deviations of the factor between a part's inverse depth and the sensor's: loose at first, firm where depth holds.
LOOSE, FIRM = 1.0, 0.05
#: Equations that say nothing.
NOTHING = System(np.zeros((6, 6)), np.zeros(6), 0.0, 0.0, np.zeros(3), 1.0)


def length_unknown(geometry: System, t_m: np.ndarray) -> float:
    """How far the length of a motion t_m (3,) is not known by `geometry` (information): the share, 0..1, of a factor common to all
    parts of the image that nothing but these decide."""
    along = np.concatenate([t_m, np.zeros(3)]) / max(float(t_m @ t_m), 1e-12)
    variance = float(along @ np.linalg.solve(geometry.A + 1e-3 * np.eye(6), along))
    return variance / (variance + FIRM**2)


def believed(factor: np.ndarray, variance: np.ndarray, unknown: float) -> np.ndarray:
    """(n,) 0..1: whether a part's factor, known to `variance`, is 1 (Geman, McClure 1987), or as far as the length of the motion is
    unknown, that of most parts: one camera without depth knows no scale, and all can share one factor.
    """
    informed = variance < LOOSE**2
    most = float(np.median(factor[informed])) if informed.any() else 1.0
    off = factor / max(1.0 + (most - 1.0) * unknown, FIRM) - 1.0
    return 1.0 / (1.0 + off**2 / (FIRM**2 + variance)) ** 2


def _alone(geometry: System) -> np.ndarray:
    """The twist (6,) that depth alone calls for, held by PRIOR where it does not know."""
    return np.linalg.solve(geometry.A + PRIOR, geometry.b)


def _surprise(geometry: System, information: np.ndarray) -> float:
    """Squared distance, by its variance and its 6 degrees of freedom, of the motion that depth alone calls for from one known to
    `information` (6, 6)."""
    alone = _alone(geometry)
    variance = np.linalg.inv(geometry.A + PRIOR) + np.linalg.inv(information + 1e-3 * np.eye(6))
    return float(alone @ np.linalg.solve(variance, alone)) / 6


class DepthTerm:
    """Point-to-plane equations of one level, as information. Products of the residuals along both images' normals, whose noise is
    independent, less what the normals disagree about: a bare wall says nothing of the motions along it (docs/odometry.md).
    """

    def __init__(self, reference: Level, current: Level) -> None:
        self.reference = reference
        self.points, self.normals = kernels.depth_points(current.camera.intrinsics, current.depth_z_m, STRIDE)
        self.residual, self.cosine = np.empty((2, len(self.points)), np.float32)
        self.sigma, self.noise, self.looks = SIGMA_M, 0.0, 0
        self.system, self.T = NOTHING, SE3.identity()

    def at(self, T: SE3) -> System:
        """Equations at T_reference_current, from those of the last look."""
        return self.system.moved(small_twist(self.T, T))

    def look(self, T: SE3) -> System:
        """Equations at T_reference_current, looked up anew where the points moved."""
        if not self.looks or self.system.length_of(small_twist(self.T, T)) > MAX_TAKEN_M:
            self.system, self.looks, self.T = self._look(T), self.looks + 1, T
        return self.at(T)

    def judged(self, result: Result) -> Result:
        """The result, as certain as it is by depth; where depth calls for another motion, the one that agrees with both best.

        Both are not to be relied on where they are further off than MAX_OFF_M, or their deviation is larger than MAX_SIGMA_M.
        """
        if result.status is Status.FAILED or not self.looks:
            return result
        T = result.T_reference_camera
        self.look(SE3.exp(_alone(self.at(T))) @ T)
        geometry = self.at(T)
        ratio = max(_surprise(geometry, result.information), 1.0)
        sigma_m, information = result.largest_sigma_m * math.sqrt(ratio), result.information / ratio
        twist, _ = replace(geometry, A=geometry.A + information).step(np.zeros(6))
        off_m, status, reason = geometry.length_of(twist), result.status, result.reason
        if off_m > MAX_OFF_M:
            T, reason = SE3.exp(twist) @ T, f"depth: calls for a motion {off_m * 1e3:.0f} mm away"
        if off_m > MAX_OFF_M or sigma_m > MAX_SIGMA_M:
            status = Status.DEGENERATE
        return replace(
            result,
            T_reference_camera=T,
            status=status,
            information=information,
            largest_sigma_m=sigma_m,
            reason=reason,
        )

    def _look(self, T: SE3) -> System:
        level, found = self.reference, (self.residual, self.cosine)
        rule = (MAX_DISTANCE_M, MIN_COSINE, self.sigma, NU)
        sums = kernels.depth_sums(
            T.matrix, level.camera.intrinsics, self.points, self.normals, level.depth_z_m, *rule, *found
        )
        if sums[29] < max(6, MIN_MATCHED * len(self.points)):
            return NOTHING
        self.sigma = max(kernels.student_scale(self.residual, NU, self.sigma, 10), 1e-5)
        if self.looks == 0:
            self.noise = disagreement(self.cosine[np.isfinite(self.residual)])
        system = System.of_sums(sums)
        known = system.less_noise(self.noise * system.weight)
        twist = _alone(known.as_information(1.0))
        gain = float(twist @ (2 * system.b - system.A @ twist)) / system.weight
        # their error is what is left at the motion that they call for
        return replace(known, error=max(system.error - gain, 1e-2 * system.error)).as_information(1.0)
