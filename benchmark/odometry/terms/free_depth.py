"""Parts of an image (tiles, corners) whose depth may be wrong: each has an unknown factor of its
inverse depth, and a weight that follows from it.
"""

import numpy as np

from ..normal_equations import NormalEquations

#: Standard deviations of the factor between the inverse depth of an image part and the sensor's:
#: loose at first, firm for inliers.
LOOSE = 1.0
FIRM = 0.05


def scale_ambiguity(geometry: NormalEquations, t_m: np.ndarray) -> float:
    """Scale ambiguity, 0..1, of a translation t_m (3,) given `geometry` (information): 0 where
    geometry determines its length, 1 where only the parts of the image do, through a factor common
    to all of them.
    """
    along = np.concatenate([t_m, np.zeros(3)]) / max(float(t_m @ t_m), 1e-12)
    variance = float(along @ np.linalg.solve(invertible(geometry.A), along))
    return variance / (variance + FIRM**2)


def inlier_weights(factor: np.ndarray, variance: np.ndarray, ambiguity: float) -> np.ndarray:
    """Weights (n,), 0..1, of parts of the image (Geman, McClure 1987): near 1 where the factor,
    with its `variance`, is near the expected one.

    The expected factor is 1 and, as far as the scale is ambiguous, the median of the parts with a
    small variance: a monocular camera does not observe scale, and all parts can have one common
    factor.
    """
    observed = variance < LOOSE**2
    median = float(np.median(factor[observed])) if observed.any() else 1.0
    deviation = factor / max(1.0 + (median - 1.0) * ambiguity, FIRM) - 1.0
    return 1.0 / (1.0 + deviation**2 / (FIRM**2 + variance)) ** 2


def invertible(information: np.ndarray) -> np.ndarray:
    """(6, 6): `information` with a weak prior, of at least a share of its trace that rounding does
    not lose: exact depth of a plane alone gives 1e14 in some directions and none in others.
    """
    return information + max(1e-3, 1e-12 * float(np.trace(information))) * np.eye(6)
