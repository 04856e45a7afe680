"""The colour scale of errors in tables and heat maps: logarithmic, and distinguishable without
colour vision and in grey.
"""

import math

import numpy as np

#: Ends of the scale in mm.
LOW_MM = 0.1
HIGH_MM = 100.0
#: Colours from small to large errors.
COLOURS = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")
#: Place on the scale from which black text is easier to read than white.
_BRIGHT = 0.55


def shown_mm(ate_m: float | None, failed: bool) -> float:
    """The error in mm that the colour shows: the highest for a failure."""
    value_mm = math.inf if ate_m is None else 1e3 * ate_m
    return float(np.clip(max(value_mm, HIGH_MM) if failed else value_mm, LOW_MM, HIGH_MM))


def ink(error_mm: float) -> str:
    """The colour of a text on the colour of an error."""
    return "black" if _place(error_mm) > _BRIGHT else "white"


def shade(error_mm: float) -> str:
    """CSS of the colour of an error, and of a text on it."""
    position = _place(error_mm) * (len(COLOURS) - 1)
    k = min(int(position), len(COLOURS) - 2)
    low = np.array([*bytes.fromhex(COLOURS[k][1:])])
    high = np.array([*bytes.fromhex(COLOURS[k + 1][1:])])
    r, g, b = np.rint(low + (high - low) * (position - k)).astype(int)
    return f"background:rgb({r},{g},{b});color:{ink(error_mm)}"


def _place(error_mm: float) -> float:
    """Place 0..1 on the scale."""
    return math.log(error_mm / LOW_MM) / math.log(HIGH_MM / LOW_MM)
