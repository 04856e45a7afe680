"""FOVIS: A. Huang et al., "Visual odometry and mapping for autonomous flight using an RGB-D
camera", ISRR 2011.

Corners are matched by appearance. Matches with consistent distances are inliers, and the motion
minimizes their reprojection error in both images (section 3.5).
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from numba import njit

from . import kernels
from .certainty import ACROSS, DOWN, jackknife_information
from .depth_term import LOOSE, DepthTerm, inlier_weights, scale_ambiguity
from .features import Features, Matches, consistent, features, match
from .protocol import Frame, Result, Status, failure
from .solver import Limits, Pass, Stop, System, solve

#: The initial rotation is estimated on small images: their rows, the iterations, and the size of
#: the Gaussian blur.
SMALL_ROWS, ROTATION_ITERATIONS, BLUR = 30, 30, 5
#: A preliminary motion is iterated until a step is shorter than this (metres, radians; half a
#: pixel).
ROUGH_STEP = 1e-3
#: Maximum number of evaluations of the geometric term.
MAX_EVALUATIONS = 3
#: If a larger share agrees near the prediction (noisy frames: 0.42 and more), the wide search is
#: skipped.
HIGH_AGREEMENT = 0.35


@dataclass(frozen=True)
class FovisSettings:
    """The defaults are those of the paper, and of the authors' program (fovis 1.2) where the paper
    has none. Corners are maxima of the structure tensor instead of FAST's.
    """

    levels: int = 3
    count: int = 1229  # corners per frame: one per 250 pixels ("target-pixels-per-feature")
    searches_px: tuple[float, ...] = (
        25.0,
    )  # search radii around the position predicted by the current motion
    precision_px: float = 0.01  # a corner's position is refined until a step is shorter
    #: If a smaller share of the matches agrees, a rotation is estimated from small images, and the
    #: motion with more inliers is used; 1: always (section 3.2).
    rotate_below: float = 1.0
    max_distance_m: float = 0.1  # maximum difference of two consistent distances
    max_error_px: float = 1.5  # maximum error of an inlier
    min_agreement: float = 0.1  # minimum share of inliers; unrelated images have up to 0.07
    min_inliers: int = 10
    nu: float = (
        0.0  # degrees of freedom of Student's t, whose equations are information; 0: least squares
    )
    iterations: int = 6
    limits: Limits = Limits(min_inliers=0.0)
    stop: Stop = Stop(min_step=1e-4)
    depth: bool = False  # the geometric term selects the corners and checks the motion
    level_weights: bool = False  # weights of residuals are inverse to the pixel size of their level
    reference: str = "matches"


class Fovis:
    name = "fovis"
    PRESETS = {
        "paper": FovisSettings(),
        "best": FovisSettings(
            searches_px=(25.0, 4.0),
            # unrelated images: up to 0.07, furnished rooms: 0.4 and more
            rotate_below=0.25,
            nu=5.0,
            stop=Stop(min_step=1e-5),
            depth=True,
            level_weights=True,
            limits=Limits(min_inliers=0.0, prior_m=0.03),
            reference="matched-keyframe",
        ),
    }

    def __init__(self, settings: FovisSettings) -> None:
        self.settings = settings
        self.reference = settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Features:
        return features(frame, camera, self.settings.levels, self.settings.count)

    def align(self, reference: Features, current: Features, guess: SE3) -> Result:
        s = self.settings
        if min(len(reference.uv), len(current.uv)) < s.min_inliers:
            return failure("features: too few corners with depth")
        far, near = s.searches_px[0], s.searches_px[-1]
        depth = DepthTerm(reference.half, current.half) if s.depth else None
        found = self._search(reference, current, guess, near, depth)
        if far > near and found.share < HIGH_AGREEMENT:
            found = self._search(reference, current, guess, far, depth)
        if found.share < s.rotate_below:
            again = self._search(
                reference, current, _estimate_rotation(reference, current, guess), far, depth
            )
            found = again if len(again.inliers) > len(found.inliers) else found
        if far > near and found.search_px == far and not found.reason:
            found = self._search(reference, current, found.T, near, depth)
        if found.reason:
            return failure(found.reason)
        result = self._refine(found, reference.camera)
        return depth.final(result) if depth else result

    def _search(
        self,
        reference: Features,
        current: Features,
        start: SE3,
        search_px: float,
        depth: DepthTerm | None,
    ) -> "Candidate":
        """Match corners within `search_px` of the positions predicted by `start`; only the last
        search refines them fully.
        """
        s, camera = self.settings, reference.camera
        expected_uv = camera.project(start.inverse().apply(reference.points_m))
        last = search_px == s.searches_px[-1]
        precision_px = s.precision_px if last else 0.5
        found = match(reference, current, expected_uv, search_px, precision_px)
        agreeing = found.chosen(consistent(found.points0_m, found.points1_m, s.max_distance_m))
        if len(agreeing) < s.min_inliers:
            reason = f"features: {len(agreeing)} consistent matches, fewer than {s.min_inliers}"
            return Candidate(start, agreeing, 0.0, search_px, reason)
        T = start
        if depth:
            term = ReprojectionTerm(agreeing, camera, s, loose=True)
            T = self._estimate(term, T, depth)
            agreeing = replace(agreeing, weight=term.inlier_weights(depth.at(T), T))
        T = self._estimate(ReprojectionTerm(agreeing, camera, s), T)
        errors_px = np.linalg.norm(
            camera.project(T.apply(agreeing.points1_m)) - agreeing.uv0, axis=1
        )
        inliers = agreeing.chosen(errors_px <= s.max_error_px)
        few = len(inliers) < max(s.min_agreement * len(found), s.min_inliers)
        reason = f"features: {len(inliers)} of {len(found)} matches are inliers" if few else ""
        return Candidate(T, inliers, len(inliers) / len(found), search_px, reason)

    def _estimate(
        self,
        term: "ReprojectionTerm",
        T: SE3,
        depth: DepthTerm | None = None,
        min_step: float = ROUGH_STEP,
    ) -> SE3:
        """The motion without its uncertainty, iterated from T until a step is shorter than
        min_step. With `depth`, the geometric term
        is added, and evaluated again after the points have moved."""
        s, total_twist = self.settings, np.zeros(6)
        prior = np.full(6, s.limits.prior_m**-2 if s.limits.prior_m else 1e-9)
        for _ in range(MAX_EVALUATIONS if depth else 1):
            A, b = np.diag(prior), -prior * total_twist
            if depth:
                geometry = depth.evaluate(T)
                A, b = A + geometry.A, b + geometry.b
            T, step = term.solved(T, A, b, min_step)
            total_twist += step
            if np.abs(step).max() < ROUGH_STEP:
                break
        return T

    def _refine(self, found: "Candidate", camera: PinholeCamera) -> Result:
        """The motion from the inliers, with its uncertainty."""
        s, count = self.settings, len(found.inliers)
        term = ReprojectionTerm(found.inliers, camera, s)
        # the uncertainty is computed only at the optimum
        T = self._estimate(term, found.T, min_step=s.stop.min_step) if s.nu else found.T
        result = solve([Pass(term, s.iterations, 4 * count, s.stop)], T, s.limits)
        if result.status is Status.FAILED:
            return result
        return replace(result, matches=count, inliers=found.share)


class Candidate(NamedTuple):
    """A preliminary motion, its inliers, and their share of all matches; reason: why there is no
    motion.
    """

    T: SE3
    inliers: Matches
    share: float
    search_px: float
    reason: str


class ReprojectionTerm:
    """Equations in pixels: the reprojection errors of each frame's points in the other image.

    loose: the inverse depth of each match has an unknown factor, which is eliminated (as for the
    tiles of `photometric`). A corner in a mirror or behind glass then still constrains the motion.
    """

    def __init__(
        self, matches: Matches, camera: PinholeCamera, settings: FovisSettings, loose: bool = False
    ) -> None:
        self.settings, self.loose, self.sigma = settings, loose, 1.0
        m, weight = (
            matches,
            matches.weight * (2.0**-matches.level if settings.level_weights else 1.0),
        )
        self.seen = (camera.intrinsics, m.points0_m, m.uv0, m.points1_m, m.uv1, weight)
        across, down = (
            (matches.uv0 * (ACROSS, DOWN) / (camera.width, camera.height)).astype(np.int16).T
        )
        self.blocks, self.sums = np.repeat(down * ACROSS + across, 4), np.empty((ACROSS * DOWN, 34))

    def __call__(self, T: SE3, iteration: int) -> System:
        s, (arms, residual, J) = self.settings, reprojections(T.matrix, *self.seen)
        if s.nu:
            self.sigma = max(kernels.student_scale(residual, s.nu, self.sigma, 10), 1e-3)
        kernels.block_sums(arms, J, residual, J, residual, self.sigma, s.nu, self.blocks, self.sums)
        system = System.of_sums(self.sums.sum(axis=0))
        return jackknife_information(system, self.sums, s.nu) if s.nu else system

    def solved(
        self, T: SE3, A: np.ndarray, b: np.ndarray, min_step: float
    ) -> tuple[SE3, np.ndarray]:
        """The optimal pose and the twist (6,) from T to it.

        A x = b are further equations (information) for this twist x.
        """
        s = self.settings
        rule = (self.loose, s.nu, self.sigma, A, b, s.iterations, min_step)
        found, total_twist, self.sigma = least_squares(T.matrix, self.seen, *rule)
        return SE3(found[:3, :3], found[:3, 3]), total_twist

    def inlier_weights(self, geometry: System, T: SE3) -> np.ndarray:
        """Weights (n,), 0..1, of the residuals, at the solution T of the loose equations: small
        where depth is an outlier.
        """
        _, residual, J = reprojections(T.matrix, *self.seen)
        factor, stiff = free_depth(T.translation, J, residual, (self.sigma / LOOSE) ** 2)
        ambiguity = scale_ambiguity(geometry, T.translation)
        kept = inlier_weights(factor, self.sigma**2 / np.maximum(stiff, 1e-12), ambiguity)
        return np.sqrt(kept + (1.0 - kept) * ambiguity)


@njit(cache=True)
def reprojections(T, k, points0, uv0, points1, uv1, weight):
    """(arms (4 n, 3), residuals (4 n,), Jacobian (4 n, 6) by a twist), per match: u and v in the
    reference's image, u and v in the
    current one.

    T (4, 4) is T_reference_current; arms are the points in the reference's frame.
    """
    n = len(weight)
    arms, residual, J = np.empty((4 * n, 3)), np.empty(4 * n), np.empty((4 * n, 6))
    slope, p = np.empty(3), np.empty(3)
    for i in range(4 * n):
        m, back, along_v = i // 4, i % 4 >= 2, i % 2
        uv, other = (uv1, points0) if back else (uv0, points1)
        for a in range(3):
            if back:
                arms[i, a] = other[m, a]
                p[a] = 0.0
                for b in range(3):
                    p[a] += T[b, a] * (other[m, b] - T[b, 3])
            else:
                arms[i, a] = T[a, 3]
                for b in range(3):
                    arms[i, a] += T[a, b] * other[m, b]
                p[a] = arms[i, a]
        f, w = k[along_v], weight[m]
        residual[i] = w * (uv[m, along_v] - k[2 + along_v] - f * p[along_v] / p[2])
        slope[1 - along_v], slope[along_v], slope[2] = (
            0.0,
            w * f / p[2],
            -w * f * p[along_v] / p[2] ** 2,
        )
        for a in range(3):
            J[i, a] = slope[a]
            if back:  # the motion of the other camera has the opposite sign
                J[i, a] = -(T[a, 0] * slope[0] + T[a, 1] * slope[1] + T[a, 2] * slope[2])
        x, y, z = arms[i]
        J[i, 3], J[i, 4] = y * J[i, 2] - z * J[i, 1], z * J[i, 0] - x * J[i, 2]
        J[i, 5] = x * J[i, 1] - y * J[i, 0]
    return arms, residual, J


@njit(cache=True)
def least_squares(T, seen, loose, nu, sigma, A, b, iterations, min_step):
    """(T, the twist (6,) to it, scale of Student's t), by Gauss-Newton from T (4, 4); A x = b are
    further equations for that twist.

    seen: the arguments of reprojections() after the pose. Units are those of the residuals' mean
    square.
    """
    gone = np.zeros(6)
    for _ in range(iterations):
        arms, residual, J = reprojections(T, *seen)
        if loose:
            free_depth(T[:3, 3], J, residual, (sigma / LOOSE) ** 2)
        if nu > 0:
            sigma = max(kernels.student_scale(residual, nu, sigma, 10), 1e-3)
        s = kernels.sums(arms, J, residual, J, residual, sigma, nu)
        scale, n = s[28] / max(s[27], 1e-12), 0
        left, right = A.copy(), b - A @ gone
        for a in range(6):
            for c in range(a, 6):
                left[a, c] += scale * s[n]
                left[c, a] = left[a, c]
                n += 1
            right[a] += scale * s[21 + a]
        step = np.linalg.solve(left, right)
        T, gone = moved(T, step), gone + step
        if np.abs(step).max() < min_step:
            break
    return T, gone, sigma


@njit(cache=True)
def moved(T, twist):
    """(4, 4): exp(twist) T (as SE3.exp, for rotations of less than 180 degrees)."""
    x, y, z = twist[3:]
    angle = np.sqrt(x * x + y * y + z * z)
    a, b, c = 1.0, 0.5, 1.0 / 6.0
    if angle > 1e-4:
        a = np.sin(angle) / angle
        b, c = 2.0 * (np.sin(angle / 2) / angle) ** 2, (1.0 - a) / angle**2
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    squared, out = k @ k, np.eye(4)
    out[:3, :3] += a * k + b * squared
    out[:3, 3] = twist[:3] + b * (k @ twist[:3]) + c * (squared @ twist[:3])
    return out @ T


@njit(cache=True)
def free_depth(t, J, residual, prior):
    """(factor (n,) of each match's inverse depth, g^T g (n,)), where g is the derivative of the
    match's 4 residuals by that factor.

    Modifies J and residual so that their squares are the equations with the factor eliminated
    (Schur complement). t (3,) is the translation of T_reference_current.
    """
    n, g = len(residual) // 4, np.empty(4)
    factor, stiff = np.empty(n), np.empty(n)
    for m in range(n):
        squares = product = 0.0
        for i in range(4):
            row = J[4 * m + i]
            g[i] = row[0] * t[0] + row[1] * t[1] + row[2] * t[2]
            squares += g[i] * g[i]
            product += g[i] * residual[4 * m + i]
        factor[m], stiff[m] = 1.0 + product / (squares + prior), squares
        left = (1.0 - np.sqrt(prior / (squares + prior))) / max(squares, 1e-30)
        for i in range(4):
            residual[4 * m + i] -= left * product * g[i]
        for a in range(6):
            slope = 0.0
            for i in range(4):
                slope += g[i] * J[4 * m + i, a]
            for i in range(4):
                J[4 * m + i, a] -= left * slope * g[i]
    return factor, stiff


def _estimate_rotation(reference: Features, current: Features, guess: SE3) -> SE3:
    """The guess with a rotation estimated from small images (section 3.2); the guess itself if the
    estimation fails.
    """
    camera, rows = reference.camera, min(SMALL_ROWS, reference.camera.height)
    scale = rows / camera.height
    small0, small1 = (
        cv2.resize(
            f.images[-1], (max(round(camera.width * scale), 1), rows), interpolation=cv2.INTER_AREA
        )
        for f in (reference, current)
    )
    expected = _rigid_warp(
        reference.uv, camera.project(guess.inverse().apply(reference.points_m)), scale
    )
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, ROTATION_ITERATIONS, 1e-4)
    try:
        start, mask = expected.astype(np.float32), np.full(small0.shape, 255, np.uint8)
        found = cv2.findTransformECC(
            small0, small1, start, cv2.MOTION_EUCLIDEAN, criteria, mask, BLUR
        )[1]
    except cv2.error:
        return guess
    centre = (np.array([camera.cx, camera.cy]) + 0.5) * scale - 0.5
    roll = found[:, :2] @ expected[:, :2].T  # from the expected image to the current one
    shift = (roll @ (centre - expected[:, 2]) + found[:, 2] - centre) / (
        np.array([camera.fx, camera.fy]) * scale
    )
    return guess @ SE3(
        so3.exp(-np.array([-shift[1], shift[0], math.atan2(roll[1, 0], roll[0, 0])])), np.zeros(3)
    )


def _rigid_warp(uv0: np.ndarray, uv1: np.ndarray, scale: float) -> np.ndarray:
    """(2, 3): in-plane rotation and shift that map uv0 (n, 2) to uv1, in an image of `scale`."""
    uv0, uv1 = ((uv + 0.5) * scale - 0.5 for uv in (uv0, uv1))
    mean0, mean1 = np.median(uv0, axis=0), np.median(uv1, axis=0)
    (x0, y0), (x1, y1) = (uv0 - mean0).T, (uv1 - mean1).T
    angle = math.atan2(x0 @ y1 - y0 @ x1, x0 @ x1 + y0 @ y1)
    roll = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.c_[roll, mean1 - roll @ mean0]
