"""95 % intervals of means and shares over few sequences."""

import math
from collections.abc import Sequence

from scipy import stats

_SHARE = 0.95


def log_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """The geometric mean of positive values, and the ends of its interval by Student's t over their
    logarithms; infinite for fewer than two values.
    """
    logs = [math.log(value) for value in values]
    mean = sum(logs) / len(logs)
    if len(logs) < 2:
        return math.exp(mean), 0.0, math.inf
    deviation = math.sqrt(sum((x - mean) ** 2 for x in logs) / (len(logs) - 1))
    half = stats.t.ppf(0.5 + _SHARE / 2, len(logs) - 1) * deviation / math.sqrt(len(logs))
    return math.exp(mean), math.exp(mean - half), math.exp(mean + half)


def share_interval(successes: int, trials: int) -> tuple[float, float, float]:
    """A share, and the ends of its interval (Wilson 1927)."""
    found = stats.binomtest(successes, trials).proportion_ci(_SHARE, method="wilson")
    return successes / trials, float(found.low), float(found.high)
