"""Sets of points: the smallest upright box about them, and some of them far apart. Numpy only; metres."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .se3 import SE3

#: Directions in which the outline of the points is sought; a corner blunter than a step may be missed, the box holds it all the same.
_DIRECTIONS = 720


@dataclass(frozen=True)
class Box:
    """T_world_box: the box's centre, its x axis along the longer level side, z up; size_m (3,): its full sides."""

    T_world_box: SE3
    size_m: np.ndarray

    def corners(self) -> np.ndarray:
        """(8, 3) in the world."""
        signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
        return self.T_world_box.apply(signs * self.size_m)


def upright_box(points_m: np.ndarray) -> Box:
    """The upright box of least level area that holds all points (n, 3). A side of the smallest one lies along a side of the outline.

    Raises InputError for no points.
    """
    points_m = np.asarray(points_m, float).reshape(-1, 3)
    if not len(points_m):
        raise InputError("at least one point for a box", found="none")
    R = _about_z(_yaw(points_m[:, :2]))
    size = np.ptp(points_m @ R, axis=0)
    if size[1] > size[0]:
        R, size = R @ _about_z(-np.pi / 2), size[[1, 0, 2]]
    own = points_m @ R
    return Box(SE3(R, R @ ((own.min(0) + own.max(0)) / 2)), size)


def farthest_points(points: np.ndarray, count: int, first: int = 0) -> np.ndarray:
    """(count, 3) of points (n, 3), or all n where there are fewer: `first`, then always the one farthest from those chosen."""
    chosen = [first]
    distance = np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


def _about_z(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _yaw(points: np.ndarray) -> float:
    """The turn of the smallest rectangle about (n, 2) points, along one side of their outline; in doubt the smallest turn.

    The outline's corners are the points that are farthest in some direction.
    """
    angles = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    farthest = [int((points @ (np.cos(a), np.sin(a))).argmax()) for a in angles]
    outline = points[[i for k, i in enumerate(farthest) if i != farthest[k - 1]] or farthest[:1]]
    sides = np.roll(outline, -1, axis=0) - outline
    sides = sides[np.linalg.norm(sides, axis=1) > 1e-9]
    turns = np.unique(np.append(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 9), 0.0))
    along = np.stack([np.cos(turns), np.sin(turns)])
    across = np.stack([-along[1], along[0]])
    area = np.ptp(outline @ along, axis=0) * np.ptp(outline @ across, axis=0)
    return float(turns[np.flatnonzero(area <= area.min() * (1 + 1e-6) + 1e-12)[0]])
