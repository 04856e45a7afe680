"""FOVIS: A. Huang et al., "Visual odometry and mapping for autonomous flight using an RGB-D camera", ISRR 2011.

Corners are matched by their looks, kept where their distances agree, and the motion is where both frames' corners fall on
each other's (section 3.5).
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from ..geometry import so3
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from . import kernels
from .certainty import ACROSS, DOWN, informed
from .features import Features, Matches, consistent, features, match
from .protocol import Frame, Result, Status, failure
from .solver import SYMMETRIC, Limits, Pass, Stop, System, solve

#: The first rotation is found on images of so many rows, in so many iterations, blurred by so wide a Gaussian.
SMALL_ROWS, ROTATION_ITERATIONS, BLUR = 30, 30, 5
#: A motion that others only start from is found until a step is shorter (metres, radians; half a pixel).
ROUGH = 1e-3
#: Where a smaller share of the matches agrees (unrelated images: up to 0.07, furnished rooms: 0.4 and more), the prediction may have
#: missed a sudden turn: small images are asked.
FEW = 0.25


@dataclass(frozen=True)
class FovisSettings:
    """The defaults are the authors' own (fovis 1.2)."""

    levels: int = 3
    detector: str = "fast"
    count: int = 1229  # corners a frame: the authors' one in 250 pixels of 640x480
    searches_px: tuple[float, ...] = (25.0,)  # about where the motion found so far puts a corner
    precision_px: float = 0.1  # a corner's place is refined until a step is shorter
    strict: bool = False  # a corner whose place cannot be refined is dropped
    max_distance_m: float = 0.1  # between two distances that agree
    max_error_px: float = 1.5  # of an inlier
    min_agreement: float = 0.1  # share of the matches within it; of unrelated images up to 0.07
    min_inliers: int = 10
    nu: float = 0.0  # degrees of freedom of Student's t, which are information; 0: least squares
    iterations: int = 6
    limits: Limits = Limits(min_inliers=0.0)
    stop: Stop = Stop(min_step=1e-4)
    level_weights: bool = False  # a coarse level's pixel counts as what it is in the image
    reference: str = "matches"


class Fovis:
    name = "fovis"
    PRESETS = {
        "paper": FovisSettings(),
        "best": FovisSettings(
            detector="eigenvalue",
            searches_px=(25.0, 4.0),
            precision_px=0.01,
            strict=True,
            nu=5.0,
            stop=Stop(min_step=1e-5),
            level_weights=True,
            limits=Limits(min_inliers=0.0, prior_m=0.03),
        ),
    }

    def __init__(self, settings: FovisSettings) -> None:
        self.settings, self.reference = settings, settings.reference

    def prepare(self, frame: Frame, camera: PinholeCamera) -> Features:
        return features(frame, camera, self.settings.levels, self.settings.count, self.settings.detector)

    def align(self, reference: Features, current: Features, guess: SE3) -> Result:
        s = self.settings
        if min(len(reference.uv), len(current.uv)) < s.min_inliers:
            return failure("features: too few corners with depth")
        first, *others = s.searches_px
        found = self._around(reference, current, guess, first)
        if found.share < FEW:
            again = self._around(reference, current, _turned(reference, current, guess), first)
            found = again if len(again.inliers) > len(found.inliers) else found
        for search_px in others:
            if not found.reason:
                found = self._around(reference, current, found.T, search_px)
        return failure(found.reason) if found.reason else self._motion(found, reference.camera)

    def _around(self, reference: Features, current: Features, start: SE3, search_px: float) -> "Found":
        """With corners within `search_px` of where `start` puts them; their places are refined in the last search."""
        s, camera = self.settings, reference.camera
        expected_uv = camera.project(start.inverse().apply(reference.points_m))
        last = search_px == s.searches_px[-1]
        found = match(reference, current, expected_uv, search_px, s.precision_px if last else 0.5, s.strict)
        agreeing = found.chosen(consistent(found.points0_m, found.points1_m, s.max_distance_m))
        if len(agreeing) < s.min_inliers:
            return Found(start, agreeing, 0.0, f"features: {len(agreeing)} agree, fewer than {s.min_inliers}")
        T = self._rough(agreeing, camera, start)
        errors_px = np.linalg.norm(camera.project(T.apply(agreeing.points1_m)) - agreeing.uv0, axis=1)
        inliers = agreeing.chosen(errors_px <= s.max_error_px)
        few = len(inliers) < max(s.min_agreement * len(found), s.min_inliers)
        reason = f"features: {len(inliers)} of {len(found)} agree about a motion" if few else ""
        return Found(T, inliers, len(inliers) / len(found), reason)

    def _rough(self, matches: Matches, camera: PinholeCamera, start: SE3) -> SE3:
        """The motion that others only start from, until a step is shorter than ROUGH."""
        s, T, term = self.settings, start, ReprojectionTerm(matches, camera, self.settings)
        prior = np.full(6, s.limits.prior_m**-2 if s.limits.prior_m else 1e-9)
        gone = np.zeros(6)
        for _ in range(s.iterations):
            A, b = term.equations(T)
            step = np.linalg.solve(A + np.diag(prior), b - prior * gone)
            T, gone = SE3.exp(step) @ T, gone + step
            if np.abs(step).max() < ROUGH:
                break
        return T

    def _motion(self, found: "Found", camera: PinholeCamera) -> Result:
        """Of the inliers, with its certainty."""
        s, count = self.settings, len(found.inliers)
        term = ReprojectionTerm(found.inliers, camera, s)
        result = solve([Pass(term, s.iterations, 4 * count, s.stop)], found.T, s.limits)
        if result.status is Status.FAILED:
            return result
        return replace(result, matches=count, inliers=found.share)


class Found(NamedTuple):
    """A rough motion, the matches that agree about it, and their share of all; the reason why there is none."""

    T: SE3
    inliers: Matches
    share: float
    reason: str


class ReprojectionTerm:
    """Equations in pixels: where each frame's points fall in the other image, against the corner there."""

    def __init__(self, matches: Matches, camera: PinholeCamera, settings: FovisSettings) -> None:
        self.matches, self.settings, self.sigma = matches, settings, 1.0
        self.k = camera.intrinsics
        self.weight = 2.0**-matches.level if settings.level_weights else np.ones(len(matches))
        across, down = (matches.uv0 * (ACROSS, DOWN) / (camera.width, camera.height)).astype(np.int16).T
        self.blocks, self.sums = np.repeat(down * ACROSS + across, 4), np.empty((ACROSS * DOWN, 34))

    def __call__(self, T: SE3, iteration: int) -> System:
        system = System.of_sums(self._sums(T))
        return informed(system, self.sums, self.settings.nu) if self.settings.nu else system

    def equations(self, T: SE3) -> tuple[np.ndarray, np.ndarray]:
        """A (6, 6) and b (6,), in units of the residuals' mean square."""
        s = self._sums(T)
        scale = s[28] / max(s[27], 1e-12)
        return s[SYMMETRIC] * scale, s[21:27] * scale

    def _sums(self, T: SE3) -> np.ndarray:
        m, s = self.matches, self.settings
        arms, residual, J = reprojections(T.matrix, self.k, m.points0_m, m.uv0, m.points1_m, m.uv1, self.weight)
        if s.nu:
            self.sigma = max(kernels.student_scale(residual, s.nu, self.sigma, 10), 1e-3)
        kernels.block_sums(arms, J, residual, J, residual, self.sigma, s.nu, self.blocks, self.sums)
        return self.sums.sum(axis=0)


@njit(cache=True)
def reprojections(T, k, points0, uv0, points1, uv1, weight):
    """(arms (4 n, 3), residuals (4 n,), slopes (4 n, 6) by a twist): u and v in the reference's image, u and v in the other's.

    T (4, 4) is T_reference_current.
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
        slope[1 - along_v], slope[along_v], slope[2] = 0.0, w * f / p[2], -w * f * p[along_v] / p[2] ** 2
        for a in range(3):
            J[i, a] = slope[a]
            if back:  # the other camera moves the other way
                J[i, a] = -(T[a, 0] * slope[0] + T[a, 1] * slope[1] + T[a, 2] * slope[2])
        x, y, z = arms[i]
        J[i, 3], J[i, 4] = y * J[i, 2] - z * J[i, 1], z * J[i, 0] - x * J[i, 2]
        J[i, 5] = x * J[i, 1] - y * J[i, 0]
    return arms, residual, J


def _turned(reference: Features, current: Features, guess: SE3) -> SE3:
    """The guess with the rotation that small images of both still show (section 3.2); the guess itself where they do not fit."""
    camera, rows = reference.camera, min(SMALL_ROWS, reference.camera.height)
    scale = rows / camera.height
    small0, small1 = (
        cv2.resize(f.images[-1], (max(round(camera.width * scale), 1), rows), interpolation=cv2.INTER_AREA)
        for f in (reference, current)
    )
    expected = _rigid_warp(reference.uv, camera.project(guess.inverse().apply(reference.points_m)), scale)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, ROTATION_ITERATIONS, 1e-4)
    try:
        start, mask = expected.astype(np.float32), np.full(small0.shape, 255, np.uint8)
        found = cv2.findTransformECC(small0, small1, start, cv2.MOTION_EUCLIDEAN, criteria, mask, BLUR)[1]
    except cv2.error:
        return guess
    centre = (np.array([camera.cx, camera.cy]) + 0.5) * scale - 0.5
    turn = found[:, :2] @ expected[:, :2].T  # of what was expected into what is seen
    shift = (turn @ (centre - expected[:, 2]) + found[:, 2] - centre) / (np.array([camera.fx, camera.fy]) * scale)
    return guess @ SE3(so3.exp(-np.array([-shift[1], shift[0], math.atan2(turn[1, 0], turn[0, 0])])), np.zeros(3))


def _rigid_warp(uv0: np.ndarray, uv1: np.ndarray, scale: float) -> np.ndarray:
    """(2, 3): the turn and shift of the image by which uv0 (n, 2) fall nearest uv1, in an image of `scale`."""
    uv0, uv1 = ((uv + 0.5) * scale - 0.5 for uv in (uv0, uv1))
    mean0, mean1 = np.median(uv0, axis=0), np.median(uv1, axis=0)
    (x0, y0), (x1, y1) = (uv0 - mean0).T, (uv1 - mean1).T
    angle = math.atan2(x0 @ y1 - y0 @ x1, x0 @ x1 + y0 @ y1)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.c_[turn, mean1 - turn @ mean0]
