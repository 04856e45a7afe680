"""RGB-D and DVO: the photometric error of the whole image, and its term on one pyramid level.

RGB-D: F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images",
ICCV 2011, plain least squares, as Kintinuous runs it. DVO: C. Kerl, J. Sturm, D. Cremers, "Robust
odometry estimation for RGB-D cameras", ICRA 2013, inverse compositional, Student-t weights (section
III), coarse to fine on levels 3 to 1.

Glass and mirrors have depth, but the image in them has another parallax, which biases a photometric
odometer (a window that fills a third of the view halves the estimated motion). Each tile therefore
has a factor of its inverse depth, near 1, as a further unknown. It is eliminated from the equations
of motion (Schur complement). At first its prior is loose, and the motion is that of a monocular
camera; a few point-to-plane equations determine its scale and its degenerate directions
(`depth_term`). Then the prior is firm in tiles whose factor is near 1, and the other tiles are
outliers (Geman, McClure 1987): intensities alone determine the motion, and depth only selects the
tiles. Where depth does not determine the length of the motion, the median factor replaces 1.

The brightness of two images differs by a gain and an offset (S. Klose, P. Heise, A. Knoll,
"Efficient compositional approaches for real-time robust direct visual odometry from RGB-D data",
IROS 2013), estimated with the residuals' scale before each step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from iclnuim.geometry import so3
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from . import certainty, kernels
from .depth_term import FIRM, LOOSE, DepthTerm, inlier_weights, scale_ambiguity
from .protocol import Frame, Result, Status, failure
from .solver import (
    SYMMETRIC,
    Level,
    Limits,
    Pass,
    PyramidOdometer,
    Stop,
    System,
    pyramid,
    small_twist,
    solve,
)

Found = TypeVar("Found")
NONE = np.empty(0)
#: An image with a smaller standard deviation (grey levels) is black, white or covered.
MIN_CONTRAST = 1.0
#: Minimum correlation of the warped image with the reference. After alignment, unrelated images
#: have 0.00 to 0.04 (smooth ones up to 0.2), the official frames 0.99.
MIN_CORRELATION = 0.25
#: MIN_FIT: minimum correlation of the coarsest images at the guess (clean frames have 0.94 and
#: more; a guess with an error of some 5 degrees mostly has less). ITERATIONS_FACTOR: multiplies the
#: iterations where they do not fit at the guess: even a rotation estimated from the images has an
#: error of a few degrees. MIN_VISIBLE: a correlation over a smaller share of the pixels does not
#: tell: a wrong guess that passes has up to 0.4, most good ones more than 0.5.
MIN_FIT, ITERATIONS_FACTOR, MIN_VISIBLE = 0.9, 4, 0.5
#: Maximum number of registrations from one start, and by which factor the fit of a pose has to be
#: larger than that of the guess: on noisy frames poses with up to 1.15 times the fit of a good
#: guess are farther from the truth than it; a wrong guess has less than half.
ROUNDS, CLEARLY = 5, 1.5
#: A correlation of fewer pixels is not significant.
MIN_PIXELS = 30
#: If tiles whose depth is an outlier hold the majority of the image's information, the inliers may
#: be the parts with wrong depth.
MIN_INLIER_SHARE = 0.5
#: Tiles of the image (columns, rows).
ACROSS, DOWN = 16, 12
#: Row and column of each element of the upper triangle of A (21,).
UPPER = np.triu_indices(6)
#: Number of pixels of a tile that share one error.
TILE_SPREAD = 25.0
#: Maximum change of a factor in an iteration.
MAX_CHANGE = 0.5
#: Minimum mean square (grey levels): the error of gradients and interpolation.
MIN_ERROR = 16.0
#: Mean square (grey levels) of the difference of two images that are rounded to integers.
ROUNDED = 1 / 6


def no_contrast(*frames: list[Level]) -> bool:
    """Whether one of the images has too little contrast for photometric alignment."""
    return any(float(levels[-1].grey.std()) < MIN_CONTRAST for levels in frames)


@dataclass(frozen=True)
class PhotometricSettings:
    """Settings of the photometric term, and of an odometer with no other term. Tuples run from fine
    to coarse; gradients are in
    grey levels per pixel.

    The defaults are Steinbruecker 2011 as Kintinuous runs it; docs/guide/odometry.md explains what
    differs in `best`.
    """

    iterations: tuple[int, ...] = (10, 7, 7, 7)  # maximum on each level; 0: level not used
    min_gradients: tuple[float, ...] = (12, 5, 3, 1)
    max_depth_m: float = 6.0
    max_dz_m: float = 0.07  # between warped and measured depth; more is an occlusion
    nu: float = 0.0  # degrees of freedom of Student's t (Kerl 2013: 5); 0: least squares
    # scale of Student's t: estimated once per level, except the coarsest (Kerl 2013); not with
    # tiles
    scale_once: bool = False
    mean_gradient: bool = False  # of both images (efficient second-order minimization, Malis 2004)
    # least number of pixels that share one error; with tiles more where their blocks disagree; 0:
    # no noise model
    spread: float = 0.0
    # a depth factor per tile, gain and offset per pair; coarse levels then estimate only the
    # rotation
    tiles: bool = False
    median_depth: bool = False  # depth pyramid by 3x3 median (Kerl 2013) instead of means
    stop: Stop = Stop()
    limits: Limits = Limits(min_inliers=0.001)
    reference: str = "frame"


class Tiles:
    """Factors (ACROSS * DOWN,) of the tiles' inverse depth, row by row, in one alignment on one
    level.
    """

    def __init__(self) -> None:
        self.factor = np.ones(ACROSS * DOWN)
        self.scale_ambiguity = 1.0  # scale_ambiguity() of the motion
        self._equations: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._eliminated: tuple[np.ndarray, ...] = ()
        self._T, self._error = SE3.identity(), 0.0

    def update(self, T: SE3) -> None:
        """Update the factors after the pose has changed from that of the last equations to T."""
        if self._equations is not None:
            slopes, tile_information, tile_rhs = self._equations
            change = (tile_rhs - slopes @ small_twist(self._T, T)) / tile_information
            self.factor = np.clip(self.factor + np.clip(change, -MAX_CHANGE, MAX_CHANGE), 0.0, 2.5)
        self._T = T

    def eliminated(self, sums: np.ndarray, firm: bool) -> System:
        """Equations of the motion, from kernels.tile_sums() (tiles, 42), with the factors
        eliminated. Their count is that of the
        pixels whose depth is an inlier.

        firm: tiles whose depth is an outlier are weighted by the scale ambiguity.
        """
        slopes, tile_squares, rhs = sums[:, 34:40], sums[:, 40], sums[:, 41]
        if not firm:
            self._error = float(sums[:, 27].sum() / max(sums[:, 28].sum(), 1e-30))
        deviation, unit = self.factor - 1.0, TILE_SPREAD * max(self._error, MIN_ERROR)
        weights = (
            inlier_weights(
                self.factor, unit / np.maximum(tile_squares, 1e-12), self.scale_ambiguity
            )
            if firm
            else np.ones(len(deviation))
        )
        prior = weights * (unit * (FIRM if firm else LOOSE) ** -2)
        tile_information, tile_rhs = tile_squares + prior + 1e-12, rhs - prior * deviation
        self._equations = slopes, tile_information, tile_rhs
        scales = weights + (1.0 - weights) * self.scale_ambiguity
        share = slopes * (scales / tile_information)[:, None]
        self._eliminated = sums, weights, scales, share, slopes, tile_rhs
        system = System.of_sums(scales @ sums[:, :34])
        self._error, count = system.error, float(weights @ sums[:, 29])
        return replace(
            system, A=system.A - share.T @ slopes, b=system.b - share.T @ tile_rhs, count=count
        )

    def inlier_share(self) -> float:
        """Share, 0..1, of the information about the translation that is in tiles whose depth is an
        inlier, in the last equations.
        """
        sums, weights, *_ = self._eliminated
        information = sums[:, SYMMETRIC.diagonal()[:3]].sum(axis=1)
        return float(weights @ information / max(information.sum(), 1e-30))

    def block_sums(self) -> np.ndarray:
        """A (upper triangle) and b of the last equations, by block of the image (certainty.ACROSS *
        certainty.DOWN, 27).
        """
        (sums, _, scales, share, slopes, tile_rhs), (row, column) = self._eliminated, UPPER
        tiles = scales[:, None] * sums[:, :27]
        tiles[:, :21] -= share[:, row] * slopes[:, column]
        tiles[:, 21:] -= share * tile_rhs[:, None]
        grid = (
            certainty.DOWN,
            DOWN // certainty.DOWN,
            certainty.ACROSS,
            ACROSS // certainty.ACROSS,
            27,
        )
        return tiles.reshape(grid).sum(axis=(1, 3)).reshape(-1, 27)


class PhotometricTerm:
    """Equations in grey levels on level n. sigma is kept between calls; scale_once: only the first
    call estimates it.

    With tiles, every second pixel is used, in a chessboard pattern, because neighbours share their
    error.
    """

    def __init__(
        self,
        reference: Level,
        current: Level,
        settings: PhotometricSettings,
        n: int,
        scale_once: bool = False,
        tiles: Tiles | None = None,
        depth: DepthTerm | None = None,
    ) -> None:
        self.current, self.settings, self.scale_once, self.sigma, self.gain = (
            current,
            settings,
            scale_once,
            5.0,
            0.0,
        )
        self.tiles, self.depth = tiles, depth
        size, sparse = reference.grey.size, tiles is not None
        self.pixels = size // 2 if sparse else size
        rule = (settings.min_gradients[n], settings.max_depth_m, ACROSS, DOWN, sparse)
        self.points, self.greys, self.J, self.tile = reference.gradient_points(*rule)
        count = len(self.points)
        self.residual = np.empty(count, np.float32)
        self.mean = np.empty((count if settings.mean_gradient else 0, 6), np.float32)
        self.parallax = np.empty(count if tiles else 0, np.float32)
        self.sums = np.empty((ACROSS * DOWN, 42))

    def __call__(self, T: SE3, iteration: int, firm: bool = False) -> System:
        """firm: the prior on depth is firm in inlier tiles.

        Otherwise it is loose, and the equations of the geometric term, if any, are added.
        """
        level, nu = self.current, self.settings.nu
        if self.tiles:
            self.tiles.update(T)
        factor = self.tiles.factor if self.tiles else NONE
        inputs = (self.points, self.greys, level.grey, level.depth_z_m, self.settings.max_dz_m)
        found = (self.residual, self.J, self.mean, self.tile, factor, self.parallax)
        kernels.grey_residuals(T.inverse().matrix, level.camera.intrinsics, *inputs, *found)
        if self.settings.tiles:
            self.sigma, self.gain = kernels.take_brightness(
                self.residual, self.greys, nu, self.sigma, 5
            )
        elif nu > 0 and (iteration == 0 or not self.scale_once):
            self.sigma = max(kernels.student_scale(self.residual, nu, self.sigma, 20), 1e-3)
        J = self.mean if self.settings.mean_gradient else self.J
        if self.tiles:
            kernels.tile_sums(
                self.points, J, self.parallax, self.residual, self.sigma, nu, self.tile, self.sums
            )
            system = self.tiles.eliminated(self.sums, firm)
        else:
            system = System.of_sums(
                kernels.sums(self.points, J, self.residual, J, self.residual, self.sigma, nu)
            )
        if self.tiles and self.settings.spread:
            sums = self.tiles.block_sums()
            system = certainty.spread_information(system, sums, nu, self.settings.spread, ROUNDED)
        else:
            system = system.as_information(self.settings.spread, ROUNDED)
        if self.depth and self.tiles and not firm:
            geometry = self.depth.evaluate(T)
            self.tiles.scale_ambiguity = scale_ambiguity(geometry, T.translation)
            system = system.plus(geometry, 1.0, 1.0)
        return system

    def fit(self, T: SE3) -> tuple[float, float]:
        """correlation() at T_reference_current (0 if there are too few pixels), and the share of
        the pixels that are visible.
        """
        self(T, 0)
        visible = np.count_nonzero(np.isfinite(self.residual)) / max(len(self.residual), 1)
        return float(np.nan_to_num(self.correlation())), visible

    def correlation(self) -> float:
        """Correlation of the images as aligned at the last call, from some 5000 pixels; NaN if
        there are too few.
        """
        step = len(self.residual) // 5000 + 1
        residual, grey = self.residual[::step], self.greys[::step]
        visible = np.isfinite(residual)
        if np.count_nonzero(visible) < MIN_PIXELS:
            return float("nan")
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(
                np.corrcoef(grey[visible], (1 + self.gain) * grey[visible] + residual[visible])[
                    0, 1
                ]
            )

    def unrelated(self) -> str:
        """The reason why these cannot be two images of one place, after the last call; empty if
        they can be.

        This check is necessary because an alignment converges for unrelated images, too.
        """
        found = self.correlation()
        return (
            ""
            if not found < MIN_CORRELATION
            else f"image: unrelated to the reference, correlation {found:.2f}"
        )

    def checked(self, result: Result) -> Result:
        """The result; DEGENERATE if depth contradicts the greater part of the image
        (MIN_INLIER_SHARE) at the last call.
        """
        if (
            not self.tiles
            or result.status is not Status.OK
            or (share := self.tiles.inlier_share()) >= MIN_INLIER_SHARE
        ):
            return result
        return replace(
            result,
            status=Status.DEGENERATE,
            reason=f"depth: contradicts {1 - share:.0%} of the image",
        )


def photometric_passes(
    reference: list[Level],
    current: list[Level],
    settings: PhotometricSettings,
    schedule: list[tuple[int, int]],
    depth: DepthTerm | None = None,
) -> tuple[list[Pass], PhotometricTerm]:
    """The passes for solve() on the levels of `schedule`, (level, iterations) from coarse to fine,
    and the finest term.

    With `settings.tiles` the coarse levels estimate only the rotation, which does not depend on
    depth. The finest level has two passes: first with a loose prior on the tiles' depth and the
    equations of `depth`, then with a firm prior.
    """
    s, passes = settings, []
    for n, iterations in schedule:
        if s.tiles and n == schedule[-1][0]:
            term = PhotometricTerm(reference[n], current[n], s, n, tiles=Tiles(), depth=depth)
            # the error may increase for a step while the factors converge, and when their prior
            # changes
            stop = Stop(s.stop.min_step)
            passes.append(Pass(term, iterations, term.pixels, stop))
            passes.append(
                Pass(
                    partial(term, firm=True),
                    iterations,
                    term.pixels,
                    stop,
                    centre=depth is not None,
                )
            )
        else:
            term = PhotometricTerm(
                reference[n], current[n], s, n, s.scale_once and not s.tiles and n != schedule[0][0]
            )
            passes.append(Pass(term, iterations, term.pixels, s.stop, rotation_only=s.tiles))
    return passes, term


def with_rotation(reference: Level, current: Level, guess: SE3, fit: Callable[[SE3], float]) -> SE3:
    """The guess, or, if its `fit` is clearly larger, the best pose with a rotation estimated from
    half-size images.

    A first estimate is from the images alone. Then the reference is registered as it would be seen
    from the best pose so far, by the depth of the current frame, as long as this improves the fit:
    otherwise the parallax of a far keyframe is taken for a rotation, and a large rotation is found
    only in part.
    """
    alone = _register(reference.grey, current.grey, reference.camera)
    starts = [guess, *([] if alone is None else [SE3(alone, guess.translation)])]
    found = []
    for T in starts:
        found.append((fit(T), T))
        for _ in range(ROUNDS):
            turned = _register(_seen_from(reference, current, T), current.grey, reference.camera)
            if turned is None:
                break
            T = SE3(T.rotation @ turned, T.translation)
            found.append((fit(T), T))
            if found[-1][0] <= found[-2][0]:
                break
    most, best = max(found, key=lambda one: one[0])
    return best if most > CLEARLY * found[0][0] else guess


def _seen_from(reference: Level, current: Level, T_reference_current: SE3) -> np.ndarray:
    """(h, w) grey values of the reference at the points of the current frame; the mean where there
    are none.
    """
    camera, depth_z_m = current.camera, current.depth_z_m
    place = camera.project(T_reference_current.apply(camera.unproject(depth_z_m)))
    place[~(depth_z_m > 0)] = np.nan
    u, v = np.moveaxis(np.nan_to_num(place, nan=-1e4).astype(np.float32), -1, 0)
    return np.asarray(
        cv2.remap(
            reference.grey, u, v, cv2.INTER_LINEAR, borderValue=[float(reference.grey.mean())]
        )
    )


def _register(one: np.ndarray, other: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """(3, 3) R_one_other from the half-size images alone; None if it cannot be estimated. camera:
    of the images.

    Phase correlation gives an image shift; the maximum of the correlation over shift and in-plane
    rotation refines it (G. Evangelidis, E. Psarakis, "Parametric image alignment using enhanced
    correlation coefficient maximization", PAMI 2008).
    """
    one, other, camera = kernels.halve_grey(one), kernels.halve_grey(other), camera.halved()
    shift, _ = cv2.phaseCorrelate(one, other, cv2.createHanningWindow(one.shape[::-1], cv2.CV_32F))
    warp = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-4)
    try:
        mask = np.full(other.shape, 255, np.uint8)
        warp = np.asarray(
            cv2.findTransformECC(one, other, warp, cv2.MOTION_EUCLIDEAN, criteria, mask, 5)[1]
        )
    except cv2.error:
        return None
    centre = np.array([camera.cx, camera.cy])
    x, y = (warp[:, :2] @ centre + warp[:, 2] - centre) / (camera.fx, camera.fy)
    return so3.exp(np.array([y, -x, -math.atan2(warp[1, 0], warp[0, 0])]))


class Start(NamedTuple):
    """Where an alignment starts: guess, schedule, and the term of the coarsest images, if they did
    not fit at the prediction (poor), or if
    only the result is checked (afterwards). predicted: the prediction, if the guess is another
    pose.
    """

    guess: SE3
    schedule: list[tuple[int, int]]
    poor: PhotometricTerm | None = None
    afterwards: PhotometricTerm | None = None
    predicted: SE3 | None = None

    def aligned(
        self, align: Callable[["Start"], Found], result_of: Callable[[Found], Result]
    ) -> Found:
        """What `align` finds from this start; or from the prediction, if that is another pose and
        the coarsest images fit clearly better at its
        result: on a bare wall a wrong pose can fit better than a good prediction, before both are
        aligned.
        """
        found = align(self)
        if self.predicted is None or result_of(found).status is Status.FAILED:
            return found
        other = align(self._replace(guess=self.predicted))
        return (
            other if self._fit(result_of(other)) > CLEARLY * self._fit(result_of(found)) else found
        )

    def _fit(self, result: Result) -> float:
        """How well the coarsest images fit at a result: their correlation times the share of
        visible pixels; 0 for a failure.
        """
        if self.poor is None or result.status is Status.FAILED:
            return 0.0
        return max(math.prod(self.poor.fit(result.T_reference_camera)), 0.0)

    def checked(self, result: Result) -> Result:
        """The result; DEGENERATE if the coarsest images do not fit, or, after a poor prediction, if
        it did not converge.
        """
        term = self.poor or self.afterwards
        if term is None or result.status is Status.FAILED:
            return result
        correlation, _ = term.fit(result.T_reference_camera)
        if correlation >= MIN_FIT and (result.converged or not self.poor):
            return result
        reason = f"image: does not fit, correlation {correlation:.2f}"
        if self.poor:
            afterwards = f"{'' if result.converged else 'not '}converged afterwards"
            reason = f"prediction: poor, correlation {correlation:.2f} and {afterwards}"
        return replace(result, status=Status.DEGENERATE, reason=reason)


def initialise(
    reference: list[Level],
    current: list[Level],
    settings: PhotometricSettings,
    schedule: list[tuple[int, int]],
    guess: SE3,
) -> Start:
    """If the coarsest images do not fit at the guess, or few pixels are visible, there may have
    been a sudden motion. A rotation is then estimated
    from these images; if they fit clearly better there, the alignment starts from it too. All
    levels get more iterations. Without tiles only the result is checked.
    """
    n = schedule[0][0]
    term = PhotometricTerm(reference[n], current[n], settings, n)
    if not settings.tiles:
        return Start(guess, schedule, afterwards=term)
    correlation, visible = term.fit(guess)
    if correlation >= MIN_FIT and visible >= MIN_VISIBLE:
        return Start(guess, schedule)
    start = with_rotation(reference[n], current[n], guess, lambda T: math.prod(term.fit(T)))
    if start is guess and correlation >= MIN_FIT:
        return Start(guess, schedule)
    iterated = [(m, ITERATIONS_FACTOR * count) for m, count in schedule]
    return Start(start, iterated, term, predicted=None if start is guess else guess)


class Rgbd(PyramidOdometer):
    """The photometric term alone; residuals are in grey levels."""

    name, reads_grey = "rgbd", True
    PRESETS = {
        "paper": PhotometricSettings(),
        "best": PhotometricSettings(
            iterations=(0, 4, 2, 2),
            min_gradients=(12, 2, 3, 2),
            max_depth_m=13.0,
            nu=5.0,
            mean_gradient=True,
            spread=1.0,
            tiles=True,
            stop=Stop(min_step=2e-5),
            limits=Limits(min_inliers=0.001, prior_m=0.03),
            reference="keyframe",
        ),
    }

    def prepare(self, frame: Frame, camera: PinholeCamera) -> list[Level]:
        return pyramid(frame, camera, len(self.iterations), median_depth=self.settings.median_depth)

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> Result:
        if no_contrast(reference, current):
            return failure("image: no contrast")
        start = initialise(reference, current, self.settings, self.schedule(reference), guess)
        return start.checked(
            start.aligned(partial(self._align_from, reference, current), lambda result: result)
        )

    def _align_from(self, reference: list[Level], current: list[Level], start: Start) -> Result:
        n = start.schedule[-1][0]
        depth = DepthTerm(reference[n], current[n]) if self.settings.tiles else None
        passes, finest = photometric_passes(
            reference, current, self.settings, start.schedule, depth
        )
        result = solve(passes, start.guess, self.settings.limits)
        if result.status is not Status.FAILED and (reason := finest.unrelated()):
            return failure(reason)
        result = finest.checked(result)
        return depth.final(result) if depth else result


class Dvo(Rgbd):
    """`Rgbd` with other settings."""

    name = "dvo"
    PRESETS = {
        "paper": PhotometricSettings(
            iterations=(0, 100, 100, 100),
            min_gradients=(0, 0, 0, 0),
            max_depth_m=1e9,
            max_dz_m=0.05,
            nu=5.0,
            scale_once=True,
            median_depth=True,
            stop=Stop(min_step=1e-7, min_decrease=5e-7, undo=True),
            limits=Limits(min_inliers=0.3),  # failure test of dvo_slam
        ),
        "best": replace(
            Rgbd.PRESETS["best"],
            min_gradients=(2, 2, 2, 2),
            max_depth_m=1e9,
            max_dz_m=0.05,
            scale_once=True,
            stop=Stop(min_step=2e-5, min_decrease=1e-3, undo=True),
            limits=Limits(min_inliers=0.01, prior_m=0.03),
        ),
    }
