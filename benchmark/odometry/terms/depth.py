"""The geometric term of the photometric and feature odometers: it finds the inlier parts of an
image, and checks the estimated motion.
"""

import math
from dataclasses import replace

import numpy as np
from iclnuim.geometry.se3 import SE3

from .. import kernels
from ..certainty import MAX_ROUGHNESS, disagreement, with_bias
from ..levels import Level
from ..normal_equations import NormalEquations, small_twist
from ..protocol import WRONG_M, OdometryResult, OdometryStatus
from ..solver import MAX_SIGMA_M
from .free_depth import invertible

#: Distance in pixels between the rows and columns that are used.
STRIDE = 4
#: Two points that are farther apart, or whose normals differ by more, do not match (the distance is
#: KinectFusion's).
MAX_DISTANCE_M = 0.10
MIN_COSINE = math.cos(math.radians(30.0))
#: Degrees of freedom of Student's t, as for the planes of ICP.
NU = 10.0
#: If a smaller share of the points is matched, the two depth images show different places, and
#: depth is not used.
MIN_MATCHED = 0.2
#: A frame is reported where depth disagrees with the motion by more than a third of what counts as
#: wrong.
MAX_DISAGREEMENT_M = WRONG_M / 3
#: Information (6, 6) of the prior of the depth-only motion: 30 mm about the motion to check, in
#: directions that depth does not observe.
PRIOR = np.eye(6) / 0.03**2
#: While the points move by less than this, their equations are reused.
MAX_REUSE_M = 0.002
NO_EQUATIONS = NormalEquations.of_information(np.zeros((6, 6)))


def _depth_only_twist(geometry: NormalEquations) -> np.ndarray:
    """The twist (6,) that minimizes the geometric error alone; PRIOR keeps it near 0 in
    unobservable directions.
    """
    return np.linalg.solve(geometry.A + PRIOR, geometry.b)


def _mahalanobis(geometry: NormalEquations, information: np.ndarray) -> float:
    """Squared Mahalanobis distance per degree of freedom (6) between the depth-only motion and one
    with `information` (6, 6).
    """
    depth_only = _depth_only_twist(geometry)
    variance = np.linalg.inv(geometry.A + PRIOR) + np.linalg.inv(invertible(information))
    return float(depth_only @ np.linalg.solve(variance, depth_only)) / 6


class DepthTerm:
    """Point-to-plane equations of one level, as information.

    They are products of the residuals along the normals of both images, whose noise is independent,
    minus the information that the disagreement of these normals explains: a bare wall gives none
    about motions along it.
    """

    def __init__(self, reference: Level, current: Level) -> None:
        self.reference = reference
        self.seen = kernels.depth_points(current.camera.intrinsics, current.depth_z_m, STRIDE)
        self.pixels = len(self.seen.points)
        self.residual = np.empty(self.pixels, np.float32)
        self.cosine = np.empty(self.pixels, np.float32)
        self.sigma = 0.005  # a first scale; the fixed-point iteration forgets it
        self.noise = 0.0
        self.evaluations = 0
        self.equations = NO_EQUATIONS
        self.T = SE3.identity()

    def at(self, T: SE3) -> NormalEquations:
        """Equations at T_reference_current, linearised at the last evaluation."""
        return self.equations.after_step(small_twist(self.T, T))

    def linearise(self, T: SE3, iteration: int = 0) -> NormalEquations:
        """Equations at T_reference_current; the points are associated again if they moved by more
        than MAX_REUSE_M.
        """
        moved_m = self.equations.length_of(small_twist(self.T, T))
        if not self.evaluations or moved_m > MAX_REUSE_M:
            self.equations = self._evaluate(T)
            self.evaluations += 1
            self.T = T
        return self.at(T)

    def checked(self, result: OdometryResult) -> OdometryResult:
        """The result with the uncertainty that follows from depth. If depth disagrees by more than
        MAX_DISAGREEMENT_M, its motion is the joint optimum of both.

        The result is DEGENERATE if depth disagrees by more than MAX_DISAGREEMENT_M, or the standard
        deviation is above MAX_SIGMA_M.
        """
        if result.status is OdometryStatus.FAILED or not self.evaluations:
            return result
        T = result.T_reference_camera
        self.linearise(SE3.exp(_depth_only_twist(self.at(T))) @ T)
        geometry = self.at(T)
        ratio = max(_mahalanobis(geometry, result.information), 1.0)
        sigma_m = result.largest_sigma_m * math.sqrt(ratio)
        information = result.information / ratio
        checked = replace(result, information=information, largest_sigma_m=sigma_m)
        if sigma_m > MAX_SIGMA_M:
            checked = replace(checked, status=OdometryStatus.DEGENERATE)
        twist, _ = replace(geometry, A=geometry.A + information).step(np.zeros(6))
        disagreement_m = geometry.length_of(twist)
        if disagreement_m <= MAX_DISAGREEMENT_M:
            return checked
        return replace(
            checked,
            T_reference_camera=SE3.exp(twist) @ T,
            status=OdometryStatus.DEGENERATE,
            reason=f"depth: disagrees with the motion by {disagreement_m * 1e3:.0f} mm",
        )

    def final(self, result: OdometryResult) -> OdometryResult:
        """checked(), and with the bias of the sensor, if depth is noisy."""
        result = self.checked(result)
        # not self.noise: at the first pose a wrong rotation adds to it
        noisy = self.evaluations > 0 and self._disagreement() > MAX_ROUGHNESS
        return with_bias(result, self.reference.calibrated) if noisy else result

    def _disagreement(self) -> float:
        """disagreement() of the normals at the last evaluation."""
        return disagreement(self.cosine[np.isfinite(self.residual)])

    def _evaluate(self, T: SE3) -> NormalEquations:
        sums = kernels.depth_sums(
            T.matrix,
            self.reference.camera.intrinsics,
            self.seen,
            self.reference.depth_z_m,
            (MAX_DISTANCE_M, MIN_COSINE, self.sigma, NU),
            (self.residual, self.cosine),
        )
        if sums[29] < max(6, MIN_MATCHED * self.pixels):
            return NO_EQUATIONS
        self.sigma = max(kernels.student_scale(self.residual, NU, self.sigma, 10), 1e-5)
        if self.evaluations == 0:
            self.noise = self._disagreement()
        equations = NormalEquations.of_sums(sums)
        known = equations.less_noise(self.noise * equations.weight)
        twist = _depth_only_twist(known.as_information(1.0))
        gain = float(twist @ (2 * equations.b - equations.A @ twist)) / equations.weight
        # the error that remains at the depth-only motion
        left = max(equations.error - gain, 1e-2 * equations.error)
        return replace(known, error=left).as_information(1.0)
