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

from .candidates import pick
from .features import Features, consistent, features, match
from .protocol import Frame, OdometryResult, OdometryStatus, failure
from .solver import Pass, SolverLimits, Stop, solve
from .start import maximize_correlation
from .terms.depth import DepthTerm
from .terms.reprojection import Matches, ReprojectionTerm

#: The initial rotation is estimated on small images of this number of rows (section 3.2: a coarse
#: level of the pyramid).
SMALL_ROWS = 30
#: A preliminary motion is iterated until a step is shorter than this (metres, radians; half a
#: pixel): it only has to tell inliers from outliers.
ROUGH_STEP = 1e-3
#: Maximum number of evaluations of the geometric term: after the first one the points have moved
#: by centimetres, after the second by less than a step.
MAX_EVALUATIONS = 3


@dataclass(frozen=True)
class FovisSettings:
    """The defaults are those of the paper, and where it has none the options of the authors'
    program (fovis 1.2), named here. Corners are maxima of the structure tensor instead of FAST's.
    """

    levels: int = 3  # section 3.1: a Gaussian pyramid ("max-pyramid-level")
    count: int = 1229  # corners per frame: one per 250 pixels ("target-pixels-per-feature")
    # search radii around the position predicted by the current motion ("feature-search-window")
    searches_px: tuple[float, ...] = (25.0,)
    #: If a smaller share agrees in the narrow search, the wide one is used (noisy frames: 0.42 and
    #: more near the prediction).
    widen_below: float = 0.35
    #: If a smaller share of the matches agrees, a rotation is estimated from small images, and the
    #: motion with more inliers is used; 1: always (section 3.2).
    rotate_below: float = 1.0
    # maximum difference of two consistent distances ("clique-inlier-threshold")
    max_distance_m: float = 0.1
    max_error_px: float = 1.5  # of an inlier ("inlier-max-reprojection-error")
    min_agreement: float = 0.1  # minimum share of inliers; unrelated images have up to 0.07
    min_inliers: int = 10  # "min-features-for-estimate"
    # degrees of freedom of Student's t, whose equations are information; 0: least squares
    nu: float = 0.0
    iterations: int = 6  # of refineMotionEstimateBidirectional (section 3.5)
    limits: SolverLimits = SolverLimits(min_inliers=0.0)
    stop: Stop = Stop(min_step=1e-4)
    depth: bool = False  # the geometric term selects the corners and checks the motion
    reference: str = "matches"


class Preliminary(NamedTuple):
    """A preliminary motion, its inliers, and their share of all matches; reason: why there is no
    motion.
    """

    T: SE3
    inliers: Matches
    share: float
    search_px: float
    reason: str


class Fovis:
    name = "fovis"
    PRESETS = {
        "paper": FovisSettings(),
        "best": FovisSettings(
            searches_px=(25.0, 4.0),
            # unrelated images: up to 0.07, furnished rooms: 0.4 and more
            rotate_below=0.25,
            nu=5.0,  # Kerl 2013, section III-C
            stop=Stop(min_step=1e-5),
            depth=True,
            limits=SolverLimits(min_inliers=0.0, prior_m=0.03),
            reference="matched-keyframe",
        ),
    }

    def __init__(self, settings: FovisSettings) -> None:
        self.settings = settings
        self.reference = settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Features:
        """Corners with descriptions (section 3.1)."""
        return features(frame, camera, self.settings.levels, self.settings.count)

    def align(self, reference: Features, current: Features, guess: SE3) -> OdometryResult:
        """Sections 3.2 to 3.5: an initial rotation, matches, inliers, and their motion."""
        s = self.settings
        if min(len(reference.uv), len(current.uv)) < s.min_inliers:
            return failure("features: too few corners with depth")
        far = s.searches_px[0]
        near = s.searches_px[-1]
        search = _MatchSearch(reference, current, s)
        found = search.around(guess, near)
        if far > near and found.share < s.widen_below:
            found = search.around(guess, far)
        if found.share < s.rotate_below:
            rotated = estimate_rotation(reference, current, guess)
            found = pick(found, [search.around(rotated, far)], lambda one: len(one.inliers))
        if far > near and found.search_px == far and not found.reason:
            found = search.around(found.T, near)
        if found.reason:
            return failure(found.reason)
        result = search.refined(found)
        return search.depth.final(result) if search.depth else result


class _MatchSearch:
    """Matches of two frames, and the motions that they agree on."""

    def __init__(self, reference: Features, current: Features, settings: FovisSettings) -> None:
        self.reference = reference
        self.current = current
        self.settings = settings
        self.depth = DepthTerm(reference.half, current.half) if settings.depth else None

    def around(self, start: SE3, search_px: float) -> Preliminary:
        """Match corners within `search_px` of the positions predicted by `start` (section 3.3), and
        keep those that agree (section 3.4); only the last search refines positions fully.
        """
        s = self.settings
        camera = self.reference.camera
        expected_uv = camera.project(start.inverse().apply(self.reference.points_m))
        precision_px = 0.01 if search_px == s.searches_px[-1] else 0.5
        found = match(self.reference, self.current, expected_uv, search_px, precision_px)
        agreeing = found.chosen(consistent(found.points0_m, found.points1_m, s.max_distance_m))
        if len(agreeing) < s.min_inliers:
            reason = f"features: {len(agreeing)} consistent matches, fewer than {s.min_inliers}"
            return Preliminary(start, agreeing, 0.0, search_px, reason)
        T = start
        if self.depth:
            term = ReprojectionTerm(agreeing, camera, s.nu, loose=True)
            T = self._estimate(term, T, ROUGH_STEP, self.depth)
            weight = agreeing.weight * term.inlier_weights(self.depth.at(T), T)
            agreeing = replace(agreeing, weight=weight)
        T = self._estimate(ReprojectionTerm(agreeing, camera, s.nu), T, ROUGH_STEP)
        errors_px = camera.project(T.apply(agreeing.points1_m)) - agreeing.uv0
        inliers = agreeing.chosen(np.linalg.norm(errors_px, axis=1) <= s.max_error_px)
        reason = ""
        if len(inliers) < max(s.min_agreement * len(found), s.min_inliers):
            reason = f"features: {len(inliers)} of {len(found)} matches are inliers"
        return Preliminary(T, inliers, len(inliers) / len(found), search_px, reason)

    def _estimate(
        self, term: ReprojectionTerm, T: SE3, min_step: float, depth: DepthTerm | None = None
    ) -> SE3:
        """The motion without its uncertainty, iterated from T until a step is shorter than
        min_step. With `depth`, the geometric term is added, and evaluated again after the points
        have moved.
        """
        s = self.settings
        total_twist = np.zeros(6)
        prior = np.full(6, s.limits.prior_m**-2 if s.limits.prior_m else 1e-9)
        for _ in range(MAX_EVALUATIONS if depth else 1):
            A = np.diag(prior)
            b = -prior * total_twist
            if depth:
                geometry = depth.linearise(T)
                A = A + geometry.A
                b = b + geometry.b
            T, step = term.solved(T, A, b, s.iterations, min_step)
            total_twist += step
            if np.abs(step).max() < ROUGH_STEP:
                break
        return T

    def refined(self, found: Preliminary) -> OdometryResult:
        """The motion from the inliers (section 3.5), with its uncertainty."""
        s = self.settings
        term = ReprojectionTerm(found.inliers, self.reference.camera, s.nu)
        # the uncertainty is computed only at the optimum
        T = self._estimate(term, found.T, s.stop.min_step) if s.nu else found.T
        result = solve([Pass(term, s.iterations, s.stop)], T, s.limits)
        if result.status is OdometryStatus.FAILED:
            return result
        return replace(result, matches=len(found.inliers), inliers=found.share)


def estimate_rotation(reference: Features, current: Features, guess: SE3) -> SE3:
    """The guess with a rotation estimated from small images (section 3.2); the guess itself if the
    estimation fails.
    """
    camera = reference.camera
    rows = min(SMALL_ROWS, camera.height)
    scale = rows / camera.height
    size = (max(round(camera.width * scale), 1), rows)
    small0 = cv2.resize(reference.images[-1], size, interpolation=cv2.INTER_AREA)
    small1 = cv2.resize(current.images[-1], size, interpolation=cv2.INTER_AREA)
    uv1 = camera.project(guess.inverse().apply(reference.points_m))
    expected = _rigid_warp(_small(reference.uv, scale), _small(uv1, scale))
    found = maximize_correlation(small0, small1, expected.astype(np.float32))
    if found is None:
        return guess
    centre = _small(np.array([camera.cx, camera.cy]), scale)
    roll = found[:, :2] @ expected[:, :2].T  # from the expected image to the current one
    focal = np.array([camera.fx, camera.fy]) * scale
    shift = (roll @ (centre - expected[:, 2]) + found[:, 2] - centre) / focal
    angles = -np.array([-shift[1], shift[0], math.atan2(roll[1, 0], roll[0, 0])])
    return guess @ SE3(so3.exp(angles), np.zeros(3))


def _small(uv: np.ndarray, scale: float) -> np.ndarray:
    """Pixels in an image of `scale`; pixel centres are integers."""
    return (uv + 0.5) * scale - 0.5


def _rigid_warp(uv0: np.ndarray, uv1: np.ndarray) -> np.ndarray:
    """(2, 3): in-plane rotation and shift that map uv0 (n, 2) to uv1."""
    mean0 = np.median(uv0, axis=0)
    mean1 = np.median(uv1, axis=0)
    x0, y0 = (uv0 - mean0).T
    x1, y1 = (uv1 - mean1).T
    angle = math.atan2(x0 @ y1 - y0 @ x1, x0 @ x1 + y0 @ y1)
    roll = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.c_[roll, mean1 - roll @ mean0]
