"""Where light changes fast: edges of shadows and of patches of sun, which need more texels than even light."""

from __future__ import annotations

import numpy as np

from .denoise import luminance
from .filling import shifted


def contrast(half_a: np.ndarray, half_b: np.ndarray, chart: np.ndarray) -> np.ndarray:
    """(h, w) squared steps of brightness to the next texels of a chart, by two independent halves (h, w, 3) of the light.

    Brightness is the root of light, near to what a picture shows. The product of both halves' steps is free of their noise in
    the mean; single values may be negative. chart (h, w), -1 outside.
    """
    a, b = (np.sqrt(np.maximum(luminance(half), 0)) for half in (half_a, half_b))
    total = np.zeros(chart.shape)
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        same = (chart >= 0) & (shifted(chart, dy, dx, -2) == chart)
        total += np.where(same, (shifted(a, dy, dx, 0) - a) * (shifted(b, dy, dx, 0) - b), 0)
    return total / 4
