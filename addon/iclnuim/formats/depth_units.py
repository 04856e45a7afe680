"""Conversion between depth in metres and the 16-bit units of a depth image, and counts of pixels
that cannot be stored.
"""

import numpy as np

from ..errors import InputError

#: Units per metre in TUM's and ICL-NUIM's depth images: the range ends at 13.107 m.
UNITS_PER_METRE = 5000.0
LARGEST_UNIT = 65535

#: Reasons for a pixel of value 0. All except `background` indicate a problem.
_AFTER_NOISE = ("beyond_range_after_noise", "no_distance_after_noise")
KINDS = ("background", "nan", "infinite", "negative", "beyond_range", *_AFTER_NOISE)


def depth16_from_metres(
    depth_z_m: np.ndarray, units_per_metre: float = UNITS_PER_METRE
) -> np.ndarray:
    """(h, w) planar metres -> uint16, rounded.

    Values outside 0..65535 units become 0 and never wrap around.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        units = depth_z_m * np.float32(units_per_metre)
        np.rint(units, out=units)
        units[~((units > 0) & (units <= LARGEST_UNIT))] = 0
        return units.astype(np.uint16)


def metres_from_depth16(units: np.ndarray, units_per_metre: float = UNITS_PER_METRE) -> np.ndarray:
    """(h, w) uint16 -> float32 metres, 0 = missing."""
    return units.astype(np.float32) / np.float32(units_per_metre)


def check_units(units_per_metre: float) -> float:
    """Returns the scale; raises InputError if it is implausible."""
    if not 1 <= units_per_metre <= 1e6:
        raise InputError("1 to 1000000 depth units per metre", found=units_per_metre)
    return float(units_per_metre)


def count_invalid(
    depth_z_m: np.ndarray, units_per_metre: float = UNITS_PER_METRE
) -> dict[str, int]:
    """Number of depth pixels that become 0, by kind; {} if there are none."""
    limit_m = np.float32((LARGEST_UNIT + 0.5) / units_per_metre)
    bad = depth_z_m[~((depth_z_m > 0) & (depth_z_m <= limit_m))]
    if not bad.size:
        return {}
    counts = {
        "background": bad == 0,
        "nan": np.isnan(bad),
        "infinite": np.isinf(bad),
        "negative": (bad < 0) & np.isfinite(bad),
        "beyond_range": (bad > limit_m) & np.isfinite(bad),
    }
    return {kind: int(which.sum()) for kind, which in counts.items() if which.any()}


def invalid_after_noise(
    depth_z_m: np.ndarray, noisy_z_m: np.ndarray, units_per_metre: float = UNITS_PER_METRE
) -> dict[str, int]:
    """Number of pixels with valid depth that noise moved out of range or made invalid (NaN,
    infinite, negative); {} if there are none.
    """
    if not count_invalid(noisy_z_m, units_per_metre).keys() - {"background"}:
        return {}
    good = (depth_z_m > 0) & (depth_z_m <= np.float32((LARGEST_UNIT + 0.5) / units_per_metre))
    found = count_invalid(noisy_z_m[good], units_per_metre)
    lost = sum(found.get(kind, 0) for kind in ("nan", "infinite", "negative"))
    counts = zip(_AFTER_NOISE, (found.get("beyond_range", 0), lost), strict=True)
    return {kind: count for kind, count in counts if count}
