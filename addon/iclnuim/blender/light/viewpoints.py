"""Places of cameras in the free space of the open scene, from which its surfaces are seen."""

import numpy as np
from bpy.types import Depsgraph
from mathutils import Vector

from ...geometry.points import farthest_points
from ...lightmap.surfaces import Surfaces
from ..look_round import MAX_BACKS, ROOM_M, look_round

#: Rays that look round at a place: their share of hits is then known within 7 %.
_RAYS = 48
#: Places that are tried for each one wanted: at least some are in free space in every room.
_TRIED = 24
#: Free places are used if at least this share of the rays of the most enclosed place hits surfaces:
#: they are inside rooms, if there are any. If less than half of the places qualify, the scene is
#: open and these few are niches: then the second, lower share is used.
_ENCLOSED = 0.9
_IN_THE_OPEN = 0.25
#: No camera is nearer to a surface, and places before a surface are at most this far: a room.
_NEAREST_M = 0.1
_FARTHEST_M = 4.0


def viewpoints(depsgraph: Depsgraph, surfaces: Surfaces, count: int, seed: int) -> np.ndarray:
    """(up to count, 3) places in metres distributed over the scene's free space: in rooms, also in
    those whose walls show their backs, not inside solids or behind walls.
    """
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tried = range(count * _TRIED)
    places = np.array([_place_before(depsgraph, surfaces, rng) for _ in tried])
    fronts, backs, nearest_m, median_m = look_round(depsgraph, places, directions).T
    hits = np.where((backs <= MAX_BACKS) & (nearest_m >= _NEAREST_M), fronts, 0.0)
    enclosed = hits[hits > 0] >= _ENCLOSED * hits.max()
    share = _ENCLOSED if enclosed.sum() >= enclosed.size / 2 else _IN_THE_OPEN
    free = places[(hits > 0) & (hits >= share * hits.max())]
    behind = (fronts + backs > hits.max()) & (median_m >= ROOM_M) & (nearest_m >= _NEAREST_M)
    free = np.concatenate([free, places[behind]])
    return free if len(free) <= count else farthest_points(free, count)


def _place_before(depsgraph: Depsgraph, surfaces: Surfaces, rng: np.random.Generator) -> np.ndarray:
    """A random place on a ray from a random triangle, in front of it or behind it; each object has
    the same probability.
    """
    thing = rng.integers(surfaces.face_object[-1] + 1)
    faces = np.searchsorted(surfaces.face_object, [thing, thing + 1])
    first, end = np.searchsorted(surfaces.triangle_face, faces)
    corners = surfaces.corners_m[surfaces.triangles[rng.integers(first, end)]]
    ray = rng.normal(size=3)
    ray /= np.linalg.norm(ray)
    start = rng.dirichlet(np.ones(3)) @ corners + 1e-3 * ray
    hit, location, *_ = depsgraph.scene.ray_cast(
        depsgraph, Vector(start), Vector(ray), distance=_FARTHEST_M
    )
    reach = np.linalg.norm(np.array(location) - start) if hit else _FARTHEST_M
    return start + rng.uniform(0.1, 0.9) * reach * ray
