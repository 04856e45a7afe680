"""The colour scale of errors in tables and heat maps: logarithmic, and distinguishable without
colour vision and in grey.
"""

import math

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex

#: Ends of the scale in mm.
LOW_MM = 0.1
HIGH_MM = 100.0
#: Colours from small to large errors.
COLOURS = ("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838")
#: Place on the scale from which black text is easier to read than white.
_BRIGHT = 0.55


def shown_mm(ate_m: float | None, failed: bool) -> float:
    """The error in mm that the colour shows: the highest for a failure."""
    if failed or ate_m is None:
        return HIGH_MM
    return float(np.clip(1e3 * ate_m, LOW_MM, HIGH_MM))


def ink(error_mm: float) -> str:
    """The colour of a text on the colour of an error."""
    return "black" if _place(error_mm) > _BRIGHT else "white"


def shade(error_mm: float) -> str:
    """CSS of the colour of an error, and of a text on it."""
    colour = to_hex(colour_map()(_place(error_mm)))
    return f"background:{colour};color:{ink(error_mm)}"


def colour_map() -> LinearSegmentedColormap:
    """The colours from 0 to 1 on the scale."""
    return LinearSegmentedColormap.from_list("ate", COLOURS)


def _place(error_mm: float) -> float:
    """Place 0..1 on the scale."""
    return math.log(error_mm / LOW_MM) / math.log(HIGH_MM / LOW_MM)
