"""Recordings of a board before a wall by a depth sensor: how far its edges grow and how ragged they
are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera

#: The wall is farther than the board by at least this factor.
_GAP = 1.15
#: Share of the board's height that is left out at its upper and lower edge, which grow too.
_ENDS = 0.15
#: Rows that an edge needs.
_ROWS = 20
#: Columns that a tilted edge crosses.
_CROSSED_PX = 2.0
#: Pixels on both sides of an edge in which it is looked for.
_REACH_PX = 16


@dataclass(frozen=True, eq=False)
class BoardRecording:
    """`frames` (n, h, w) planar depth in metres, 0 = missing, of a camera and an upright board of a
    known width before a wall, all of which do not move. The board faces the camera, and its left
    and right edge are in the image.
    """

    frames: np.ndarray
    camera: PinholeCamera
    width_m: float

    @cached_property
    def share(self) -> np.ndarray:
        """(h, w): the share of frames in which a pixel has the board's depth."""
        return ((self.frames > 0) & (self.frames < self._between_m)).mean(0)

    @cached_property
    def _between_m(self) -> float:
        """A depth between those of board and wall. Raises InputError without a gap between them."""
        log_z = np.log(np.sort(self.frames[self.frames > 0]))
        log_z = log_z[:: max(1, log_z.size // 4096)]
        gaps = np.diff(log_z)
        if not gaps.size or gaps.max() < np.log(_GAP):
            raise InputError("a board clearly before a wall", found="depth without a gap")
        place = int(gaps.argmax())
        return float(np.exp((log_z[place] + log_z[place + 1]) / 2))

    @cached_property
    def _rows(self) -> np.ndarray:
        """Rows that cross the board, away from its upper and lower edge. Raises InputError if it is
        cut off by the image's sides.
        """
        board = self.share > 0.5
        rows = np.flatnonzero(board.any(1))
        cut = int(_ENDS * rows.size)
        rows = rows[cut : rows.size - cut]
        inside = np.s_[:, : _REACH_PX // 2], np.s_[:, -_REACH_PX // 2 :]
        if rows.size < _ROWS or any(board[rows][side].any() for side in inside):
            raise InputError(
                f"an upright board over {_ROWS} rows or more, whose left and right edge are in the "
                "image",
                found=f"{rows.size} rows",
            )
        return rows

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean place of the left and the right edge in pixels along the rows, as lines: the place
        at the middle row (2,) and the slope (2,); and the place in each row (2, rows).
        """
        share = self.share[self._rows]
        middle = (np.arange(share.shape[1]) * share).sum(1) / share.sum(1)
        middle = int(np.median(middle))
        places = np.stack([middle - share[:, :middle].sum(1), middle + share[:, middle:].sum(1)])
        v = self._rows - self._rows.mean()
        slope, place = np.polyfit(v, places.T, 1)
        return place, slope, place[:, None] + slope[:, None] * v

    def checked(self) -> "BoardRecording":
        """Itself. Raises InputError where its edges cannot be measured: no gap between board and
        wall, an edge outside the image, or one along a column of pixels, whose place is known to a
        pixel only.
        """
        _, slope, lines = self._edges
        crossed_px = float((np.abs(slope) * lines.shape[1]).min())
        if crossed_px < _CROSSED_PX:
            found = f"an edge within {crossed_px:.1f} columns"
            raise InputError("a board that is tilted by a few degrees", found=found)
        return self

    @property
    def growth_px(self) -> float:
        """How far each edge grows in rows and columns: half of what the board is too wide, in
        pixels.
        """
        board = (self.frames > 0) & (self.frames < self._between_m)
        # the mean of the inverse, which noise and rounding leave unbiased
        inverse_depth = float(np.mean(1 / self.frames[board]))
        place, slope, _ = self._edges
        upright = np.sqrt(1 + slope.mean() ** 2)
        true_px = self.width_m * self.camera.fx * inverse_depth * upright
        return float((place[1] - place[0] - true_px) / 2 / (1 + np.abs(slope).mean()))

    @property
    def ragged_px(self) -> float:
        """Standard deviation of the place of an edge at a pixel, in pixels.

        The share of frames S(d) in which a pixel at the signed distance d beyond the mean edge has
        the board's depth gives the variance of the edge, the integral of 2 d (S(d) - (d < 0)).
        """
        _, slope, lines = self._edges
        share = self.share[self._rows]
        u = np.arange(share.shape[1]) + 0.5
        variances = []
        for line, sign, tangent in zip(lines, (-1, 1), slope, strict=True):
            beyond = sign * (u - line[:, None])
            near = np.abs(beyond) < _REACH_PX
            moments = np.where(near, 2 * beyond * (share - (beyond < 0)), 0).sum(1)
            # an edge of the true image is rounded to a pixel
            variances.append((moments.mean() - 1 / 12) / (1 + tangent**2))
        return float(np.sqrt(max(np.mean(variances), 0.0)))
