"""Alignment of predicted with true depth: none, median, scale, or scale and shift (affine), by least
squares or robust against outliers.

x are predicted and y true values of the same pixels, (n,) each, in the quantity in which they are
aligned (depth or inverse depth). The scale and shift of relative depth: Eigen, Puhrsch, Fergus,
NeurIPS 2014; Zhou and others, CVPR 2017 (median); Ranftl and others, TPAMI 2022 (scale and shift).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

ALIGNMENTS = {
    "none": "the prediction is metric",
    "median": "scale: the ratio of the medians",
    "scale": "scale that fits best",
    "affine": "scale and shift that fit best",
}
#: Residuals below this share of the largest value are rounding.
_ROUNDING = 1e-12
#: The half that fits best is one of at most so many pixels, at equal distances, so that a frame
#: costs 0.05 s; all pixels close to its line count in the end.
_STARTED_FROM = 1 << 14
_MAX_STEPS = 60
#: Standard deviation of a normal distribution as a multiple of its median absolute deviation, and
#: how many of them an inlier is away (Rousseeuw, Leroy, Robust Regression and Outlier Detection,
#: 1987, pages 44, 45 and 202).
_SIGMA_OF_MEDIAN = 1.4826
_INLIER_SIGMAS = 2.5


@dataclass(frozen=True)
class DepthAlignment:
    """y = scale * x + shift, in the quantity in which the prediction is aligned."""

    scale: float = 1.0
    shift: float = 0.0

    def apply(self, x: np.ndarray) -> np.ndarray:
        """Predicted values of any shape in the truth's unit."""
        if self == DepthAlignment():
            return x
        return self.scale * x + self.shift


@dataclass(frozen=True)
class LinearSums:
    """What least squares needs of n pairs (x, y): their number, means, and sums of squares and
    products about the means.
    """

    count: int = 0
    mean_x: float = 0.0
    mean_y: float = 0.0
    xx: float = 0.0
    xy: float = 0.0

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray) -> "LinearSums":
        """Sums of pairs (n,)."""
        mean_x = float(x.mean())
        mean_y = float(y.mean())
        apart = x - mean_x
        return cls(len(x), mean_x, mean_y, float(apart @ apart), float(apart @ (y - mean_y)))

    def __add__(self, other: "LinearSums") -> "LinearSums":
        count = self.count + other.count
        if not self.count or not other.count:
            return other if other.count else self
        by_x = other.mean_x - self.mean_x
        by_y = other.mean_y - self.mean_y
        share = other.count / count
        between = self.count * share
        return LinearSums(
            count,
            self.mean_x + share * by_x,
            self.mean_y + share * by_y,
            self.xx + other.xx + between * by_x * by_x,
            self.xy + other.xy + between * by_x * by_y,
        )

    @property
    def scale(self) -> DepthAlignment:
        """The scale alone: sum of x y over sum of x x."""
        squares = self.xx + self.count * self.mean_x**2
        products = self.xy + self.count * self.mean_x * self.mean_y
        return DepthAlignment(products / squares)

    @property
    def affine(self) -> DepthAlignment:
        """Scale and shift. Raises InputError for predictions that do not vary."""
        if self.xx <= _ROUNDING**2 * self.count * self.mean_x**2:
            expected = "predicted depth that varies, which determines scale and shift"
            raise InputError(expected, found="one value", hint="the alignment scale")
        scale = self.xy / self.xx
        return DepthAlignment(scale, self.mean_y - scale * self.mean_x)


def fit(method: str, robust: bool, x: np.ndarray, y: np.ndarray) -> DepthAlignment:
    """The alignment of pairs (n,), at least one. robust: scale is the median of the
    ratios, and affine is fitted to the pixels close to the line of the half that fits best.

    Raises InputError for predictions that do not determine it.
    """
    if method == "none":
        return DepthAlignment()
    if method == "median":
        return DepthAlignment(float(np.median(y)) / _not_zero(float(np.median(x))))
    if method == "scale":
        return _robust_scale(x, y) if robust else LinearSums.of(x, y).scale
    return _robust_affine(x, y) if robust else LinearSums.of(x, y).affine


def fit_all(method: str, parts: Iterable[tuple[np.ndarray, np.ndarray]]) -> DepthAlignment:
    """One alignment, scale or affine by least squares, of the pairs (n,) of many images."""
    sums = LinearSums()
    for x, y in parts:
        sums = sums + LinearSums.of(x, y)
    return sums.scale if method == "scale" else sums.affine


def _not_zero(value: float) -> float:
    if value == 0:
        raise InputError("predicted depth with a median other than 0", found=value)
    return value


def _robust_scale(x: np.ndarray, y: np.ndarray) -> DepthAlignment:
    """The median of the ratios y / x."""
    used = x != 0
    return DepthAlignment(float(np.median(y[used] / x[used])))


def _robust_affine(x: np.ndarray, y: np.ndarray) -> DepthAlignment:
    """Reweighted least trimmed squares (Rousseeuw, Leroy, 1987): the line of the half of the pixels
    that fits best, then that of all pixels close to it.
    """
    some = slice(None, None, -(-len(x) // _STARTED_FROM))
    starts = [_line_of_medians(x[some], y[some]), LinearSums.of(x, y).affine]
    found = min((_trimmed(x[some], y[some], start) for start in starts), key=lambda line: line[1])
    residual = np.abs(found[0].apply(x) - y)
    sigma = _SIGMA_OF_MEDIAN * float(np.median(residual))
    rounding = _ROUNDING * float(np.abs(y).max())
    close = residual <= max(_INLIER_SIGMAS * sigma, rounding)
    return LinearSums.of(x[close], y[close]).affine


def _line_of_medians(x: np.ndarray, y: np.ndarray) -> DepthAlignment:
    """The line through the medians, with the ratio of the median absolute deviations as its slope
    (Ranftl and others, TPAMI 2022), and the sign that most pixels have.
    """
    middle_x = float(np.median(x))
    middle_y = float(np.median(y))
    spread = float(np.median(np.abs(x - middle_x)))
    slope = float(np.median(np.abs(y - middle_y))) / spread if spread else 0.0
    if float((np.sign(x - middle_x) * np.sign(y - middle_y)).sum()) < 0:
        slope = -slope
    return DepthAlignment(slope, middle_y - slope * middle_x)


def _trimmed(x: np.ndarray, y: np.ndarray, line: DepthAlignment) -> tuple[DepthAlignment, float]:
    """The line after steps that each fit the half with the smallest residuals, and the sum of their
    squares, which no step increases.
    """
    half = len(x) // 2 + 1
    least = np.inf
    for _ in range(_MAX_STEPS):
        residual = np.abs(line.apply(x) - y)
        limit = np.partition(residual, min(half, len(x) - 1))[half - 1 : half + 1].max()
        kept = residual <= limit
        squares = float((residual[kept] ** 2).sum())
        if squares >= least or LinearSums.of(x[kept], y[kept]).xx == 0:
            break
        least = squares
        line = LinearSums.of(x[kept], y[kept]).affine
    return line, least
