"""Routes through free space: a grid of clearances, and the shortest route between two points that keeps clear of everything."""

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..errors import InputError

#: Clearance (n,) in metres at points (n, 3): the distance to the nearest surface.
Clearance = Callable[[np.ndarray], np.ndarray]
#: Cells beyond this number are made larger; fewer than this are not made.
_MAX_CELLS, _MIN_CELL_M = 400_000, 0.1


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """clearance_m (i, j, k) at the centres low_m + cell_m * (i, j, k), and the function that it was read from."""

    low_m: np.ndarray
    cell_m: float
    clearance_m: np.ndarray
    measure: Clearance

    @classmethod
    def between(cls, low_m: np.ndarray, high_m: np.ndarray, measure: Clearance) -> "FreeSpace":
        """Over a box, in cells of 0.1 m or larger where the box is large."""
        size = np.maximum(high_m - low_m, 1e-3)
        cell_m = max(_MIN_CELL_M, float((size.prod() / _MAX_CELLS) ** (1 / 3)), float(size.max()) / 400)
        shape = tuple(int(n) + 1 for n in np.ceil(size / cell_m))
        points = low_m + cell_m * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)
        return cls(low_m, cell_m, measure(points).reshape(shape), measure)

    def route(self, start_m: np.ndarray, end_m: np.ndarray, clear_m: float) -> np.ndarray:
        """(n, 3) corners of a route from start to end that keeps `clear_m` from every surface, both included.

        Straight where that is clear; else the shortest by A* from cell to cell, then straightened. Raises InputError where there is none.
        """
        if self._is_clear(start_m, end_m, clear_m):
            return np.stack([start_m, end_m])
        cells = self._search(self._cell(start_m), self._cell(end_m), clear_m)
        return self._straightened(np.stack([start_m, *(self.low_m + self.cell_m * c for c in cells), end_m]), clear_m)

    def _cell(self, point_m: np.ndarray) -> tuple[int, int, int]:
        index = np.rint((point_m - self.low_m) / self.cell_m).astype(int)
        i, j, k = np.clip(index, 0, np.array(self.clearance_m.shape) - 1).tolist()
        return i, j, k

    def _search(self, start: tuple, end: tuple, clear_m: float) -> list[np.ndarray]:
        """Cells from start to end (A*). The two themselves need not be as clear: they were checked before."""
        goal, shape = np.array(end), self.clearance_m.shape
        steps = [(n, float(np.linalg.norm(n))) for n in product((-1, 0, 1), repeat=3) if any(n)]
        length: dict[tuple, float] = {start: 0.0}
        before: dict[tuple, tuple | None] = {start: None}
        open_, done = [(0.0, start)], set()
        while open_:
            cell = heapq.heappop(open_)[1]
            if cell == end:
                route = [end]
                while (previous := before[route[-1]]) is not None:
                    route.append(previous)
                return [np.array(cell) for cell in route[::-1]]
            if cell in done:
                continue
            done.add(cell)
            for step, far in steps:
                other = (cell[0] + step[0], cell[1] + step[1], cell[2] + step[2])
                inside = all(0 <= c < s for c, s in zip(other, shape, strict=True))
                if not inside or other in done or (other != end and self.clearance_m[other] < clear_m):
                    continue
                longer = length[cell] + far
                if longer < length.get(other, np.inf):
                    length[other], before[other] = longer, cell
                    heapq.heappush(open_, (longer + float(np.linalg.norm(goal - other)), other))
        raise InputError(
            "viewpoints with a route between them",
            found=f"none that keeps {clear_m:.2f} m from every surface",
            hint="a smaller {clearance_m}, or viewpoints in one room",
        )

    def _straightened(self, points: np.ndarray, clear_m: float) -> np.ndarray:
        """Corners left out as long as what joins the rest is clear."""
        kept, here = [points[0]], 0
        while here < len(points) - 1:
            there = len(points) - 1
            while there > here + 1 and not self._is_clear(points[here], points[there], clear_m):
                there -= 1
            kept.append(points[there])
            here = there
        return np.stack(kept)

    def _is_clear(self, a_m: np.ndarray, b_m: np.ndarray, clear_m: float) -> bool:
        count = max(2, int(np.linalg.norm(b_m - a_m) / 0.05) + 2)
        share = np.linspace(0.0, 1.0, count)[:, None]
        inner = (a_m + share * (b_m - a_m))[1:-1]
        return bool((self.measure(inner) >= clear_m).all())
