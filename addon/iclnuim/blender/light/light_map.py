"""BakedLight light: find or bake the light map of the open scene, and show the scene lit by it.

The map contains irradiance, direct and indirect, without surface colour. Direct light is sampled
lamp by lamp. Indirect light is gathered: rays end at the first surface and read the light there
from a map. A coarse map is computed in this way, bounce after bounce, and is used for the last
gathering, into the fine map, together with the sky. So no ray is longer than one bounce, and no ray
has to hit a lamp by chance.

On disk a map is one folder in the cache, which is complete or absent. Notes map scene files to
folders, so that the panel can find a map without opening the scene. The light maps of the built-in
rooms at the default size are shipped in blend/light.
"""

import functools
import hashlib
import itertools
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Depsgraph, Image, Object

from ... import shipped
from ...errors import IclnuimError, InputError
from ...formats.files import read_bytes, read_json, sha256, write_json
from ...job import RenderJob, bake_core_s, shipped_light
from ...lightmap.layout import Layout, lay_out
from ...lightmap.surfaces import BACK, FRONT
from ...version import __version__
from .. import compat, materials, surfaces
from ..surfaces import Part
from . import lit_scene, scene_key
from .light_files import MAP, is_whole, load_layout, load_uv, read_recipe, store
from .lit_scene import LitScene, MapLayout
from .map_points import MapPoints, seen_texels
from .viewpoints import viewpoints

#: Cycles' bounces for a frame with baked light: diffuse light is in the map; two reflections are
#: enough for mirrors and gloss.
BOUNCES = {
    "max_bounces": 8,
    "diffuse_bounces": 0,
    "glossy_bounces": 2,
    "transmission_bounces": 8,
    "transparent_max_bounces": 16,
}
#: Places of cameras that decide what is visible: in a room of 40 m3, one within every 0.85 m.
_VIEWPOINTS = 64
#: The back of a surface gets no texels if less than this share of it is visible, relative to the
#: front: it is seen only through cracks.
_GLIMPSE = 0.02
#: Side and samples of the coarse map. A gathered ray averages over its texels, so that with twice
#: the samples frames are no closer to those of many samples (addon/README.md).
_COARSE_SIZE = 1024
_COARSE_SAMPLES = 8
#: Bounces of diffuse light in the map: each keeps at most the albedo of the walls, so that after
#: eight, even at 0.8, less than 17 % of the first is left, in dark corners.
_MAX_BOUNCES = 8


def prepare(job: RenderJob, report: Callable[[str], None]) -> tuple[Path, bool]:
    """Find the light map of the open scene with the job's size, samples and seed, shipped or in the
    cache, or bake it. Returns its folder, and whether it was baked.

    The scene is not changed. The coarse map is never larger than the map itself.
    """
    if (own := shipped_light(job)) is not None:
        return own, False
    with surfaces.rendered_parts() as (found, depsgraph):
        if not found:
            raise InputError("a scene with surfaces to bake light on", found="none")
        chosen = {
            "size": job.map_size,
            "samples": job.map_samples,
            "coarse_size": min(_COARSE_SIZE, job.map_size),
            "coarse_samples": _COARSE_SAMPLES,
            "seed": job.seed,
        }
        # built-in rooms keep their light
        if not shipped.is_scene(job.scene) and any(map(_glows, found)):
            chosen["glow"] = 1
        versions = {"blender": compat.version_line(), "iclnuim": __version__, "extra": {}}
        parts = scene_key.key_parts(found, bpy.context.scene, shipped.is_scene(job.scene))
        key = {**parts, "settings": chosen, **versions}
        name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:20]
        cache = shipped.cache_folder()
        uv = scene_key.uv_of(found)
        folder = _free_or_fitting(cache / "light" / name, uv)
        if lacking := not is_whole(folder):
            report(_beforehand(job))
            _make(folder, found, depsgraph, chosen, key, report)
    # a note for `find`; it is optional if the cache cannot be written
    with suppress(IclnuimError, OSError):
        (cache / "light/known").mkdir(parents=True, exist_ok=True)
        write_json(_note_file(cache, job), {"map": folder.name})
    return folder, lacking


def _free_or_fitting(folder: Path, uv: np.ndarray) -> Path:
    """The folder, or the first of FOLDER-2, FOLDER-3 ..., that is free or has the map of a scene
    with these texture coordinates.
    """
    places = itertools.chain([folder], (Path(f"{folder}-{k}") for k in itertools.count(2)))
    return next(p for p in places if not is_whole(p) or scene_key.same_uv(load_uv(p), uv))


def _beforehand(job: RenderJob) -> str:
    """A message with the estimated time of the bake: the time of the scene's map with the other
    setting of `lambertian`, or from its texels.
    """
    seconds = bake_core_s(job) / bpy.context.scene.render.threads
    if known := find(shipped.cache_folder(), job.changed(lambertian=not job.lambertian)):
        seconds = read_recipe(known).get("seconds", seconds)
    duration = f"about {max(1, seconds):.0f} s"
    if job.lambertian:
        reason = "without reflections the light differs, so a separate map is baked"
        return f"light map: {reason}, in {duration}"
    return f"light map: the bake takes {duration}"


def apply(folder: Path, limit: float | None = None) -> LitScene:
    """Show the open scene lit by the light map in `folder`, in memory; the result can be reverted.
    limit: as in baked_material.BakedLight.
    """
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        image = bpy.data.images.load(str(folder / MAP), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        if limit is not None and _brightest(image) <= limit:
            limit = None  # then materials are simpler
        lit = lit_scene.show(surfaces.parts(depsgraph), load_layout(folder), image, limit=limit)
    for lamp in bpy.context.scene.objects:
        if lamp.type == "LIGHT" and not lamp.hide_render and _is_all_in_map(lamp):
            lit.hide(lamp, lamp.name)
    return lit


def _brightest(image: Image) -> float:
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return float(pixels.max())


def _is_all_in_map(lamp: Object) -> bool:
    """Whether all light of a lamp is in the map: it is a portal, or not visible in reflections."""
    if lamp.data.type == "AREA" and lamp.data.cycles.is_portal:
        return True
    return not (lamp.visible_glossy or lamp.visible_camera)


def _make(
    folder: Path,
    found: list[Part],
    depsgraph: Depsgraph,
    chosen: dict[str, int],
    key: dict,
    report: Callable[[str], None],
) -> None:
    started = time.perf_counter()
    seed = chosen["seed"]
    whole = surfaces.joined(found)
    places = viewpoints(depsgraph, whole, _VIEWPOINTS, seed)
    shows, translucent, sends = _kinds(found)
    layout = lay_out(whole, np.repeat(sends[:, None], 2, 1), chosen["coarse_size"])
    seen = seen_texels(layout, places, seed)
    wanted, exposure = _seen_sides(layout, seen, shows, translucent)
    coarse = MapPoints(layout, seen > 0, places, chosen["coarse_samples"], seed, translucent)
    first = coarse.direct()
    layout = lay_out(whole, wanted, chosen["size"], exposure, coarse.contrast(first))
    seen = seen_texels(layout, places, seed + 1)
    fine = MapPoints(layout, seen > 0, places, chosen["samples"], seed + 1, translucent)
    with _bounced(found, coarse, first, "glow" in chosen):
        light = fine.map(fine.direct(sky=False) + fine.gathered(sky=True))
    seconds = time.perf_counter() - started
    recipe = {
        "schema_version": 1,
        "key": key,
        "seconds": round(seconds, 1),
        "charts": len(fine.layout.charts.size_m),
        "texels": len(fine.points_m),
        "coverage": round(len(fine.points_m) / chosen["size"] ** 2, 4),
        "texels_per_metre": round(fine.layout.density, 2),
    }
    store(folder, light, _map_layout(found, fine.layout), scene_key.uv_of(found), recipe)
    report(f"light map: {seconds:.0f} s, texels of {1e3 / fine.layout.density:.0f} mm, {folder}")


@contextmanager
def _bounced(found: list[Part], coarse: MapPoints, first: np.ndarray, glow: bool) -> Iterator[None]:
    """The scene lit by the coarse map with all bounces except the last; `first` is the direct
    light of lamps and sky. glow: that of surfaces is added, which is no bounce.
    """
    cycles = bpy.context.scene.cycles
    light = coarse.map(first)
    size = light.shape[1::-1]
    image = bpy.data.images.new("light map", *size, float_buffer=True, is_data=True)
    lit_scene.set_pixels(image, light)
    copies = [replace(part, mesh=part.mesh.copy()) for part in found]
    lit = lit_scene.show(
        copies, _map_layout(found, coarse.layout), image, gathering=True, glow=glow
    )
    try:
        if glow:
            lit_scene.set_pixels(image, np.zeros_like(light))
            lit_scene.set_pixels(image, coarse.map(first + coarse.gathered()))
        for _ in range(min(cycles.max_bounces, cycles.diffuse_bounces, _MAX_BOUNCES) - 1):
            lit_scene.set_pixels(image, coarse.map(first + coarse.gathered()))
        yield
    finally:
        lit.revert()
        bpy.data.images.remove(image)


def _glows(part: Part) -> bool:
    return any(map(materials.emits, part.mesh.materials))


def _map_layout(found: list[Part], layout: Layout) -> MapLayout:
    return MapLayout(*layout.uv(), tuple(len(part.mesh.loops) for part in found))


def _seen_sides(
    layout: Layout, light: np.ndarray, shows: np.ndarray, translucent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F, 2) whether a side needs light, and (F, 2) how much of an image it may fill, from `light`
    (N,) of lamps at cameras' places.

    A side needs light if a camera in free space can see it, and also if it is the other side of
    visible translucent cloth.
    """
    share = layout.per_side(light > 0)
    # the square root reduces the effect of a lamp close to the surface
    exposure = (layout.per_side(np.sqrt(light)) / np.maximum(share, 1e-9)) ** 2
    share[:, BACK] *= share[:, BACK] > _GLIMPSE * share[:, FRONT]
    exposure = np.where(translucent[:, None], exposure.max(1, keepdims=True), exposure)
    share = np.where(translucent[:, None], share.max(1, keepdims=True), share)
    return shows[:, None] & (share > 0), exposure


def _kinds(found: list[Part]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F,) faces that show baked light, (F,) faces that let light through, (F,) faces that reflect
    light to others.
    """
    rows = []
    for part in found:
        table = np.array([materials.kind(m) for m in part.mesh.materials] or [materials.kind(None)])
        rows.append(table[np.maximum(surfaces.material_of_face(part), 0)])
    diffuse, translucent, sends = np.concatenate(rows).T
    return diffuse | translucent, translucent, sends


def find(cache: Path, job: RenderJob) -> Path | None:
    """The folder of the shipped or noted light map for the job's scene, settings and Blender; None
    if there is none.
    """
    try:
        folder = shipped_light(job) or _noted(cache, job)
    except (IclnuimError, OSError, KeyError):
        return None
    return folder if is_whole(folder) else None


def _noted(cache: Path, job: RenderJob) -> Path:
    return cache / "light" / str(read_json(_note_file(cache, job))["map"])


def _note_file(cache: Path, job: RenderJob) -> Path:
    # only the scene's own file: other files it refers to are known only when it is open
    path = shipped.scene_file(job.scene) if shipped.is_scene(job.scene) else Path(job.scene)
    decides = [
        _file_hash(path, path.stat().st_mtime_ns),
        job.reading.to_dict(),
        job.map_size,
        job.map_samples,
        job.seed,
        job.lambertian,
        compat.version_line(),
        __version__,
    ]
    digest = hashlib.sha256(json.dumps(decides).encode()).hexdigest()
    return cache / f"light/known/{digest[:20]}.json"


@functools.lru_cache(maxsize=4)
def _file_hash(path: Path, changed_ns: int) -> str:
    return sha256(read_bytes(path))
