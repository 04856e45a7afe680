"""Light baked once: find or make the light map of the open scene, and show the scene by it.

The map holds irradiance, direct and indirect, without surface colour. It is made in two passes: a coarse one by path tracing, then
a fine one whose rays end at the first surface and read the light there from the coarse map (final gathering). So a ray of
the fine pass costs one bounce, and brings little noise.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from .. import __version__
from ..errors import InputError
from ..lightmap import denoise, filling
from ..lightmap.layout import Layout, lay_out
from ..lightmap.surfaces import BACK, FRONT, Surfaces
from . import baked_materials, compat, light_map, light_surfaces, light_view, lit_scene, scene_key
from .light_points import irradiance, kept
from .light_surfaces import Part
from .lit_scene import LitScene, MapLayout

Report = Callable[[str], None]
#: A frame by baked light: diffuse light is in the map, two reflections show what mirrors and gloss need.
RENDER_SETTINGS = {"max_bounces": 8, "diffuse_bounces": 0, "glossy_bounces": 2, "transmission_bounces": 8, "transparent_max_bounces": 16}
_VIEWPOINTS = 64
#: The back of a surface needs no light when this little of it is seen, compared with the front: cracks between walls.
_GLIMPSE = 0.02


@dataclass(frozen=True)
class BakeSettings:
    """size: of the square map, in texels; samples: a texel; coarse_size and coarse_samples: of the first pass; seed."""

    size: int = 2048
    samples: int = 64
    coarse_size: int = 512
    coarse_samples: int = 256
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            least = 0 if name == "seed" else 16 if name.endswith("size") else 2
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InputError(f"{name} as a whole number from {least} up", found=value)


def prepare(scene_key_extra: dict, settings: BakeSettings, cache: Path, report: Report = lambda text: None) -> Path:
    """The folder in `cache` with the light map of the open scene, found or made. Leaves the scene as it was."""
    scene = bpy.context.scene
    with light_surfaces.as_rendered(scene) as depsgraph:
        found = light_surfaces.parts(depsgraph)
        if not found:
            raise InputError("a scene with surfaces to bake light on", found="none")
        try:
            parts = scene_key.key_parts(found, scene)
            whole = {**parts, "settings": asdict(settings), "blender": compat.version_line(), "iclnuim": __version__, "extra": scene_key_extra}
            name = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:20]
            folder = cache / "light" / name
            if not light_map.is_whole(folder):
                _make(folder, found, depsgraph, settings, whole, report)
        finally:
            for part in found:
                bpy.data.meshes.remove(part.mesh)
    return folder


def apply(folder: Path) -> LitScene:
    """Show the open scene by the light map in `folder`, in memory; the result can be reverted."""
    scene = bpy.context.scene
    with light_surfaces.as_rendered(scene) as depsgraph:
        found = light_surfaces.parts(depsgraph)
        return lit_scene.show(found, light_map.load_layout(folder), light_map.load_image(folder))


def apply_render_settings(scene: bpy.types.Scene) -> None:
    """Bounces for frames by baked light."""
    for name, value in RENDER_SETTINGS.items():
        setattr(scene.cycles, name, value)


def _make(folder: Path, found: list[Part], depsgraph: bpy.types.Depsgraph, settings: BakeSettings, key: dict, report: Report) -> None:
    started = time.perf_counter()
    surfaces = light_surfaces.surfaces(found)
    places = light_view.viewpoints(depsgraph, surfaces, _VIEWPOINTS, settings.seed)
    report(f"light map: {len(found)} objects, {surfaces.faces} faces, {len(places)} viewpoints")
    wanted, exposure = _seen_sides(surfaces, found, places, settings)
    coarse = lay_out(surfaces, wanted, settings.coarse_size, exposure)
    report(f"coarse pass: {coarse.summary()}, {settings.coarse_samples} samples")
    light = _bake(coarse, places, settings.coarse_samples, settings.seed)
    with ExitStack() as stack:
        stack.callback(_show_copy(found, coarse, light).revert)
        fine = lay_out(surfaces, wanted, settings.size, exposure)
        report(f"fine pass: {fine.summary()}, {settings.samples} samples")
        stack.enter_context(kept(bpy.context.scene.cycles, max_bounces=2, diffuse_bounces=1))
        light = _bake(fine, places, settings.samples, settings.seed + 1)
    seconds = time.perf_counter() - started
    recipe = {"schema_version": 1, "key": key, "seconds": round(seconds, 1), "charts": len(fine.charts.size_m), "texels": len(fine.texels.index),
              "coverage": round(len(fine.texels.index) / settings.size**2, 4), "texels_per_metre": round(fine.packing.density, 2)}
    light_map.store(folder, light, _map_layout(found, fine), recipe)
    report(f"light map: {seconds:.0f} s, {folder}")


def _map_layout(found: list[Part], layout: Layout) -> MapLayout:
    return MapLayout(*layout.uv(), tuple(len(part.mesh.loops) for part in found))


def _show_copy(found: list[Part], layout: Layout, light: np.ndarray) -> LitScene:
    """Show the scene by a map in memory; the parts' own meshes stay free of it."""
    copies = [replace(part, mesh=part.mesh.copy()) for part in found]
    return lit_scene.show(copies, _map_layout(found, layout), lit_scene.image_from_pixels(light))


def _seen_sides(surfaces: Surfaces, found: list[Part], places: np.ndarray, settings: BakeSettings) -> tuple[np.ndarray, np.ndarray]:
    """(F, 2) sides that need light, and (F, 2) how much of an image each may fill.

    A side needs light when a camera in free space may see it; the far side of cloth that light passes through, too.
    """
    diffuse, translucent = _kinds(found)
    both = np.repeat((diffuse | translucent)[:, None], 2, 1)
    layout = lay_out(surfaces, both, settings.coarse_size)
    light = light_view.seen(*layout.points(), places, 64, settings.seed)
    exposure, share = layout.per_side(np.sqrt(light)) ** 2, layout.per_side(light > 0)  # the root: a lamp close by counts less
    share[:, BACK] *= share[:, BACK] > _GLIMPSE * share[:, FRONT]
    exposure = np.where(translucent[:, None], exposure.max(1, keepdims=True), exposure)
    share = np.where(translucent[:, None], share.max(1, keepdims=True), share)
    return both & (share > 0), exposure


def _kinds(found: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """(F,) faces that show diffuse light, (F,) faces that let light through."""
    rows = []
    for part in found:
        kinds = [baked_materials.kind(m) for m in part.mesh.materials] or [baked_materials.kind(None)]
        table = np.array([(k.diffuse, k.translucent) for k in kinds])
        rows.append(table[np.maximum(light_surfaces.material_of_face(part), 0)])
    diffuse, translucent = np.concatenate(rows).T
    return diffuse, translucent


def _bake(layout: Layout, places: np.ndarray, samples: int, seed: int) -> np.ndarray:
    """(size, size, 3): light at every texel, noise taken out, hidden texels and gutters filled."""
    points, normals = layout.points()
    image = layout.texels.image
    known = image(light_view.seen(points, normals, places, 32, seed) > 0, False)
    halves = [irradiance(points, normals, max(1, samples // 2), 2 * seed + k) for k in (0, 1)]
    chart = image(layout.texels.chart, -1)
    light = denoise.denoise(*[image(h) for h in halves], chart, image(normals.astype(np.float32)), known)
    filled, reached = filling.fill(light, known, chart, 2)
    light = np.where(reached[..., None], filled, light)
    return filling.fill(light, chart >= 0, chart, 2)[0].astype(np.float32)
