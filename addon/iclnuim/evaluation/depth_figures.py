"""The figures of predicted depth, and the sums over pixels from which they follow.

d is the predicted depth after alignment, g the true depth of the same pixel, in metres. Definitions
as in Eigen, Puhrsch, Fergus, NeurIPS 2014, and, for SILog, the KITTI depth benchmark (100 times the
standard deviation of ln d - ln g).
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..shown import Brief

#: The ratio of delta 1; its square and cube are those of delta 2 and 3.
_RATIO = 1.25
_RATIOS = (_RATIO, _RATIO**2, _RATIO**3)


@dataclass(frozen=True)
class DepthFigures:
    """Figures of some pixels. abs_rel: mean of |d - g| / g; sq_rel_m: of (d - g)^2 / g; rmse_m and
    mae_m: of d - g in metres; rmse_log: of ln d - ln g; silog: 100 times the standard deviation of
    ln d - ln g; log10: mean of |log10 d - log10 g|; delta1, delta2, delta3: share of pixels with
    max(d / g, g / d) below 1.25, 1.25^2, 1.25^3. boundary_f1: as of boundary_f1(), None where it
    was not computed or the truth has no boundary.
    """

    abs_rel: float
    sq_rel_m: float
    rmse_m: float
    rmse_log: float
    silog: float
    log10: float
    delta1: float
    delta2: float
    delta3: float
    mae_m: float
    boundary_f1: float | None = None

    def to_dict(self) -> dict[str, float | None]:
        """The figures by name."""
        return {name: getattr(self, name) for name in FIGURES}

    @classmethod
    def mean(cls, figures: "list[DepthFigures]") -> "DepthFigures":
        """The mean of each figure over frames; boundary_f1 over those that have one."""
        found: dict[str, Any] = {}
        for name in FIGURES:
            values = [getattr(one, name) for one in figures if getattr(one, name) is not None]
            found[name] = float(np.mean(values)) if values else None
        return cls(**found)


FIGURES = tuple(field.name for field in fields(DepthFigures))


@dataclass(frozen=True, eq=False, repr=False)
class DepthSums(Brief):
    """Sums over the pixels of k groups. count (k,); totals (8, k): of |e|/g, e^2/g, e^2, l^2,
    |log10(d/g)| and the pixels within each of the three ratios, with e = d - g and l = ln(d/g);
    absolute (k,): of |e|; log_mean and log_spread (k,): mean of l, and sum of its squares about it.
    """

    count: np.ndarray
    totals: np.ndarray
    absolute: np.ndarray
    log_mean: np.ndarray
    log_spread: np.ndarray

    @classmethod
    def of(
        cls, depth_m: np.ndarray, true_m: np.ndarray, groups: np.ndarray | None = None, k: int = 1
    ) -> "DepthSums":
        """Sums of pixels (n,) > 0, each in the group (n,) of 0..k-1; all in one without groups."""
        error = depth_m - true_m
        absolute = np.abs(error)
        relative = absolute / true_m
        ratio = depth_m / true_m
        log = np.log(ratio)
        ratio = np.maximum(ratio, true_m / depth_m)
        values = [relative, relative * absolute, error * error, log * log]
        values.append(np.abs(log) / np.log(10))
        values += [ratio < limit for limit in _RATIOS]
        if groups is None:
            count = np.array([len(true_m)])
            totals = np.array([[float(value.sum())] for value in values])
            log_mean = np.array([log.mean() if len(log) else 0.0])
            apart = log - log_mean[0]
            spread = np.array([float(apart @ apart)])
            return cls(count, totals, np.array([float(absolute.sum())]), log_mean, spread)
        count = np.bincount(groups, minlength=k)
        totals = np.array([np.bincount(groups, value, k) for value in values])
        log_mean = np.bincount(groups, log, k) / np.maximum(count, 1)
        spread = np.bincount(groups, (log - log_mean[groups]) ** 2, k)
        return cls(count, totals, np.bincount(groups, absolute, k), log_mean, spread)

    def __add__(self, other: "DepthSums") -> "DepthSums":
        count = self.count + other.count
        share = other.count / np.maximum(count, 1)
        by = other.log_mean - self.log_mean
        return DepthSums(
            count,
            self.totals + other.totals,
            self.absolute + other.absolute,
            self.log_mean + share * by,
            self.log_spread + other.log_spread + self.count * share * by * by,
        )

    def figures(self, group: int = 0, boundary: float | None = None) -> DepthFigures:
        """The figures of a group with at least one pixel."""
        count = int(self.count[group])
        means = (self.totals[:, group] / count).tolist()
        relative, squared_relative, squared, squared_log, log10, *shares = means
        return DepthFigures(
            abs_rel=relative,
            sq_rel_m=squared_relative,
            rmse_m=squared**0.5,
            rmse_log=squared_log**0.5,
            silog=100 * float(self.log_spread[group] / count) ** 0.5,
            log10=log10,
            delta1=shares[0],
            delta2=shares[1],
            delta3=shares[2],
            mae_m=float(self.absolute[group]) / count,
            boundary_f1=boundary,
        )
