"""The scale of an estimate along the path: monocular methods know it only up to a factor, which
drifts (Strasdat, Montiel, Davison, RSS 2010).
"""

from dataclasses import dataclass

import numpy as np

from .align import MIN_EXTENT_M

#: Parts of equal length of the true path, each with a scale of its own.
PARTS = 10


@dataclass(frozen=True)
class ScaleDrift:
    """Factors from the estimate to the reference in consecutive parts of the path that have one."""

    scales: tuple[float, ...]

    @property
    def change(self) -> float:
        """How much larger the last one is than the first, as a share."""
        return self.scales[-1] / self.scales[0] - 1

    def __str__(self) -> str:
        return (
            f"{self.change:+.2%} from the first to the last tenth of the path "
            f"({min(self.scales):.6g} to {max(self.scales):.6g})"
        )


def scale_drift(reference_m: np.ndarray, estimate_m: np.ndarray) -> ScaleDrift | None:
    """The scales of ten parts of equal length of the reference's path, of paired positions (n, 3)
    in order: each the ratio of the spreads of both about their means, which no rotation or
    translation changes (Horn, JOSA A 1987, section 2D). None if fewer than two parts have one.
    """
    steps_m = np.linalg.norm(np.diff(reference_m, axis=0), axis=1)
    along_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    part = np.minimum((along_m * (PARTS / max(along_m[-1], MIN_EXTENT_M))).astype(int), PARTS - 1)
    scales = []
    for k in range(PARTS):
        true = _spread(reference_m[part == k])
        estimated = _spread(estimate_m[part == k])
        if true > MIN_EXTENT_M and estimated > 0:
            scales.append(true / estimated)
    return ScaleDrift(tuple(scales)) if len(scales) > 1 else None


def _spread(positions_m: np.ndarray) -> float:
    """RMS distance of positions (n, 3) from their mean; 0 for fewer than two."""
    if len(positions_m) < 2:
        return 0.0
    apart = positions_m - positions_m.mean(axis=0)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
