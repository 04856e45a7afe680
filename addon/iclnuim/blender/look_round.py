"""What rays from a place in the open scene meet: whether it is in a room, in the open or in a
solid.
"""

from typing import NamedTuple

import numpy as np
from bpy.types import Depsgraph
from mathutils import Vector

#: The median distance of what rays meet in a room whose walls show their backs; in solids it is
#: shorter.
ROOM_M = 1.0
#: A place is in free space if less than this share of its rays ends at the back of a surface.
MAX_BACKS = 0.1


class Surroundings(NamedTuple):
    """The shares of the rays that end at the front and at the back of a surface, and the smallest
    and the median length of both in metres, inf without any.
    """

    fronts: float
    backs: float
    nearest_m: float
    median_m: float


def look_round(depsgraph: Depsgraph, places: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 4): the Surroundings of places (n, 3) in metres along unit directions (d, 3)."""
    return np.array([_seen(depsgraph, Vector(place), directions) for place in places])


def _seen(depsgraph: Depsgraph, origin: Vector, directions: np.ndarray) -> Surroundings:
    lengths_m = []
    backs = 0
    for direction in directions:
        hit, location, normal, *_ = depsgraph.scene.ray_cast(depsgraph, origin, Vector(direction))
        if hit:
            lengths_m.append((location - origin).length)
            backs += normal.dot(Vector(direction)) > 0
    if not lengths_m:
        return Surroundings(0.0, 0.0, np.inf, np.inf)
    rays = len(directions)
    middle_m = float(np.median(lengths_m))
    return Surroundings((len(lengths_m) - backs) / rays, backs / rays, min(lengths_m), middle_m)
