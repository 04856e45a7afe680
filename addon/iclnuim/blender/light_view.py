"""Which surface points a camera inside the scene could see: places for such cameras, and a light test of every point."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from mathutils import Vector

from .light_points import irradiance, kept

#: A place counts as free when less than this share of its sight lines ends at the back of a surface.
_BACKS = 0.1
_RAYS = 48
_NEAREST_M = 0.03


def viewpoints(depsgraph: bpy.types.Depsgraph, low_m: np.ndarray, high_m: np.ndarray, count: int, seed: int) -> np.ndarray:
    """(up to count, 3) places spread over the free space of the box low_m..high_m: not inside solids, not behind walls."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    candidates = rng.uniform(low_m, high_m, (count * 24, 3))
    free = np.array([p for p in candidates if _is_free(depsgraph, p, directions)]).reshape(-1, 3)
    return _spread(free, count)


def _is_free(depsgraph: bpy.types.Depsgraph, place: np.ndarray, directions: np.ndarray) -> bool:
    scene, origin = depsgraph.scene, Vector(place)
    backs = hits = 0
    for direction in directions:
        hit, location, normal, *_ = scene.ray_cast(depsgraph, origin, Vector(direction))
        if hit:
            if (location - origin).length < _NEAREST_M:
                return False
            hits += 1
            backs += normal.dot(Vector(direction)) > 0
        if backs > _BACKS * _RAYS:
            return False
    return hits > 0


def _spread(places: np.ndarray, count: int) -> np.ndarray:
    """The first place, then always the one farthest from those taken."""
    if len(places) <= count:
        return places
    taken, distance = [0], np.linalg.norm(places - places[0], axis=1)
    while len(taken) < count:
        taken.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(places - places[taken[-1]], axis=1))
    return places[taken]


def seen(points_m: np.ndarray, normals: np.ndarray, places_m: np.ndarray, samples: int, seed: int) -> np.ndarray:
    """(n,) bool: whether a point lamp at one of the places reaches the front of each point, glass let through.

    Each sample tries one of the lamps, so that a point which few places see may be missed.
    """
    if not len(places_m):
        return np.ones(len(points_m), bool)
    scene = bpy.context.scene
    with _only_lamps(scene, places_m), kept(scene.cycles, max_bounces=0, use_light_tree=False, light_sampling_threshold=0.0):
        return irradiance(points_m, normals, samples, seed).max(1) > 0


@contextmanager
def _only_lamps(scene: bpy.types.Scene, places_m: np.ndarray) -> Iterator[None]:
    """The scene lit by nothing but one point lamp at each place."""
    data = bpy.data.lights.new("light test", "POINT")
    data.energy, data.shadow_soft_size = 1000.0, 0.0
    lamps = [bpy.data.objects.new("light test", data) for _ in places_m]
    with ExitStack() as stack:
        stack.enter_context(kept(scene, world=None))
        for thing in scene.objects:
            if thing.type == "LIGHT":
                stack.enter_context(kept(thing, hide_render=True))
        for lamp, place in zip(lamps, places_m, strict=True):
            lamp.location = place
            scene.collection.objects.link(lamp)
        try:
            yield
        finally:
            for lamp in lamps:
                bpy.data.objects.remove(lamp)
            bpy.data.lights.remove(data)
