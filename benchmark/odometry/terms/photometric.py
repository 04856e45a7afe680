"""Photometric residuals of a whole image, on one pyramid level.

C. Kerl, J. Sturm, D. Cremers, "Robust odometry estimation for RGB-D cameras", ICRA 2013: inverse
compositional, Student-t weights (section III).

Glass and mirrors have depth, but the image in them has another parallax, which biases a photometric
odometer (a window that fills a third of the view halves the estimated motion). Each tile therefore
has a factor of its inverse depth, near 1, as a further unknown. It is eliminated from the equations
of motion (Schur complement). At first its prior is loose, and the motion is that of a monocular
camera; a few point-to-plane equations determine its scale and its degenerate directions (`depth`).
Then the prior is firm in tiles whose factor is near 1, and the other tiles are outliers (Geman,
McClure 1987): intensities alone determine the motion, and depth only selects the tiles. Where depth
does not determine the length of the motion, the median factor replaces 1.

The brightness of two images differs by a gain and an offset (S. Klose, P. Heise, A. Knoll,
"Efficient compositional approaches for real-time robust direct visual odometry from RGB-D data",
IROS 2013), estimated with the residuals' scale before each step.
"""

from dataclasses import dataclass, replace

import numpy as np
from iclnuim.geometry.se3 import SE3

from .. import certainty, kernels
from ..levels import Pair
from ..normal_equations import SYMMETRIC, NormalEquations, small_twist
from ..protocol import OdometryResult, OdometryStatus
from ..solver import SolverLimits, Stop
from .depth import DepthTerm
from .free_depth import FIRM, LOOSE, inlier_weights, scale_ambiguity

NONE = np.empty(0)
#: Minimum correlation of the warped image with the reference. After alignment, unrelated images
#: have 0.00 to 0.04 (smooth ones up to 0.2), the official frames 0.99.
MIN_CORRELATION = 0.25
#: A correlation of fewer pixels is not significant.
MIN_PIXELS = 30
#: If tiles whose depth is an outlier hold the majority of the image's information, the inliers may
#: be the parts with wrong depth.
MIN_INLIER_SHARE = 0.5
#: Tiles of the image (columns, rows).
TILES = (16, 12)
#: Row and column of each element of the upper triangle of A (21,).
UPPER = np.triu_indices(6)
#: Number of pixels of a tile that share one error.
TILE_SPREAD = 25.0
#: Maximum change of a factor in an iteration.
MAX_CHANGE = 0.5
#: Minimum mean square (grey levels): the error of gradients and interpolation.
MIN_ERROR = 16.0
#: Mean square (grey levels) of the difference of two images that are rounded to integers: twice the
#: variance 1/12 of a rounding error.
ROUNDED = 1 / 6


@dataclass(frozen=True)
class PhotometricSettings:
    """Settings of the photometric term, and of an odometer with no other term. Tuples run from fine
    to coarse; gradients are in grey levels per pixel.

    The defaults are Steinbruecker 2011 as Kintinuous runs it (Whelan 2013, section IV-B; the
    constructor of RGBDOdometry in its code).
    """

    iterations: tuple[int, ...] = (10, 7, 7, 7)  # maximum on each level; 0: level not used
    min_gradients: tuple[float, ...] = (12, 5, 3, 1)  # minimumGradientMagnitudes there
    max_depth_m: float = 6.0  # maxDepthRGB there
    # between warped and measured depth; more is an occlusion (maxDepthDeltaRGB there)
    max_dz_m: float = 0.07
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
    limits: SolverLimits = SolverLimits(min_inliers=0.001)
    reference: str = "frame"


class PhotometricTerm:
    """Equations in grey levels. The scale is kept between calls; scale_once: only the first call
    estimates it.
    """

    sparse = False  # every second pixel, in a chessboard pattern

    def __init__(
        self, pair: Pair, settings: PhotometricSettings, level: int, scale_once: bool = False
    ) -> None:
        self.current = pair.current[level]
        self.settings = settings
        self.scale_once = scale_once
        self.sigma = 5.0  # the start of Kerl 2013
        self.gain = 0.0
        self.pixels = pair.reference[level].grey.size // (2 if self.sparse else 1)
        rule = (settings.min_gradients[level], settings.max_depth_m, *TILES, self.sparse)
        self.seen = pair.reference[level].gradient_points(rule)
        count = len(self.seen.points)
        self.residual = np.empty(count, np.float32)
        self.mean = np.empty((count if settings.mean_gradient else 0, 6), np.float32)
        self.J = self.mean if settings.mean_gradient else self.seen.J

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        self._warp(T, NONE, NONE)
        self._normalise(iteration == 0)
        student = (self.sigma, self.settings.nu)
        sums = kernels.sums(self.seen.points, self.residual, self.J, student)
        return NormalEquations.of_sums(sums).as_information(self.settings.spread, ROUNDED)

    def _warp(self, T: SE3, factor: np.ndarray, parallax: np.ndarray) -> None:
        level = self.current
        kernels.grey_residuals(
            T.inverse().matrix,
            level.camera.intrinsics,
            self.seen,
            (level.grey, level.depth_z_m, self.settings.max_dz_m),
            factor,
            (self.residual, self.mean, parallax),
        )

    def _normalise(self, first: bool) -> None:
        """Estimate the scale of the residuals, and with tiles subtract a change of brightness."""
        nu = self.settings.nu
        if self.settings.tiles:
            student = (self.sigma, nu)
            self.sigma, self.gain = kernels.take_brightness(self.residual, self.seen.greys, student)
        elif nu > 0 and (first or not self.scale_once):
            self.sigma = max(kernels.student_scale(self.residual, nu, self.sigma, 20), 1e-3)

    def fit(self, T: SE3) -> tuple[float, float]:
        """correlation() at T_reference_current (0 if there are too few pixels), and the share of
        the pixels that are visible.
        """
        self.linearise(T, 0)
        visible = np.count_nonzero(np.isfinite(self.residual)) / max(len(self.residual), 1)
        return float(np.nan_to_num(self.correlation())), visible

    def correlation(self) -> float:
        """Correlation of the images as aligned at the last call, from some 5000 pixels; NaN if
        there are too few.
        """
        step = len(self.residual) // 5000 + 1
        residual = self.residual[::step]
        grey = self.seen.greys[::step]
        visible = np.isfinite(residual)
        if np.count_nonzero(visible) < MIN_PIXELS:
            return float("nan")
        warped = (1 + self.gain) * grey[visible] + residual[visible]
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(np.corrcoef(grey[visible], warped)[0, 1])

    def unrelated(self) -> str:
        """The reason why these cannot be two images of one place, after the last call; empty if
        they can be.

        This check is necessary because an alignment converges for unrelated images, too.
        """
        found = self.correlation()
        if not found < MIN_CORRELATION:
            return ""
        return f"image: unrelated to the reference, correlation {found:.2f}"

    def checked(self, result: OdometryResult) -> OdometryResult:
        """The result of the last call; a TiledTerm may doubt it."""
        return result


class TiledTerm(PhotometricTerm):
    """A photometric term whose tiles have a factor of their inverse depth each, with a loose prior.
    `firm` has the same residuals with a firm prior in inlier tiles. Neighbours share their error.
    """

    sparse = True

    def __init__(
        self, pair: Pair, settings: PhotometricSettings, level: int, depth: DepthTerm | None = None
    ) -> None:
        super().__init__(pair, settings, level)
        self.tiles = Tiles()
        self.depth = depth
        self.parallax = np.empty(len(self.residual), np.float32)
        self.sums = np.empty((len(self.tiles.factor), 42))

    @property
    def firm(self) -> "FirmTerm":
        return FirmTerm(self)

    def linearise(self, T: SE3, iteration: int, firm: bool = False) -> NormalEquations:
        """Unless firm, the equations of the geometric term, if any, are added."""
        nu = self.settings.nu
        self.tiles.update(T)
        self._warp(T, self.tiles.factor, self.parallax)
        self._normalise(iteration == 0)
        rows = (self.residual, self.J, self.parallax)
        kernels.tile_sums(self.seen, rows, (self.sigma, nu), self.sums)
        equations = self.tiles.eliminated(self.sums, firm)
        spread = self.settings.spread
        if spread:
            sums = self.tiles.block_sums()
            equations = certainty.spread_information(equations, sums, nu, spread, ROUNDED)
        if self.depth and not firm:
            geometry = self.depth.linearise(T)
            self.tiles.scale_ambiguity = scale_ambiguity(geometry, T.translation)
            equations = equations.plus(geometry, 1.0, 1.0)
        return equations

    def checked(self, result: OdometryResult) -> OdometryResult:
        """The result; DEGENERATE if depth contradicts the greater part of the image
        (MIN_INLIER_SHARE) at the last call.
        """
        if result.status is not OdometryStatus.OK:
            return result
        share = self.tiles.inlier_share()
        if share >= MIN_INLIER_SHARE:
            return result
        reason = f"depth: contradicts {1 - share:.0%} of the image"
        return replace(result, status=OdometryStatus.DEGENERATE, reason=reason)


class FirmTerm:
    """A TiledTerm with a firm prior on the depth of inlier tiles, without its geometric term."""

    def __init__(self, loose: TiledTerm) -> None:
        self.loose = loose
        self.pixels = loose.pixels

    def linearise(self, T: SE3, iteration: int) -> NormalEquations:
        return self.loose.linearise(T, iteration, firm=True)


class Tiles:
    """Factors (tiles,) of the tiles' inverse depth, row by row, in one alignment on one level."""

    def __init__(self) -> None:
        self.factor = np.ones(TILES[0] * TILES[1])
        self.scale_ambiguity = 1.0  # scale_ambiguity() of the motion
        self._equations: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._eliminated: tuple[np.ndarray, ...] = ()
        self._T = SE3.identity()
        self._error = 0.0

    def update(self, T: SE3) -> None:
        """Update the factors after the pose has changed from that of the last equations to T."""
        if self._equations is not None:
            slopes, tile_information, tile_rhs = self._equations
            change = (tile_rhs - slopes @ small_twist(self._T, T)) / tile_information
            self.factor = np.clip(self.factor + np.clip(change, -MAX_CHANGE, MAX_CHANGE), 0.0, 2.5)
        self._T = T

    def eliminated(self, sums: np.ndarray, firm: bool) -> NormalEquations:
        """Equations of the motion, from kernels.tile_sums() (tiles, 42), with the factors
        eliminated. Their count is that of the pixels whose depth is an inlier.

        firm: tiles whose depth is an outlier are weighted by the scale ambiguity.
        """
        slopes = sums[:, 34:40]
        tile_squares = sums[:, 40]
        if not firm:
            self._error = float(sums[:, 27].sum() / max(sums[:, 28].sum(), 1e-30))
        unit = TILE_SPREAD * max(self._error, MIN_ERROR)
        weights = np.ones(len(self.factor))
        if firm:
            variance = unit / np.maximum(tile_squares, 1e-12)
            weights = inlier_weights(self.factor, variance, self.scale_ambiguity)
        prior = weights * (unit * (FIRM if firm else LOOSE) ** -2)
        tile_information = tile_squares + prior + 1e-12
        tile_rhs = sums[:, 41] - prior * (self.factor - 1.0)
        self._equations = (slopes, tile_information, tile_rhs)
        scales = weights + (1.0 - weights) * self.scale_ambiguity
        share = slopes * (scales / tile_information)[:, None]
        self._eliminated = (sums, weights, scales, share, slopes, tile_rhs)
        equations = NormalEquations.of_sums(scales @ sums[:, :34])
        self._error = equations.error
        return replace(
            equations,
            A=equations.A - share.T @ slopes,
            b=equations.b - share.T @ tile_rhs,
            count=float(weights @ sums[:, 29]),
        )

    def inlier_share(self) -> float:
        """Share, 0..1, of the information about the translation that is in tiles whose depth is an
        inlier, in the last equations.
        """
        sums, weights, *_ = self._eliminated
        information = sums[:, SYMMETRIC.diagonal()[:3]].sum(axis=1)
        return float(weights @ information / max(information.sum(), 1e-30))

    def block_sums(self) -> np.ndarray:
        """A (upper triangle) and b of the last equations, by block of the image (certainty.BLOCKS,
        27).
        """
        sums, _, scales, share, slopes, tile_rhs = self._eliminated
        row, column = UPPER
        tiles = scales[:, None] * sums[:, :27]
        tiles[:, :21] -= share[:, row] * slopes[:, column]
        tiles[:, 21:] -= share * tile_rhs[:, None]
        across, down = certainty.GRID
        grid = (down, TILES[1] // down, across, TILES[0] // across, 27)
        return tiles.reshape(grid).sum(axis=(1, 3)).reshape(-1, 27)
