"""Metres to the 16-bit units of a TUM depth image, and back."""

from __future__ import annotations

import numpy as np

#: Units of a depth PNG per metre (TUM, ICL-NUIM).
UNITS_PER_METRE = 5000


def depth16_from_metres(depth_z_m: np.ndarray) -> tuple[np.ndarray, int]:
    """(h, w) planar metres -> (h, w) uint16, and how many values had no place in it.

    Those beyond 13.107 m, negative, infinite or NaN become 0, which means "no measurement"; nothing wraps. 0 itself is not counted.
    """
    units = np.asarray(depth_z_m, float) * UNITS_PER_METRE + 0.5
    with np.errstate(invalid="ignore"):
        fits = (units >= 0.5) & (units < 65536)
    lost = int((~fits).sum())
    return np.where(fits, units, 0).astype(np.uint16), lost


def metres_from_depth16(depth: np.ndarray) -> np.ndarray:
    """(h, w) uint16 -> float64 metres, 0 = no measurement."""
    return depth / float(UNITS_PER_METRE)
