"""Tests whether a better trajectory means a better surface: Spearman's rank correlation with a
bootstrap interval, and the number of discordant pairs of cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import stats

from ...cell import Measured
from ...table import ResultTable
from .claims import TOLERANCE
from .figures import ate_of, surface_of

#: The ends of the interval move by less than 0.02 from one seed to another.
_RESAMPLES = 4999
#: The interval of unrelated errors is 1.2 wide with so many cells; with half as many 1.9, and all
#: that is possible is 2.
MIN_CELLS = 12


@dataclass(frozen=True)
class Correlation:
    """rho: Spearman's correlation of n cells. low, high: its 95 % percentile bootstrap interval
    (Efron 1979) over cells. pairs: number of pairs of cells on one sequence that clearly differ in
    ATE and in surface error. discordant: number of those in which the better trajectory has the
    worse surface.
    """

    n: int
    rho: float
    low: float
    high: float
    pairs: int
    discordant: int


def correlation(results: Sequence[Measured]) -> Correlation | None:
    """Correlation over cells that have both an ATE and a surface; None for fewer than MIN_CELLS, or
    if all values of either are equal. Only the first noise seed counts, with which every odometer
    has a surface.
    """
    known = []
    for result in results:
        errors = (ate_of(result.figures), surface_of(result.figures))
        if None not in errors and not result.key.seed:
            known.append((*errors, result.key.sequence))
    x = np.array([row[0] for row in known], float)
    y = np.array([row[1] for row in known], float)
    if len(known) < MIN_CELLS or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    low, high = interval(x, y)
    pairs = 0
    discordant = 0
    for i, j in combinations(range(len(known)), 2):
        same = known[i][2] == known[j][2]
        if same and _differ(x[i], x[j]) and _differ(y[i], y[j]):
            pairs += 1
            discordant += bool((x[i] < x[j]) != (y[i] < y[j]))
    rho = float(stats.spearmanr(x, y).statistic)
    return Correlation(len(x), rho, low, high, pairs, discordant)


def interval(x: np.ndarray, y: np.ndarray, share: float = 0.95) -> tuple[float, float]:
    """The percentile interval of Spearman's correlation over pairs drawn with replacement."""
    found = stats.bootstrap(
        (x, y),
        _spearman,
        n_resamples=_RESAMPLES,
        paired=True,
        vectorized=True,
        method="percentile",
        rng=np.random.default_rng(0),
    )
    # samples whose values are all equal have no correlation
    ends = ((1 - share) / 2, (1 + share) / 2)
    low, high = np.nanquantile(found.bootstrap_distribution, ends)
    return float(low), float(high)


def _spearman(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
    """Of many samples at once: Pearson's correlation of their ranks; NaN if all are equal."""
    a = stats.rankdata(x, axis=axis) - (x.shape[axis] + 1) / 2
    b = stats.rankdata(y, axis=axis) - (y.shape[axis] + 1) / 2
    with np.errstate(invalid="ignore"):
        return (a * b).sum(axis) / np.sqrt((a * a).sum(axis) * (b * b).sum(axis))


def _differ(a: float, b: float) -> bool:
    return min(a, b) < (1 - TOLERANCE) * max(a, b)


def correlation_table(results: Sequence[Measured]) -> ResultTable:
    """Correlation over all cells, and over those of each room and each noise."""
    groups = [("all cells", list(results))]
    for name in ("room", "noise"):
        for value in sorted({getattr(r.key, name) for r in results}):
            own = [r for r in results if getattr(r.key, name) == value]
            groups.append((value.replace("_", " "), own))
    rows = []
    for name, some in groups:
        if found := correlation(some):
            figures = (f"{v:.3f}" for v in (found.rho, found.low, found.high))
            rows.append((name, str(found.n), *figures, str(found.pairs), str(found.discordant)))
    columns = ("cells", "n", "Spearman's \u03c1", "95 % from", "to", "pairs", "discordant")
    notes = (
        "ATE against the mean error of the surface, aligned with the model by ICP. "
        "The interval is a percentile bootstrap over cells.",
        "Pairs: two cells on one sequence whose ATE and surface error both differ by more than "
        "10 %. Discordant: the better trajectory has the worse surface.",
    )
    title = "ATE against surface error."
    return ResultTable("correlation", title, columns, tuple(rows), notes=notes)
