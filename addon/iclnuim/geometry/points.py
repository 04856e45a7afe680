"""Sets of points in metres: the smallest upright box around them, and farthest-point sampling.

Numpy only.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .se3 import SE3

#: Number of directions in which the outline of the points is searched. A corner blunter than a step
#: can be missed; the box still contains it.
_DIRECTIONS = 720


@dataclass(frozen=True)
class Box:
    """T_world_box: pose of the box's centre, x along the longer horizontal side, z up; size_m (3,):
    lengths of its sides.
    """

    T_world_box: SE3
    size_m: np.ndarray

    def corners(self) -> np.ndarray:
        """The corners (8, 3) in the world."""
        signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
        return self.T_world_box.apply(signs * self.size_m)


def upright_box(points_m: np.ndarray) -> Box:
    """The upright box with the smallest horizontal area that contains all points (n, 3). One of its
    sides is along a side of the outline.

    Raises InputError if there are no points.
    """
    points_m = np.asarray(points_m, float).reshape(-1, 3)
    if not len(points_m):
        raise InputError("at least one point for a box", found="none")
    R = _about_z(_yaw(points_m[:, :2]))
    size = np.ptp(points_m @ R, axis=0)
    if size[1] > size[0]:
        R = R @ _about_z(-np.pi / 2)
        size = size[[1, 0, 2]]
    rotated = points_m @ R
    return Box(SE3(R, R @ ((rotated.min(0) + rotated.max(0)) / 2)), size)


def farthest_points(points: np.ndarray, count: int, first: int = 0) -> np.ndarray:
    """Farthest-point sampling: (count, 3) of points (n, 3), or all n if there are fewer.

    Starts at `first`.
    """
    chosen = [first]
    distance = np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


def _about_z(yaw: float) -> np.ndarray:
    c = np.cos(yaw)
    s = np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _yaw(points: np.ndarray) -> float:
    """Angle in radians of the smallest rectangle around (n, 2) points, along one side of their
    outline; of equal areas the smallest angle.

    The corners of the outline are the points that are farthest in some direction.
    """
    angles = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    farthest = [int((points @ (np.cos(a), np.sin(a))).argmax()) for a in angles]
    outline = points[[i for k, i in enumerate(farthest) if i != farthest[k - 1]] or farthest[:1]]
    sides = np.roll(outline, -1, axis=0) - outline
    sides = sides[np.linalg.norm(sides, axis=1) > 1e-9]
    candidates = np.unique(
        np.append(np.round(np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2), 9), 0.0)
    )
    along = np.stack([np.cos(candidates), np.sin(candidates)])
    across = np.stack([-along[1], along[0]])
    area = np.ptp(outline @ along, axis=0) * np.ptp(outline @ across, axis=0)
    return float(candidates[np.flatnonzero(area <= area.min() * (1 + 1e-6) + 1e-12)[0]])
