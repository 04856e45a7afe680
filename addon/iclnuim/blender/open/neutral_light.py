"""Light for a user-provided scene that has none."""

import bpy
import numpy as np
from bpy.types import Object, Scene

from ...geometry.points import farthest_points
from .. import compat, materials, surfaces
from ..look_round import MAX_BACKS, ROOM_M, look_round
from ..sky import gives_light

#: Random places that are tried for lamps inside, and the number of rays from each: in a room of
#: 20 m2, about ten places a square metre, whose shares of rays are known within 7 %.
_PLACES = 400
_RAYS = 48
#: A place needs lamps if less than this share of its rays reaches the sky: in a room, less than a
#: small window lets through.
_MAX_SKY = 0.03
#: One lamp for each quarter of a room, of the size of a ceiling lamp: soft shadows.
_LAMPS = 4
_RADIUS_M = 0.15
#: Watts per square metre of the room's walls: mid-grey surfaces then have about a third of white.
_W_PER_M2 = 1.0
#: A smaller emitting object is a status lamp, not the light of a room.
_MIN_EMITTER_M = 0.03


def light_up(scene: Scene, lost_sky: bool) -> list[str]:
    """Add light to a scene that has none: a uniform white sky, and lamps inside rooms that the sky
    does not reach. Returns a note if light was added.

    lost_sky: the image of the sky is missing: its plain colour stays, and counts as no light.
    """
    if _has_light(scene, lost_sky):
        return []
    if lost_sky:
        lost = "the image of the sky is missing: its plain colour gives the light"
        lamps = _light_inside(scene)
        return [f"{lost}, and {lamps} soft lamps inside" if lamps else lost]
    compat.add_white_sky(scene, 1.0)
    note = "the scene has no light: a uniform white sky was added"
    if lamps := _light_inside(scene):
        note += f", and {lamps} soft lamps inside, where the sky does not reach"
    return [note]


def _has_light(scene: Scene, lost_sky: bool) -> bool:
    if any(lamp.data.energy > 0 for lamp in surfaces.rendered_objects(scene, {"LIGHT"})):
        return True
    instances = any(o.type == "EMPTY" and o.instance_collection for o in scene.objects)
    if (instances and bpy.data.lights) or (gives_light(scene.world) and not lost_sky):
        return True
    things = surfaces.rendered_objects(scene, surfaces.SURFACE_TYPES)
    return any(max(thing.dimensions) > _MIN_EMITTER_M and _emits(thing) for thing in things)


def _emits(thing: Object) -> bool:
    return any(materials.emits(slot.material) for slot in thing.material_slots)


def _light_inside(scene: Scene) -> int:
    """Add lamps at enclosed places in free space, far from one another. Returns their number."""
    meshes = [o for o in scene.objects if o.type == "MESH" and not o.hide_render]
    corners_m = surfaces.box_corners_m([o for o in meshes if len(o.data.polygons)])
    low = corners_m.min(0)
    size = corners_m.max(0) - low
    rng = np.random.default_rng(0)
    places = low + size * rng.uniform(0.05, 0.95, (_PLACES, 3))
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    fronts, backs, nearest_m, median_m = look_round(depsgraph, places, rays).T
    free = nearest_m > 2 * _RADIUS_M
    shut_in = fronts + backs > 1 - _MAX_SKY
    before = free & (backs < MAX_BACKS)
    behind = free & (backs > fronts) & (median_m >= ROOM_M)
    for side in (before, behind):
        inside = places[side & shut_in]
        if len(inside) > 0.5 * side.sum():
            break
    else:
        return 0
    chosen = farthest_points(inside, _LAMPS, first=int(inside[:, 2].argmax()))
    area_m2 = 2 * float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    for place in chosen:
        data = bpy.data.lights.new("Neutral light", "POINT")
        data.energy = _W_PER_M2 * area_m2 / len(chosen)
        data.shadow_soft_size = _RADIUS_M
        lamp = bpy.data.objects.new("Neutral light", data)
        lamp.location = place
        lamp.visible_camera = False  # visible in reflections, because metal shows nothing else
        scene.collection.objects.link(lamp)
    return len(chosen)
