"""Simulations of a user-provided scene: rigid bodies, cloth, soft bodies, particles, dynamic hair,
dynamic paint, simulation zones.

A simulated frame depends on those before it. They are baked once, up to the last frame of a run,
and kept as a copy of the scene in the cache, so that a frame is the same whichever others a process
renders.
"""

import hashlib
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

from ... import shipped
from ...errors import InputError, WorkError
from ...formats.files import locked
from .. import compat, surfaces
from ..notes import names_of
from . import scene_paths
from .blend_file import BlendFile, text

#: Version of the copies: raise it if the same scene is baked otherwise.
_VERSION = 1
#: Bytes of a vertex or particle in a frame of a cache: position, velocity and rotation, at most.
_POINT_BYTES = 64
_ZONE = "GeometryNodeSimulationOutput"
#: Type of a fluid modifier, and the flag of a domain whose data are baked.
_DOMAIN = 1
_BAKED_DATA = 2


def refuse_fluids(path: Path) -> None:
    """Raises InputError for a .blend with a fluid domain without a finished cache. Call it before
    the file is opened: a domain writes files, and may end the process, when it is evaluated.
    """
    try:
        is_left = _has_unbaked_domain(BlendFile(path), path.parent)
    except InputError:
        raise
    except Exception as error:  # as for any damaged file
        damage = f"damaged blocks: {error}"
        raise InputError("a scene that Blender can read", path=path, found=damage) from None
    if is_left:
        hint = "baking the fluid in Blender and saving the file, or deleting its domain"
        raise InputError("baked fluids", path=path, found="a fluid domain not baked", hint=hint)


def _has_unbaked_domain(file: BlendFile, folder: Path) -> bool:
    domains = set()
    for _, kind, data in file.each({"FluidModifierData"}):
        fields = file.fields[kind]
        if data[fields["type"].offset] & _DOMAIN:
            domains.add(file.pointer(data, fields["*domain"].offset))
    for block, kind, data in file.each({"FluidDomainSettings"}):
        fields = file.fields[kind]
        cache = fields["cache_directory"]
        name = text(data[cache.offset : cache.offset + cache.length])
        place = folder / name.removeprefix("//")
        is_baked = data[fields["cache_flag"].offset] & _BAKED_DATA and place.is_dir()
        if block.address in domains and not is_baked:
            return True
    return False


def is_unbaked(scene: bpy.types.Scene) -> bool:
    """Whether an evaluation of other frames would change the state of a simulation."""
    return any(not cache.is_baked for _, cache in _caches(scene))


def baked(path: Path, frames: int) -> tuple[Path | None, list[str]]:
    """Bake the simulations of the open scene for a run of so many frames, unless a copy of it is in
    the cache. Returns the copy to be opened instead, and notes. There is none without simulations,
    and where the cache cannot be written: then the open scene is baked.

    Raises InputError for what Blender cannot bake, WorkError if it needs more than the free disk.
    """
    scene = bpy.context.scene
    with surfaces.as_rendered(scene):
        zones = list(_zones(scene, _packed_zones(path)))
        names = {thing.name for thing, cache in _caches(scene) if not cache.is_baked}
        names |= {thing.name for thing in _evaluated(scene) if _dynamic_hair(thing)}
    names |= {thing.name for thing, _ in zones}
    if not names:
        return None, []
    decides = [str(path), scene_paths.sha256(path), frames, compat.version_line(), _VERSION]
    key = hashlib.sha256(repr(decides).encode()).hexdigest()[:20]
    copy = shipped.cache_folder() / "simulations" / f"{key}.blend"
    with suppress(OSError):
        copy.parent.mkdir(parents=True, exist_ok=True)
    if not copy.parent.is_dir():
        return None, [_bake(path, names, zones, frames)]
    with locked(copy.parent, wait=True):
        if copy.is_file():
            return copy, []
        _check_space(copy.parent, names, frames)
        note = _bake(path, names, zones, frames)
        try:
            _save(copy)
        except (OSError, RuntimeError):
            return None, [note]
        return copy, [f"{note}, {copy.stat().st_size / 1e6:.1f} MB in the cache"]


def _check_space(folder: Path, names: set[str], frames: int) -> None:
    points = 0
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        for name in names:
            evaluated = bpy.data.objects[name].evaluated_get(depsgraph)
            points += len(getattr(evaluated.data, "vertices", ())) or 1
            points += sum(system.settings.count for system in evaluated.particle_systems)
    need = points * frames * _POINT_BYTES
    free = shutil.disk_usage(folder).free
    if need > free:
        space = f"need up to {need / 1e9:.2f} GB, {free / 1e9:.2f} GB are free"
        raise WorkError(f"{folder}: simulations of {frames} frames {space}", hint="fewer {frames}")


def _save(copy: Path) -> None:
    """Save the open scene as `copy`, whose references are absolute; complete or not at all."""
    bpy.ops.file.make_paths_absolute()
    for thing in bpy.data.objects:
        for modifier in thing.modifiers:
            if modifier.type == "NODES" and modifier.bake_directory:
                modifier.bake_directory = bpy.path.abspath(modifier.bake_directory)
    part = copy.with_name(f"{copy.stem}-{os.getpid()}.tmp.blend")
    try:
        bpy.ops.wm.save_as_mainfile(
            filepath=str(part), copy=True, compress=True, relative_remap=False
        )
        os.replace(part, copy)
    finally:
        part.unlink(missing_ok=True)


def _bake(path: Path, names: set[str], zones: list[tuple[bpy.types.Object, Any]], last: int) -> str:
    """Bake all simulations of the open scene up to frame `last`, in memory. Returns a note."""
    begun = time.perf_counter()
    scene = bpy.context.scene
    end = max(scene.frame_start, last)  # particles and zones end there
    with surfaces.as_rendered(scene), compat.temporarily(scene, frame_end=end):
        for _, cache in _caches(scene):
            if cache.use_disk_cache:
                cache.use_disk_cache = False  # also reads a finished cache into memory
            if not cache.is_baked:
                cache.frame_end = max(cache.frame_start + 1, last)
        bpy.ops.ptcache.bake_all(bake=True)
        left = _bake_hair(scene, last) | _bake_zones(zones)
        left |= {thing.name for thing, cache in _caches(scene) if not cache.is_baked}
    if left:
        hint = "baking them in Blender (Scene > Bake All Dynamics) and saving the file"
        raise InputError(
            "simulations that can be baked", path=path, found=names_of(left), hint=hint
        )
    seconds = time.perf_counter() - begun
    return f"simulations ({names_of(names)}): baked up to frame {last} in {seconds:.1f} s"


def _bake_hair(scene: bpy.types.Scene, last: int) -> set[str]:
    """Fill the caches of dynamic hair. Returns names of objects with others.

    Blender does not draw baked hair from a file; hair in a cache that is full but not called baked,
    it does.
    """
    left = set()
    for thing in _evaluated(scene):
        for system in _dynamic_hair(thing):
            cache = system.cloth.point_cache
            if cache.use_disk_cache:
                cache.use_disk_cache = False
            with bpy.context.temp_override(object=thing, point_cache=cache):
                if not cache.is_baked:
                    cache.frame_end = max(cache.frame_start + 1, last)
                    bpy.ops.ptcache.bake(bake=True)
                if not cache.is_baked:
                    left.add(thing.name)
                bpy.ops.ptcache.free_bake()
    return left


def _bake_zones(zones: list[tuple[bpy.types.Object, Any]]) -> set[str]:
    """Bake simulation zones, over the timeline. Returns names of objects with zones not baked."""
    things = [thing for thing, _ in zones]
    for thing, modifier in zones:
        if not hasattr(modifier, "bake_target"):  # before Blender 4.3
            return {thing.name}
        modifier.bake_target = "PACKED"
        for entry in modifier.bakes:
            entry.bake_target = "INHERIT"
    if things:
        with bpy.context.temp_override(selected_objects=things, object=things[0]):
            bpy.ops.object.simulation_nodes_cache_bake(selected=True)
    return set()


def _caches(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, Any]]:
    """(object, point cache) of every simulation that is rendered."""
    world = scene.rigidbody_world
    if world is not None and world.enabled and world.collection is not None:
        bodies = [thing for thing in world.collection.objects if thing.rigid_body]
        for thing in (body for body in bodies if body.rigid_body.type == "ACTIVE"):
            yield thing, world.point_cache
    for thing in _evaluated(scene):
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


def _dynamic_hair(thing: bpy.types.Object) -> list[bpy.types.ParticleSystem]:
    shown = [m for m in thing.modifiers if m.type == "PARTICLE_SYSTEM" and m.show_render]
    hair = [m.particle_system for m in shown if m.particle_system.settings.type == "HAIR"]
    return [system for system in hair if system.use_hair_dynamics and system.cloth is not None]


def _evaluated(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of the scene, and of collections that it instances."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = {block.original for block in depsgraph.ids if isinstance(block, bpy.types.Object)}
    return sorted(found | set(scene.objects), key=lambda thing: thing.name)


def _zones(scene: bpy.types.Scene, packed: set[int]) -> Iterator[tuple[bpy.types.Object, Any]]:
    """(object, modifier) with simulation zones that are not baked."""
    for thing in _evaluated(scene):
        for modifier in thing.modifiers:
            if modifier.type == "NODES" and modifier.show_render:
                nodes = [entry for entry in modifier.bakes if entry.node]
                zones = [entry for entry in nodes if entry.node.bl_idname == _ZONE]
                if not all(_is_kept(modifier, entry, packed) for entry in zones):
                    yield thing, modifier


def _is_kept(modifier: Any, entry: Any, packed: set[int]) -> bool:
    """Whether a zone has a bake, in the file or in a folder."""
    place = f"{modifier.bake_directory}/{entry.bake_id}"
    if entry.use_custom_path:
        place = entry.directory
    return entry.bake_id in packed or Path(bpy.path.abspath(place), "meta").is_dir()


def _packed_zones(path: Path) -> set[int]:
    """Numbers of the bakes of nodes that a .blend contains."""
    if path.suffix.lower() != ".blend":
        return set()
    file = BlendFile(path)
    fields = file.fields.get("NodesModifierBake", {})
    if "*packed" not in fields:
        return set()
    found = set()
    for _, _, data in file.each({"NodesModifierBake"}):
        if file.pointer(data, fields["*packed"].offset):
            at = fields["id"].offset
            found.add(int.from_bytes(data[at : at + 4], "little", signed=True))
    return found
