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
from .depth_term import LOOSE, DepthTerm, believed, length_unknown
from .features import Features, Matches, consistent, features, match
from .protocol import Frame, Result, Status, failure
from .solver import Limits, Pass, Stop, System, solve

#: The first rotation is found on images of so many rows, in so many iterations, blurred by so wide a Gaussian.
SMALL_ROWS, ROTATION_ITERATIONS, BLUR = 30, 30, 5
#: A motion that others only start from is found until a step is shorter (metres, radians; half a pixel).
ROUGH = 1e-3
#: Depth is looked up so many times at most.
LOOKS = 3
#: Where a smaller share of the matches agrees (unrelated images: up to 0.07, furnished rooms: 0.4 and more), the prediction may have
#: missed a sudden turn: small images are asked.
FEW = 0.25
#: Where a larger share agrees close to the prediction (noisy frames: 0.42 and more), corners farther off are not asked.
SURE = 0.35


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
    depth: bool = False  # which corners count is found with the help of depth, which judges the motion
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
            depth=True,
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
        far, near = s.searches_px[0], s.searches_px[-1]
        depth = DepthTerm(reference.half, current.half) if s.depth else None
        found = self._around(reference, current, guess, near, depth)
        if far > near and found.share < SURE:
            found = self._around(reference, current, guess, far, depth)
        if found.share < FEW:
            again = self._around(reference, current, _turned(reference, current, guess), far, depth)
            found = again if len(again.inliers) > len(found.inliers) else found
        if far > near and found.search_px == far and not found.reason:
            found = self._around(reference, current, found.T, near, depth)
        if found.reason:
            return failure(found.reason)
        result = self._motion(found, reference.camera)
        return depth.judged(result) if depth else result

    def _around(
        self, reference: Features, current: Features, start: SE3, search_px: float, depth: DepthTerm | None
    ) -> "Found":
        """With corners within `search_px` of where `start` puts them; their places are refined in the last search."""
        s, camera = self.settings, reference.camera
        expected_uv = camera.project(start.inverse().apply(reference.points_m))
        last = search_px == s.searches_px[-1]
        found = match(reference, current, expected_uv, search_px, s.precision_px if last else 0.5, s.strict)
        agreeing = found.chosen(consistent(found.points0_m, found.points1_m, s.max_distance_m))
        if len(agreeing) < s.min_inliers:
            reason = f"features: {len(agreeing)} agree, fewer than {s.min_inliers}"
            return Found(start, agreeing, 0.0, search_px, reason)
        T = start
        if depth:
            term = ReprojectionTerm(agreeing, camera, s, loose=True)
            T = self._rough(term, T, depth)
            agreeing = replace(agreeing, weight=term.believed(depth.at(T), T))
        T = self._rough(ReprojectionTerm(agreeing, camera, s), T)
        errors_px = np.linalg.norm(camera.project(T.apply(agreeing.points1_m)) - agreeing.uv0, axis=1)
        inliers = agreeing.chosen(errors_px <= s.max_error_px)
        few = len(inliers) < max(s.min_agreement * len(found), s.min_inliers)
        reason = f"features: {len(inliers)} of {len(found)} agree about a motion" if few else ""
        return Found(T, inliers, len(inliers) / len(found), search_px, reason)

    def _rough(self, term: "ReprojectionTerm", T: SE3, depth: DepthTerm | None = None, min_step: float = ROUGH) -> SE3:
        """The motion without its certainty, from T on, until a step is shorter than min_step. With what depth says, looked up again
        where it has moved the points."""
        s, gone = self.settings, np.zeros(6)
        prior = np.full(6, s.limits.prior_m**-2 if s.limits.prior_m else 1e-9)
        for _ in range(LOOKS if depth else 1):
            A, b = np.diag(prior), -prior * gone
            if depth:
                geometry = depth.look(T)
                A, b = A + geometry.A, b + geometry.b
            T, step = term.solved(T, A, b, min_step)
            gone += step
            if np.abs(step).max() < ROUGH:
                break
        return T

    def _motion(self, found: "Found", camera: PinholeCamera) -> Result:
        """Of the inliers, with its certainty."""
        s, count = self.settings, len(found.inliers)
        term = ReprojectionTerm(found.inliers, camera, s)
        T = self._rough(term, found.T, min_step=s.stop.min_step) if s.nu else found.T  # certainty only once it is there
        result = solve([Pass(term, s.iterations, 4 * count, s.stop)], T, s.limits)
        if result.status is Status.FAILED:
            return result
        return replace(result, matches=count, inliers=found.share)


class Found(NamedTuple):
    """A rough motion, the matches that agree about it, and their share of all; the reason why there is none."""

    T: SE3
    inliers: Matches
    share: float
    search_px: float
    reason: str


class ReprojectionTerm:
    """Equations in pixels: where each frame's points fall in the other image, against the corner there.

    loose: the inverse depth of each match may be wrong by a factor, a further unknown that is eliminated (as of the tiles of
    `photometric`): a corner in a mirror or behind glass tells the motion without it.
    """

    def __init__(self, matches: Matches, camera: PinholeCamera, settings: FovisSettings, loose: bool = False) -> None:
        self.settings, self.loose, self.sigma = settings, loose, 1.0
        m, weight = matches, matches.weight * (2.0**-matches.level if settings.level_weights else 1.0)
        self.seen = (camera.intrinsics, m.points0_m, m.uv0, m.points1_m, m.uv1, weight)
        across, down = (matches.uv0 * (ACROSS, DOWN) / (camera.width, camera.height)).astype(np.int16).T
        self.blocks, self.sums = np.repeat(down * ACROSS + across, 4), np.empty((ACROSS * DOWN, 34))

    def __call__(self, T: SE3, iteration: int) -> System:
        s, (arms, residual, J) = self.settings, reprojections(T.matrix, *self.seen)
        if s.nu:
            self.sigma = max(kernels.student_scale(residual, s.nu, self.sigma, 10), 1e-3)
        kernels.block_sums(arms, J, residual, J, residual, self.sigma, s.nu, self.blocks, self.sums)
        system = System.of_sums(self.sums.sum(axis=0))
        return informed(system, self.sums, s.nu) if s.nu else system

    def solved(self, T: SE3, A: np.ndarray, b: np.ndarray, min_step: float) -> tuple[SE3, np.ndarray]:
        """The pose and the twist (6,) there from T; of that twist x, A x = b is known besides, as information."""
        s = self.settings
        rule = (self.loose, s.nu, self.sigma, A, b, s.iterations, min_step)
        found, gone, self.sigma = least_squares(T.matrix, self.seen, *rule)
        return SE3(found[:3, :3], found[:3, 3]), gone

    def believed(self, geometry: System, T: SE3) -> np.ndarray:
        """Weights (n,), 0..1, of residuals: small where depth is not that of what is seen, by its equations at T and loose ones solved."""
        _, residual, J = reprojections(T.matrix, *self.seen)
        factor, stiff = free_depth(T.translation, J, residual, (self.sigma / LOOSE) ** 2)
        unknown = length_unknown(geometry, T.translation)
        kept = believed(factor, self.sigma**2 / np.maximum(stiff, 1e-12), unknown)
        return np.sqrt(kept + (1.0 - kept) * unknown)


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


@njit(cache=True)
def least_squares(T, seen, loose, nu, sigma, A, b, iterations, min_step):
    """(T, the twist (6,) there, Student's scale), by Gauss-Newton from T (4, 4) on; A x = b is known of that twist besides.

    seen: what reprojections() takes besides the pose. Units are those of the residuals' mean square.
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
    """(4, 4): exp(twist) T (as SE3.exp, for steps of less than half a turn)."""
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
    """(factor (n,) of each match's inverse depth, g^T g (n,)) by the slopes g of its 4 residuals by that factor; makes J and
    residual such that their squares are those of the equations without it (Schur complement). t (3,): of T_reference_current.
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
