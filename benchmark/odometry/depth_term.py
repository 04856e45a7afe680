"""The geometric term of the photometric and feature odometers: it finds the inlier parts of an
image, and checks the estimated motion.
"""

import math
from dataclasses import replace

import numpy as np
from iclnuim.geometry.se3 import SE3

from . import kernels
from .certainty import MAX_ROUGHNESS, disagreement, with_bias
from .protocol import WRONG_M, Result, Status
from .solver import MAX_SIGMA_M, Level, System, small_twist

#: Distance in pixels between the rows and columns that are used.
STRIDE = 4
#: Two points that are farther apart, or whose normals differ by more, do not match (the distance is
#: KinectFusion's).
MAX_DISTANCE_M, MIN_COSINE = 0.10, math.cos(math.radians(30.0))
#: Degrees of freedom of Student's t, and its initial scale.
NU, SIGMA_M = 10.0, 0.005
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
#: Standard deviations of the factor between the inverse depth of an image part and the sensor's:
#: loose at first, firm for inliers.
LOOSE, FIRM = 1.0, 0.05
#: Information of a weak prior, and its least share of the trace of the equations it is added to:
#: less is lost in rounding.
WEAK, MIN_SHARE = 1e-3, 1e-12
#: Equations without information.
NO_EQUATIONS = System(np.zeros((6, 6)), np.zeros(6), 0.0, 0.0, np.zeros(3), 1.0)


def scale_ambiguity(geometry: System, t_m: np.ndarray) -> float:
    """Scale ambiguity, 0..1, of a translation t_m (3,) given `geometry` (information): 0 where
    geometry determines its length,
    1 where only the parts of the image do, through a factor common to all of them."""
    along = np.concatenate([t_m, np.zeros(3)]) / max(float(t_m @ t_m), 1e-12)
    variance = float(along @ np.linalg.solve(_invertible(geometry.A), along))
    return variance / (variance + FIRM**2)


def inlier_weights(factor: np.ndarray, variance: np.ndarray, ambiguity: float) -> np.ndarray:
    """Weights (n,), 0..1, of parts of the image (Geman, McClure 1987): near 1 where the factor,
    with its `variance`, is near the
    expected one.

    The expected factor is 1 and, as far as the scale is ambiguous, the median of the parts with a
    small variance: a monocular camera does not observe scale, and all parts can have one common
    factor.
    """
    observed = variance < LOOSE**2
    median = float(np.median(factor[observed])) if observed.any() else 1.0
    deviation = factor / max(1.0 + (median - 1.0) * ambiguity, FIRM) - 1.0
    return 1.0 / (1.0 + deviation**2 / (FIRM**2 + variance)) ** 2


def _invertible(information: np.ndarray) -> np.ndarray:
    """(6, 6): `information` with a weak prior.

    Exact depth of a plane alone gives 1e14 in some directions and none in others.
    """
    return information + max(WEAK, MIN_SHARE * float(np.trace(information))) * np.eye(6)


def _depth_only_twist(geometry: System) -> np.ndarray:
    """The twist (6,) that minimizes the geometric error alone; PRIOR keeps it near 0 in
    unobservable directions.
    """
    return np.linalg.solve(geometry.A + PRIOR, geometry.b)


def _mahalanobis(geometry: System, information: np.ndarray) -> float:
    """Squared Mahalanobis distance per degree of freedom (6) between the depth-only motion and one
    with `information` (6, 6).
    """
    depth_only = _depth_only_twist(geometry)
    variance = np.linalg.inv(geometry.A + PRIOR) + np.linalg.inv(_invertible(information))
    return float(depth_only @ np.linalg.solve(variance, depth_only)) / 6


class DepthTerm:
    """Point-to-plane equations of one level, as information.

    They are products of the residuals along the normals of both images, whose noise is independent,
    minus the information that the disagreement of these normals explains: a bare wall gives none
    about motions along it (docs/measured/odometry.md).
    """

    def __init__(self, reference: Level, current: Level) -> None:
        self.reference = reference
        self.points, self.normals = kernels.depth_points(
            current.camera.intrinsics, current.depth_z_m, STRIDE
        )
        self.residual, self.cosine = np.empty((2, len(self.points)), np.float32)
        self.sigma, self.noise, self.evaluations = SIGMA_M, 0.0, 0
        self.system, self.T = NO_EQUATIONS, SE3.identity()

    def at(self, T: SE3) -> System:
        """Equations at T_reference_current, linearised at the last evaluation."""
        return self.system.after_step(small_twist(self.T, T))

    def evaluate(self, T: SE3) -> System:
        """Equations at T_reference_current; the points are associated again if they moved by more
        than MAX_REUSE_M.
        """
        if not self.evaluations or self.system.length_of(small_twist(self.T, T)) > MAX_REUSE_M:
            self.system, self.evaluations, self.T = self._evaluate(T), self.evaluations + 1, T
        return self.at(T)

    def checked(self, result: Result) -> Result:
        """The result with the uncertainty that follows from depth. If depth disagrees by more than
        MAX_DISAGREEMENT_M, its motion is
        the joint optimum of both.

        The result is DEGENERATE if depth disagrees by more than MAX_DISAGREEMENT_M, or the standard
        deviation is above MAX_SIGMA_M.
        """
        if result.status is Status.FAILED or not self.evaluations:
            return result
        T = result.T_reference_camera
        self.evaluate(SE3.exp(_depth_only_twist(self.at(T))) @ T)
        geometry = self.at(T)
        ratio = max(_mahalanobis(geometry, result.information), 1.0)
        sigma_m, information = result.largest_sigma_m * math.sqrt(ratio), result.information / ratio
        twist, _ = replace(geometry, A=geometry.A + information).step(np.zeros(6))
        disagreement_m, status, reason = geometry.length_of(twist), result.status, result.reason
        if disagreement_m > MAX_DISAGREEMENT_M:
            T, reason = (
                SE3.exp(twist) @ T,
                f"depth: disagrees with the motion by {disagreement_m * 1e3:.0f} mm",
            )
        if disagreement_m > MAX_DISAGREEMENT_M or sigma_m > MAX_SIGMA_M:
            status = Status.DEGENERATE
        return replace(
            result,
            T_reference_camera=T,
            status=status,
            information=information,
            largest_sigma_m=sigma_m,
            reason=reason,
        )

    def final(self, result: Result) -> Result:
        """checked(), and with the bias of the sensor, if depth is noisy."""
        result = self.checked(result)
        # not self.noise: at the first pose a wrong rotation adds to it
        noisy = self.evaluations > 0 and self._disagreement() > MAX_ROUGHNESS
        return with_bias(result, self.reference.calibrated) if noisy else result

    def _disagreement(self) -> float:
        """disagreement() of the normals at the last evaluation."""
        return disagreement(self.cosine[np.isfinite(self.residual)])

    def _evaluate(self, T: SE3) -> System:
        level, found = self.reference, (self.residual, self.cosine)
        rule = (MAX_DISTANCE_M, MIN_COSINE, self.sigma, NU)
        sums = kernels.depth_sums(
            T.matrix,
            level.camera.intrinsics,
            self.points,
            self.normals,
            level.depth_z_m,
            *rule,
            *found,
        )
        if sums[29] < max(6, MIN_MATCHED * len(self.points)):
            return NO_EQUATIONS
        self.sigma = max(kernels.student_scale(self.residual, NU, self.sigma, 10), 1e-5)
        if self.evaluations == 0:
            self.noise = self._disagreement()
        system = System.of_sums(sums)
        known = system.less_noise(self.noise * system.weight)
        twist = _depth_only_twist(known.as_information(1.0))
        gain = float(twist @ (2 * system.b - system.A @ twist)) / system.weight
        # the error that remains at the depth-only motion
        return replace(known, error=max(system.error - gain, 1e-2 * system.error)).as_information(
            1.0
        )
