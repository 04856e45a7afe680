"""Somebody's own scene file, opened so that it can be rendered: in metres, z up, mended, lit. The file itself is never written."""

from __future__ import annotations

import math
from pathlib import Path

import bpy

from ..errors import InputError
from ..geometry.scene_axes import SceneReading
from ..job import RenderJob
from . import displacing, import_files, mending, moving, neutral_light, placing, scene_paths, surface

_SURFACES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
#: A light map has about as many texels; more triangles than that gain nothing from it, and laying them out takes minutes.
MOST_BAKED = 2_000_000


def open_file(path: Path, reading: SceneReading) -> list[str]:
    """Into the empty session; returns notes worth telling, first how it was taken. Raises InputError for what cannot be used."""
    scene_paths.refuse_outside(path, reading.textures)
    import_files.load(path)
    scene_paths.refuse_open_outside(path, reading.textures)
    scene = bpy.context.scene
    if path.suffix.lower() != ".blend":
        scene.view_settings.view_transform = "Standard"  # Blender's default for new files, not the file's wish
        _timeline_of_actions(scene)
    notes = mending.mend(scene)
    if not any(o.type in _SURFACES for o in scene.objects) and not _instances(scene):
        raise InputError("a scene with at least one surface", path=path, found="none")
    placed = placing.place(path, reading, list(scene.objects))
    notes = [*([placed.sentence] if placed.worth_telling else []), *notes]
    bpy.context.view_layer.update()
    notes += displacing.put_into_meshes(scene)
    _choose_camera(scene)
    return [*notes, *neutral_light.add_where_there_is_none(scene)]


def lit_as_it_can_be(job: RenderJob) -> tuple[RenderJob, list[str]]:
    """The job with the light that the open scene allows, and a word where that is not the light asked for."""
    if job.light != "baked":
        return job, []
    hindrance = why_not_baked(bpy.context.scene)
    if hindrance is None:
        return job, []
    return job.changed(light="path"), [f"{hindrance}: path traced instead of baked light"]


def why_not_baked(scene: bpy.types.Scene) -> str | None:
    """What stands against a light map, or None."""
    moves = moving.names(scene)
    if moves:
        return f"objects or lights that move ({', '.join(moves)[:120]})"
    count = surface.triangle_count()
    return f"{count} triangles, more than the texels of a light map" if count > MOST_BAKED else None


def _instances(scene: bpy.types.Scene) -> bool:
    return any(o.instance_collection is not None for o in scene.objects)


def _timeline_of_actions(scene: bpy.types.Scene) -> None:
    """Readers leave the timeline as it was: as long as what moves."""
    ranges = [tuple(action.frame_range) for action in bpy.data.actions]
    if ranges:
        scene.frame_start = max(0, math.floor(min(first for first, _ in ranges)))
        scene.frame_end = max(scene.frame_start, math.ceil(max(last for _, last in ranges)))


def _choose_camera(scene: bpy.types.Scene) -> None:
    """Formats without an active camera: their only one is."""
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if scene.camera is None and len(cameras) == 1:
        scene.camera = cameras[0]
