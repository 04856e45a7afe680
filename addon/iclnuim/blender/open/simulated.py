"""What Blender simulates in the open scene, and the caches that keep it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
from bpy.types import Object, ParticleSystem, Scene

from ...scene_files.blend_file import BlendFile

_ZONE = "GeometryNodeSimulationOutput"


def is_unbaked(scene: Scene) -> bool:
    """Whether an evaluation of other frames would change the state of a simulation."""
    return any(not cache.is_baked for _, cache in caches(scene))


def is_simulated(scene: Scene) -> bool:
    """Whether anything that is rendered is simulated."""
    if any(True for _ in caches(scene)):
        return True
    return any(dynamic_hair(o) or list(_with_zones(o)) for o in evaluated_objects(scene))


def caches(scene: Scene) -> Iterator[tuple[Object, Any]]:
    """(object, point cache) of every simulation that is rendered, without dynamic hair."""
    world = scene.rigidbody_world
    if world is not None and world.enabled and world.collection is not None:
        bodies = [thing for thing in world.collection.objects if thing.rigid_body]
        for thing in (body for body in bodies if body.rigid_body.type == "ACTIVE"):
            yield thing, world.point_cache
    for thing in evaluated_objects(scene):
        for modifier in thing.modifiers:
            if modifier.show_render and modifier.type in ("CLOTH", "SOFT_BODY"):
                yield thing, modifier.point_cache
            elif modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings is not None:
                for surface in modifier.canvas_settings.canvas_surfaces:
                    if surface.surface_format == "VERTEX":
                        yield thing, surface.point_cache
            elif modifier.type == "PARTICLE_SYSTEM" and modifier.show_render:
                system = modifier.particle_system
                if system.settings.type == "EMITTER":
                    yield thing, system.point_cache


def dynamic_hair(thing: Object) -> list[ParticleSystem]:
    """The systems of hair of an object that are simulated."""
    shown = [m for m in thing.modifiers if m.type == "PARTICLE_SYSTEM" and m.show_render]
    hair = [m.particle_system for m in shown if m.particle_system.settings.type == "HAIR"]
    return [system for system in hair if system.use_hair_dynamics and system.cloth is not None]


def evaluated_objects(scene: Scene) -> list[Object]:
    """The objects of the scene, and of collections that it instances."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = {block.original for block in depsgraph.ids if isinstance(block, Object)}
    return sorted(found | set(scene.objects), key=lambda thing: thing.name)


def unbaked_zones(scene: Scene, packed: set[int]) -> Iterator[tuple[Object, Any]]:
    """(object, modifier) with simulation zones that are not baked."""
    for thing in evaluated_objects(scene):
        for modifier, zones in _with_zones(thing):
            if not all(_is_kept(modifier, entry, packed) for entry in zones):
                yield thing, modifier


def _with_zones(thing: Object) -> Iterator[tuple[Any, list[Any]]]:
    """(modifier, its entries of simulation zones) that are rendered."""
    for modifier in thing.modifiers:
        if modifier.type == "NODES" and modifier.show_render:
            nodes = [entry for entry in modifier.bakes if entry.node]
            zones = [entry for entry in nodes if entry.node.bl_idname == _ZONE]
            if zones:
                yield modifier, zones


def _is_kept(modifier: Any, entry: Any, packed: set[int]) -> bool:
    """Whether a zone has a bake, in the file or in a folder."""
    place = f"{modifier.bake_directory}/{entry.bake_id}"
    if entry.use_custom_path:
        place = entry.directory
    return entry.bake_id in packed or Path(bpy.path.abspath(place), "meta").is_dir()


def packed_zones(path: Path) -> set[int]:
    """Numbers of the nodes whose bakes a .blend contains, for all objects that have them."""
    if path.suffix.lower() != ".blend":
        return set()
    file = BlendFile(path)
    fields = file.fields.get("NodesModifierBake", {})
    if "*packed" not in fields:
        return set()
    found: dict[bool, set[int]] = {True: set(), False: set()}
    for _, _, data in file.each({"NodesModifierBake"}):
        at = fields["id"].offset
        number = int.from_bytes(data[at : at + 4], "little", signed=True)
        found[bool(file.pointer(data, fields["*packed"].offset))].add(number)
    return found[True] - found[False]
