"""Uncertainty of a motion, from blocks of the image (delete-a-group jackknife) and from a sensor's
bias, and noise of surface normals.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .normal_equations import RANK_TOLERANCE, SYMMETRIC, NormalEquations
from .protocol import OdometryResult, OdometryStatus

#: Blocks of the image (columns, rows). Errors are correlated over more than a pixel, a tile or a
#: texture, but are independent between blocks.
GRID = (4, 3)
BLOCKS = GRID[0] * GRID[1]
#: Disagreement of normals (1 - cosine) that does not count as noise: depth rounded to 0.2 mm causes
#: less.
MIN_NOISE = 1e-4
#: 1 - cosine of normals from which on depth is a sensor's, median or disagreement(): `released`
#: noise has 0.006, clean frames below 1e-4.
MAX_ROUGHNESS = 1e-3
#: Relative error of every translation from a sensor's frames, in its stated information. The offset
#: of the noise `released`, 0.00155 a metre of inverse depth, makes an object at 1 to 3 m seem to
#: move 0.3 to 0.9 % less.
ROUGH_BIAS = 0.005
#: The same with the offset subtracted: motions are 0.2 % too short to 0.2 % too long.
CALIBRATED_BIAS = 0.002


def disagreement(cosines: np.ndarray) -> float:
    """Noise of the normals of two images, from the cosines (n,) between corresponding normals: the
    mean of 1 - cosine.

    The mean is computed from the median (of an exponential distribution: 1 - cosine is half the sum
    of two squares of normal errors), because at edges normals differ for other reasons than noise.
    """
    if not len(cosines):
        return 0.0
    mean = (1.0 - float(np.median(cosines))) / math.log(2.0)
    return max(mean - MIN_NOISE, 0.0)


def jackknife_information(
    equations: NormalEquations, sums: np.ndarray, nu: float
) -> NormalEquations:
    """`equations` with A and b as information (1 / variance); sums: kernels.block_sums() (blocks,
    34) with weights of `nu`.

    The variance is that of the motions estimated with one block left out at a time (the
    delete-a-group jackknife). It is computed along each eigenvector of the centred A, and is at
    least the variance for pixels with independent errors. The information of Student's t is (nu +
    1) / (nu + 3) of the sum of its weights.
    """
    axes = _Axes.of(equations)
    error = max(equations.error, 1e-12)
    return axes.information(equations, np.maximum(axes.jackknife(sums, nu, error), 1.0), error)


def spread_information(
    equations: NormalEquations, sums: np.ndarray, nu: float, spread: float, least_error: float
) -> NormalEquations:
    """`equations.as_information(spread, least_error)`, but with the jackknife's variance in
    directions where that is larger; sums: A and b of the blocks, (blocks, 27) or more columns.
    """
    axes = _Axes.of(equations)
    error = max(equations.error, least_error)
    factor = axes.jackknife(sums, nu, error)
    if (factor <= spread).all():
        return equations.as_information(spread, least_error)
    return axes.information(equations, np.maximum(factor, spread), error)


def with_bias(result: OdometryResult, calibrated: bool) -> OdometryResult:
    """The result of a sensor's frame; its stated information allows for an error of each component
    of the translation by the bias of depth.

    It does not make a motion degenerate: the bias is in no direction of its own. calibrated: the
    offset of depth is known.
    """
    if result.status is OdometryStatus.FAILED:
        return result
    share = CALIBRATED_BIAS if calibrated else ROUGH_BIAS
    error = share * float(np.linalg.norm(result.T_reference_camera.translation)) * np.eye(6, 3)
    biased = NormalEquations.of_information(result.information).with_error(error)
    return replace(result, information=biased.A)


class _Axes(NamedTuple):
    """Eigenvalues (6,) and eigenvectors (6, 6) of the centred A, which of them are observable, and
    G of NormalEquations.centred().
    """

    values: np.ndarray
    vectors: np.ndarray
    observable: np.ndarray
    G: np.ndarray

    @classmethod
    def of(cls, equations: NormalEquations) -> "_Axes":
        A_centred, G = equations.centred()
        values, vectors = np.linalg.eigh(A_centred)
        return cls(values, vectors, values > RANK_TOLERANCE * max(values[-1], 1e-30), G)

    def jackknife(self, sums: np.ndarray, nu: float, error: float) -> np.ndarray:
        """The jackknife's variance along each axis (6,), as a multiple of that for pixels with
        independent errors of mean square `error`.
        """
        A = self.G @ sums.take(SYMMETRIC, axis=1) @ self.G.T
        b = sums[:, 21:27] @ self.G.T
        total = A.sum(axis=0)
        total_b = b.sum(axis=0)
        # a bare wall leaves directions unobservable
        total += np.eye(6) * (1e-6 * np.trace(total) + 1e-12)
        without_one = np.linalg.solve(total - A, (total_b - b)[..., None])[..., 0]
        steps = without_one - np.linalg.solve(total, total_b)
        independent = np.where(self.observable, self.values * error, np.inf)
        factor = np.square(steps @ total @ self.vectors).sum(axis=0) / independent
        if nu <= 0:
            return factor
        return factor * ((nu + 3) / (nu + 1)) ** 2

    def information(
        self, equations: NormalEquations, factor: np.ndarray, error: float
    ) -> NormalEquations:
        """`equations` with A and b as information, if the variance along each axis is `factor` (6,)
        times that of independent errors.
        """
        G_inverse = np.linalg.solve(self.G, self.vectors)
        right = self.vectors.T @ (self.G @ equations.b)
        weights = self.observable / (factor * error)
        A = (G_inverse * (weights * self.values)) @ G_inverse.T
        b = G_inverse @ (weights * right)
        return replace(equations, A=A, b=b, is_information=True)
