"""Light for a scene that has none: an even white sky, and lamps inside where the sky does not reach."""

import bpy
import numpy as np
from mathutils import Vector

from ..geometry.points import farthest_points
from . import compat, surfaces

#: Places tried, and sight lines from each.
_PLACES, _RAYS = 400, 48
#: Less of a place's sight lines than this reach the sky: then it needs lamps.
_SHUT_IN = 0.03
_LAMPS, _RADIUS_M = 4, 0.15
#: Watts for a square metre of the room's walls: mid-grey surfaces come out at about a third of white.
_W_PER_M2 = 1.0
#: What glows and is smaller than this is a status lamp, not the light of a room.
_SMALLEST_EMITTER_M = 0.03


def add_where_there_is_none(scene: bpy.types.Scene) -> list[str]:
    """Returns a sentence where light was added."""
    if _has_light(scene):
        return []
    world = bpy.data.worlds.new("Neutral light")
    if world.node_tree is None:
        world.use_nodes = True
    sky = world.node_tree.nodes["Background"].inputs
    sky["Color"].default_value, sky["Strength"].default_value = (1.0, 1.0, 1.0, 1.0), 1.0
    scene.world = world
    lamps = _light_inside(scene)
    inside = f", and {lamps} soft lamps inside, where the sky does not reach" if lamps else ""
    return [f"the scene has no light: an even white sky was added{inside}"]


def _has_light(scene: bpy.types.Scene) -> bool:
    lamps = [lamp.data for lamp in surfaces.rendered_lamps(scene)]
    instanced = any(o.type == "EMPTY" and o.instance_collection for o in scene.objects) and bpy.data.lights
    if any(lamp.energy > 0 for lamp in lamps) or instanced or _shines(scene.world):
        return True
    things = [o for o in scene.objects if o.type in surfaces.SURFACE_TYPES and not o.hide_render]
    glowing = [o for o in things if any(s.material and _emits(s.material.node_tree) for s in o.material_slots)]
    return any(max(o.dimensions) > _SMALLEST_EMITTER_M for o in glowing)


def _shines(world: bpy.types.World | None) -> bool:
    if world is None:
        return False
    if world.node_tree is None or not world.use_nodes:
        return max(world.color) > 0
    nodes = world.node_tree.nodes
    sky = any(_is_on(n, "Color", "Strength") for n in nodes if n.type == "BACKGROUND")
    return sky or any(n.type in ("EMISSION", "GROUP") for n in nodes)


def _emits(tree: bpy.types.NodeTree | None) -> bool:
    return tree is not None and any(
        (n.type == "EMISSION" and _is_on(n, "Color", "Strength"))
        or (n.type == "BSDF_PRINCIPLED" and _is_on(n, "Emission Color", "Emission Strength"))
        for n in compat.nodes_of(tree)
    )


def _is_on(node: bpy.types.Node, *names: str) -> bool:
    colour, strength = (node.inputs[name] for name in names)
    bright = colour.is_linked or max(tuple(colour.default_value)[:3]) > 0
    return bright and (strength.is_linked or strength.default_value > 0)


def _light_inside(scene: bpy.types.Scene) -> int:
    """Lamps at free places that are shut in, far from one another; how many."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = [o for o in scene.objects if o.type == "MESH" and not o.hide_render and len(o.data.polygons)]
    corners = np.array([np.array(o.matrix_world) @ (*c, 1.0) for o in shown for c in o.bound_box] or [np.zeros(4)])
    low, high = corners[:, :3].min(0), corners[:, :3].max(0)
    rng = np.random.default_rng(0)
    places = low + (high - low) * rng.uniform(0.05, 0.95, (_PLACES, 3))
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.array([_look_round(depsgraph, place, rays) for place in places])
    free = (seen[:, 1] < 0.1) & (seen[:, 2] > 2 * _RADIUS_M)
    shut_in = free & (seen[:, 0] < _SHUT_IN)
    if shut_in.sum() < 0.5 * max(free.sum(), 1):
        return 0
    chosen = farthest_points(places[shut_in], _LAMPS, first=int(places[shut_in][:, 2].argmax()))
    size = high - low
    watts = _W_PER_M2 * 2 * float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    for place in chosen:
        data = bpy.data.lights.new("Neutral light", "POINT")
        data.energy, data.shadow_soft_size = watts / len(chosen), _RADIUS_M
        lamp = bpy.data.objects.new("Neutral light", data)
        lamp.location, lamp.visible_camera = place, False  # seen in gloss: metal shows nothing else
        scene.collection.objects.link(lamp)
    return len(chosen)


def _look_round(depsgraph: bpy.types.Depsgraph, place: np.ndarray, rays: np.ndarray) -> tuple[float, float, float]:
    """Shares of sight lines that reach the sky and that end at a back, and the nearest surface in metres."""
    sky = backs = 0
    nearest = np.inf
    origin = Vector(place)
    for ray in rays:
        hit, location, normal, *_ = depsgraph.scene.ray_cast(depsgraph, origin, Vector(ray))
        sky += not hit
        if hit:
            backs += normal.dot(Vector(ray)) > 0
            nearest = min(nearest, (location - origin).length)
    return sky / len(rays), backs / len(rays), nearest
