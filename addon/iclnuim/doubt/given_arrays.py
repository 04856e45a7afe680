"""Arrays from Python whose values are hardly what they should be: depth in another unit, colours
that are all white or black.
"""

import warnings

import numpy as np

#: Medians of depth in metres, from near a tabletop to a large hall or a street.
_USUAL_M = (0.02, 200.0)
#: RGB is white if this share of its values is at least 1, and some are far above.
_WHITE_SHARE = 0.9
_FAR_ABOVE = 4.0


def doubt_of_depth(depth_z_m: np.ndarray) -> str:
    """A sentence on planar depth (..., h, w) that is hardly in metres; "" if it may be."""
    measured = depth_z_m[np.isfinite(depth_z_m) & (depth_z_m > 0)]
    if not measured.size:
        return "no depth is above 0 m: planar z grows forwards, and 0 is missing"
    median_m = float(np.median(measured))
    if _USUAL_M[0] <= median_m <= _USUAL_M[1]:
        return ""
    unit, factor = (
        ("millimetres", "divide by 1000") if median_m > 1 else ("kilometres", "times 1000")
    )
    return (
        f"depth of a median of {median_m:.4g} m may not be in metres: {factor} if it is in {unit}"
    )


def doubt_of_rgb(rgb: np.ndarray) -> str:
    """A sentence on scene-linear RGB (h, w, 3) that is white, black or invalid; "" if it is not."""
    if invalid := np.count_nonzero(~np.isfinite(rgb)):
        of = f"{invalid} of {rgb.size} RGB values"
        return f"{of} are NaN or infinite, which become black or white"
    if (rgb <= 0).all():
        return "no RGB value is above 0: the image is black"
    is_white = float((rgb >= 1).mean()) > _WHITE_SHARE and float(np.max(rgb)) > _FAR_ABOVE
    if not is_white:
        return ""
    return (
        f"{float((rgb >= 1).mean()):.0%} of the RGB values are white or brighter (up to "
        f"{float(np.max(rgb)):.4g}): scene-linear RGB has 1 = white; divide 8-bit values by 255 and "
        "see iclnuim.linear_from_srgb8"
    )


def warn(sentence: str) -> None:
    """Warn of a sentence at the place that called the caller; nothing for ""."""
    if sentence:
        warnings.warn(sentence, UserWarning, stacklevel=3)
