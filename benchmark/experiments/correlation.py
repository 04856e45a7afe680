"""Tests whether a better trajectory means a better surface: Spearman's rank correlation with a
bootstrap interval, and the number of discordant pairs of cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .lookup import ate_of, surface_of
from .table import ResultTable

_RESAMPLES, _SEED = 4999, 0
#: Two errors differ clearly if one is smaller than the other by more than this share.
_CLEARLY = 0.1


@dataclass(frozen=True)
class Correlation:
    """rho: Spearman's correlation of n cells. low, high: its 95 % percentile bootstrap interval.
    pairs: number of pairs of cells on one sequence
    that clearly differ in ATE and in surface error. discordant: number of those in which the better
    trajectory has the worse surface.
    """

    n: int
    rho: float
    low: float
    high: float
    pairs: int
    discordant: int


def correlation(results: Sequence[dict]) -> Correlation | None:
    """Correlation over cells that have both an ATE and a surface; None for fewer than 4, or if all
    values of either are equal.
    """
    both = [(ate_of(r), surface_of(r), r["cell"].sequence) for r in results]
    known = [
        (ate_m, surface_m, sequence)
        for ate_m, surface_m, sequence in both
        if ate_m is not None and surface_m is not None
    ]
    x, y = (np.array([row[k] for row in known], float) for k in (0, 1))
    if len(known) < 4 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    low, high = interval(x, y)
    return Correlation(
        len(x), float(spearman(x, y)), low, high, *_pairs(x, y, [row[2] for row in known])
    )


def spearman(x: np.ndarray, y: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    """Rank correlation of x and y (n,): Pearson's correlation of their ranks.

    With rows (k, n), indices of k samples, it returns (k,). NaN if all values are equal.
    """
    rows = np.arange(len(x)) if rows is None else rows
    a, b = (_ranks(values, np.atleast_2d(rows)) - (len(x) + 1) / 2 for values in (x, y))
    with np.errstate(invalid="ignore"):
        found = (a * b).sum(1) / np.sqrt((a * a).sum(1) * (b * b).sum(1))
    return found.reshape(rows.shape[:-1])


def _ranks(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Ranks (k, n) within each sample, counted from 1; equal values get their mean rank."""
    levels, level = np.unique(values, return_inverse=True)
    level, first = level[rows], np.arange(len(rows))[:, None] * len(levels)
    counts = np.bincount((level + first).ravel(), minlength=len(rows) * len(levels)).reshape(
        len(rows), -1
    )
    mean = np.cumsum(counts, axis=1) - (counts - 1) / 2
    return np.take_along_axis(mean, level, axis=1)


def interval(x: np.ndarray, y: np.ndarray, share: float = 0.95) -> tuple[float, float]:
    """Percentile bootstrap (Efron 1979) over pairs drawn with replacement."""
    rows = np.random.default_rng(_SEED).integers(0, len(x), (_RESAMPLES, len(x)))
    low, high = np.nanquantile(spearman(x, y, rows), ((1 - share) / 2, (1 + share) / 2))
    return float(low), float(high)


def _pairs(x: np.ndarray, y: np.ndarray, sequences: Sequence[str]) -> tuple[int, int]:
    """Number of pairs of cells on one sequence that clearly differ in both errors, and number of
    discordant ones among them.
    """
    count = discordant = 0
    for i in range(len(x)):
        for j in range(i):
            if sequences[i] == sequences[j] and _differ(x[i], x[j]) and _differ(y[i], y[j]):
                count += 1
                discordant += bool((x[i] < x[j]) != (y[i] < y[j]))
    return count, discordant


def _differ(a: float, b: float) -> bool:
    return min(a, b) < (1 - _CLEARLY) * max(a, b)


def correlation_table(results: Sequence[dict]) -> ResultTable:
    """Correlation over all cells, and over those of each room and each noise."""
    groups = {"all cells": results}
    for name in ("room", "noise"):
        for value in sorted({getattr(r["cell"], name) for r in results}):
            groups[value.replace("_", " ")] = [
                r for r in results if getattr(r["cell"], name) == value
            ]
    rows = []
    for name, some in groups.items():
        if found := correlation(some):
            figures = (f"{v:.3f}" for v in (found.rho, found.low, found.high))
            rows.append((name, str(found.n), *figures, str(found.pairs), str(found.discordant)))
    columns = ("cells", "n", "Spearman's \u03c1", "95 % from", "to", "pairs", "discordant")
    notes = (
        "ATE against the mean error of the surface, aligned with the model by ICP. The interval is a percentile bootstrap over cells.",
        "Pairs: two cells on one sequence whose ATE and surface error both differ by more than 10 %. Discordant: the better trajectory has the worse surface.",
    )
    return ResultTable(
        "correlation", "ATE against surface error.", columns, tuple(rows), notes=notes
    )
