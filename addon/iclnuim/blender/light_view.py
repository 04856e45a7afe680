"""Which surface points a camera inside the scene could see: places for such cameras, and a light test of every point."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from mathutils import Vector

from ..geometry.points import farthest_points
from ..lightmap.surfaces import Surfaces
from .light_points import Target, batches, kept

#: A place counts as free when less than this share of its sight lines ends at the back of a surface.
_BACKS = 0.1
#: Of free places those are taken that are enclosed nearly as much as the most enclosed: inside rooms, if there are any. Where
#: fewer than half of them are, the scene is open and those few are nooks: then all that see a fair part of what the best one sees.
_ENCLOSED, _IN_THE_OPEN = 0.9, 0.25
_RAYS = 48
_NEAREST_M, _FARTHEST_M = 0.1, 4.0
#: Test lamps outshine by far what glows in the scene, which baking cannot be told to leave out (W; radiance).
_POWER, _GLOW = 1e9, 1e4


def viewpoints(depsgraph: bpy.types.Depsgraph, surfaces: Surfaces, count: int, seed: int) -> np.ndarray:
    """(up to count, 3) places in metres spread over the scene's free space: in rooms, not inside solids nor behind walls."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    places = [_place_before(depsgraph, surfaces, rng) for _ in range(count * 24)]
    hits = np.array([_front_hits(depsgraph, p, directions) for p in places])
    enclosed = hits[hits > 0] >= _ENCLOSED * hits.max()
    share = _ENCLOSED if enclosed.sum() >= enclosed.size / 2 else _IN_THE_OPEN
    free = np.array(places)[(hits > 0) & (hits >= share * hits.max())]
    return free if len(free) <= count else farthest_points(free, count)


def _place_before(depsgraph: bpy.types.Depsgraph, surfaces: Surfaces, rng: np.random.Generator) -> np.ndarray:
    """A place on a sight line from a triangle of an object, each object as likely as any other, before or behind it."""
    faces = np.searchsorted(surfaces.face_object, [k := rng.integers(surfaces.face_object[-1] + 1), k + 1])
    rows = np.searchsorted(surfaces.triangle_face, faces)
    corners = surfaces.corners_m[surfaces.triangles[rng.integers(*rows)]]
    ray = rng.normal(size=3)
    ray /= np.linalg.norm(ray)
    start = rng.dirichlet(np.ones(3)) @ corners + 1e-3 * ray
    hit, location, *_ = depsgraph.scene.ray_cast(depsgraph, Vector(start), Vector(ray), distance=_FARTHEST_M)
    reach = np.linalg.norm(np.array(location) - start) if hit else _FARTHEST_M
    return start + rng.uniform(0.1, 0.9) * reach * ray


def _front_hits(depsgraph: bpy.types.Depsgraph, place: np.ndarray, directions: np.ndarray) -> int:
    """How many sight lines end at a front; 0 for a place that is not free."""
    scene, origin = depsgraph.scene, Vector(place)
    backs = fronts = 0
    for direction in directions:
        hit, location, normal, *_ = scene.ray_cast(depsgraph, origin, Vector(direction))
        if hit and (location - origin).length < _NEAREST_M:
            return 0
        back = hit and normal.dot(Vector(direction)) > 0
        backs, fronts = backs + back, fronts + (hit and not back)
        if backs > _BACKS * _RAYS:
            return 0
    return fronts


def seen(points_m: np.ndarray, normals: np.ndarray, places_m: np.ndarray, seed: int, rounds: int = 3) -> np.ndarray:
    """(n,) light of point lamps at the places on each point; 0 where none reaches its front, glass let through.

    Such light falls with distance and slant as the number of pixels does that cameras at those places spend on a surface. Each
    sample tries one of the lamps. Points still dark after a round are tried with four times as many, at last 4^rounds.
    """
    light = np.zeros(len(points_m), np.float32)
    if not len(places_m):
        return light + 1
    with _only_lamps(bpy.context.scene, places_m):
        for turn in range(rounds):
            dark = np.flatnonzero(light == 0)
            for part in batches(len(dark)):
                rows = dark[part]
                with Target(points_m[rows], normals[rows]) as target:
                    light[rows] = target.irradiance(4 ** (turn + 1), seed + turn).max(1)
            light[light < _GLOW] = 0.0
    return light


@contextmanager
def _only_lamps(scene: bpy.types.Scene, places_m: np.ndarray) -> Iterator[None]:
    """The scene lit by nothing but one point lamp at each place."""
    data = bpy.data.lights.new("light test", "POINT")
    data.energy, data.shadow_soft_size = _POWER, 0.0
    lamps = [bpy.data.objects.new("light test", data) for _ in places_m]
    with ExitStack() as stack:
        stack.enter_context(kept(scene, world=None))
        stack.enter_context(kept(scene.cycles, use_light_tree=False))
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
