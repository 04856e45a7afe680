"""Light that does not lie where depth says: each tile of a view may have an inverse depth of its own.

Glass and mirrors have depth, and what is seen in them lies elsewhere: its parallax pulls a photometric odometer along
(a window that fills a third of the view halves the motion found). So every tile's inverse depth is a second unknown,
a factor near 1, eliminated from the equations of motion (Schur complement). At first it is loose, and so the motion
is that of a single eye; then depth is believed in tiles where the factor came out near 1, and given up where it did
not (Geman, McClure 1987).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.se3 import SE3
from .system import System, inverted

ACROSS, DOWN = 16, 12
#: Standard deviations of the factor: at first, and of what is believed in the end.
LOOSE, FIRM = 1.0, 0.05
#: So many of a tile's pixels share one error.
SPREAD = 25.0
MOST_CHANGE = 0.5
#: Mean square (grey levels) that slopes and interpolation leave at least.
LEAST_ERROR = 16.0


class Tiles:
    """factor (ACROSS * DOWN,) of inverse depth, row by row, in one alignment on one level."""

    def __init__(self) -> None:
        self.factor = np.ones(ACROSS * DOWN)
        self._open, self._T = None, np.eye(4)

    def follow(self, T: np.ndarray) -> None:
        """What the factors are now that the pose went from that of the last equations to T (4, 4)."""
        if self._open is not None:
            slopes, stiff, rest = self._open
            twist = SE3.from_matrix(T @ inverted(self._T)).log()
            change = (rest - slopes @ twist) / stiff
            self.factor = np.clip(self.factor + np.clip(change, -MOST_CHANGE, MOST_CHANGE), 0.0, 2.5)
        self._T = T

    def eliminated(self, sums: np.ndarray, firm: bool) -> System:
        """Equations of motion alone, from kernels.tile_sums() (tiles, 42). Their count: pixels where depth is believed."""
        system = System.of_sums(sums[:, :34].sum(axis=0))
        slopes, own, right = sums[:, 34:40], sums[:, 40], sums[:, 41]
        off, unit = self.factor - 1.0, SPREAD * max(system.error, LEAST_ERROR)
        believed = self._believed(unit / np.maximum(own, 1e-12)) if firm else np.ones(len(off))
        prior = believed * (unit * (FIRM if firm else LOOSE) ** -2)
        stiff, rest = own + prior + 1e-12, right - prior * off
        self._open = slopes, stiff, rest
        share = slopes / stiff[:, None]
        count = float(believed @ sums[:, 29])
        return replace(system, A=system.A - share.T @ slopes, b=system.b - share.T @ rest, count=count)

    def _believed(self, variance: np.ndarray) -> np.ndarray:
        """(tiles,) 0..1: where the factor, known to `variance`, is that of most tiles. While loose, all can be off by one
        factor, as one eye knows no scale; motion and factors then find back together.
        """
        informed = variance < LOOSE**2
        common = float(np.median(self.factor[informed])) if informed.any() else 1.0
        off = self.factor / max(common, FIRM) - 1.0
        return 1.0 / (1.0 + off**2 / (FIRM**2 + variance)) ** 2
