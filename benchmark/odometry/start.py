"""Where an alignment of images starts: at the prediction, or, after a sudden motion, also at a
rotation that is estimated from coarse images.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from . import kernels
from .candidates import Estimate, pick
from .levels import Level, Pair
from .protocol import OdometryResult, OdometryStatus
from .terms.photometric import PhotometricSettings, PhotometricTerm

#: Minimum correlation of the coarsest images at the guess (clean frames have 0.94 and more; a guess
#: with an error of some 5 degrees mostly has less).
MIN_FIT = 0.9
#: Multiplies the iterations where the images do not fit at the guess: even a rotation estimated
#: from the images has an error of a few degrees.
ITERATIONS_FACTOR = 4
#: A correlation over a smaller share of the pixels does not tell: a wrong guess that passes has up
#: to 0.4, most good ones more than 0.5.
MIN_VISIBLE = 0.5
#: Maximum number of registrations from one start.
ROUNDS = 5
#: By which factor the fit of a pose has to be larger than that of the guess: on noisy frames poses
#: with up to 1.15 times the fit of a good guess are farther from the truth than it; a wrong guess
#: has less than half.
CLEARLY = 1.5


class Start(NamedTuple):
    """guesses: the poses to start from, the first one preferred; images: the term of the coarsest
    images, which checks the result; poor: whether they did not fit at the prediction.
    """

    guesses: list[SE3]
    schedule: list[tuple[int, int]]
    images: PhotometricTerm | None = None
    poor: bool = False

    def aligned(self, align: Callable[[SE3], Estimate]) -> Estimate:
        """What `align` finds from the first guess; or from another one, if the coarsest images fit
        clearly better at its result: on a bare wall a wrong pose can fit better than a good
        prediction, before both are aligned.
        """
        found = align(self.guesses[0])
        others = self.guesses[1:]
        if found.failed or not others:
            return found
        return pick(found, map(align, others), self._fit, CLEARLY)

    def _fit(self, found: Estimate) -> float:
        """How well the coarsest images fit at a result: their correlation times the share of
        visible pixels; 0 for a failure.
        """
        if self.images is None or found.failed:
            return 0.0
        return max(math.prod(self.images.fit(found.T)), 0.0)

    def checked(self, result: OdometryResult) -> OdometryResult:
        """The result; DEGENERATE if the coarsest images do not fit, or, after a poor prediction, if
        it did not converge.
        """
        if self.images is None or result.status is OdometryStatus.FAILED:
            return result
        correlation, _ = self.images.fit(result.T_reference_camera)
        if correlation >= MIN_FIT and (result.converged or not self.poor):
            return result
        reason = f"image: does not fit, correlation {correlation:.2f}"
        if self.poor:
            afterwards = f"{'' if result.converged else 'not '}converged afterwards"
            reason = f"prediction: poor, correlation {correlation:.2f} and {afterwards}"
        return replace(result, status=OdometryStatus.DEGENERATE, reason=reason)


def initialise(
    pair: Pair, settings: PhotometricSettings, schedule: list[tuple[int, int]], guess: SE3
) -> Start:
    """If the coarsest images do not fit at the guess, or few pixels are visible, there may have
    been a sudden motion. A rotation is then estimated from these images; if they fit clearly better
    there, the alignment starts from it too. All levels get more iterations. Without tiles only the
    result is checked.
    """
    n = schedule[0][0]
    images = PhotometricTerm(pair, settings, n)
    if not settings.tiles:
        return Start([guess], schedule, images)
    correlation, visible = images.fit(guess)
    if correlation >= MIN_FIT and visible >= MIN_VISIBLE:
        return Start([guess], schedule)
    rotated = with_rotation(
        pair.reference[n], pair.current[n], guess, lambda T: math.prod(images.fit(T))
    )
    if rotated is guess and correlation >= MIN_FIT:
        return Start([guess], schedule)
    guesses = [guess] if rotated is guess else [rotated, guess]
    iterated = [(m, ITERATIONS_FACTOR * count) for m, count in schedule]
    return Start(guesses, iterated, images, poor=True)


def with_rotation(reference: Level, current: Level, guess: SE3, fit: Callable[[SE3], float]) -> SE3:
    """The guess, or, if its `fit` is clearly larger, the best pose with a rotation estimated from
    half-size images.

    A first estimate is from the images alone. Then the reference is registered as it would be seen
    from the best pose so far, by the depth of the current frame, as long as this improves the fit:
    otherwise the parallax of a far keyframe is taken for a rotation, and a large rotation is found
    only in part.
    """
    alone = _register(reference.grey, current.grey, reference.camera)
    found = _improved(reference, current, guess, fit)
    if alone is not None:
        found += _improved(reference, current, SE3(alone, guess.translation), fit)
    _, best = pick(found[0], found[1:], lambda one: one[0], CLEARLY)
    return best


def _improved(
    reference: Level, current: Level, T: SE3, fit: Callable[[SE3], float]
) -> list[tuple[float, SE3]]:
    """Poses and their fits, from T on, each registered from the one before."""
    found = [(fit(T), T)]
    for _ in range(ROUNDS):
        seen = _seen_from(reference, current, T)
        rotation = _register(seen, current.grey, reference.camera)
        if rotation is None:
            break
        T = SE3(T.rotation @ rotation, T.translation)
        found.append((fit(T), T))
        if found[-1][0] <= found[-2][0]:
            break
    return found


def _seen_from(reference: Level, current: Level, T_reference_current: SE3) -> np.ndarray:
    """(h, w) grey values of the reference at the points of the current frame; the mean where there
    are none.
    """
    camera = current.camera
    depth_z_m = current.depth_z_m
    place = camera.project(T_reference_current.apply(camera.unproject(depth_z_m)))
    place[~(depth_z_m > 0)] = np.nan
    u, v = np.moveaxis(np.nan_to_num(place, nan=-1e4).astype(np.float32), -1, 0)
    mean = [float(reference.grey.mean())]
    return np.asarray(cv2.remap(reference.grey, u, v, cv2.INTER_LINEAR, borderValue=mean))


def _register(one: np.ndarray, other: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """(3, 3) R_one_other from the half-size images alone; None if it cannot be estimated. camera:
    of the images.

    Phase correlation gives an image shift; the maximum of the correlation over shift and in-plane
    rotation refines it (G. Evangelidis, E. Psarakis, "Parametric image alignment using enhanced
    correlation coefficient maximization", PAMI 2008).
    """
    one = kernels.halve_grey(one)
    other = kernels.halve_grey(other)
    camera = camera.halved()
    shift, _ = cv2.phaseCorrelate(one, other, cv2.createHanningWindow(one.shape[::-1], cv2.CV_32F))
    start = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
    warp = maximize_correlation(one, other, start)
    if warp is None:
        return None
    centre = np.array([camera.cx, camera.cy])
    x, y = (warp[:, :2] @ centre + warp[:, 2] - centre) / (camera.fx, camera.fy)
    return so3.exp(np.array([y, -x, -math.atan2(warp[1, 0], warp[0, 0])]))


def maximize_correlation(one: np.ndarray, other: np.ndarray, warp: np.ndarray) -> np.ndarray | None:
    """The in-plane rotation and shift (2, 3) float32 from a first image to another one, improved
    from `warp`; None if it cannot be estimated.
    """
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-4)
    mask = np.full(other.shape, 255, np.uint8)
    mode = cv2.MOTION_EUCLIDEAN
    try:
        found = cv2.findTransformECC(
            one, other, warp, mode, criteria, inputMask=mask, gaussFiltSize=5
        )
        return np.asarray(found[1])
    except cv2.error:
        return None
