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
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np

from .. import __version__
from ..errors import InputError
from ..lightmap import charts, denoise, filling, packing, texels
from ..lightmap.surfaces import BACK, FRONT, Sides, Surfaces, select
from . import baked_materials, compat, light_map, light_surfaces, light_view, lit_scene, scene_key
from .light_points import irradiance, kept
from .light_surfaces import Part
from .lit_scene import LitScene, MapLayout

Report = Callable[[str], None]
#: A frame by baked light: diffuse light is in the map, two reflections show what mirrors and gloss need.
RENDER_SETTINGS = {"max_bounces": 8, "diffuse_bounces": 0, "glossy_bounces": 2, "transmission_bounces": 8, "transparent_max_bounces": 16}
_VIEWPOINTS = 64


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
    places = light_view.viewpoints(depsgraph, surfaces.corners_m.min(0), surfaces.corners_m.max(0), _VIEWPOINTS, settings.seed)
    report(f"light map: {len(found)} objects, {surfaces.faces} faces, {len(places)} viewpoints")
    wanted = _seen_sides(surfaces, _wanted_sides(found), places, settings)
    corners = tuple(len(part.mesh.loops) for part in found)
    coarse = _Map(surfaces, wanted, settings.coarse_size, corners)
    report(f"coarse pass: {coarse.summary()}, {settings.coarse_samples} samples")
    light = coarse.bake(places, settings.coarse_samples, settings.seed)
    with ExitStack() as stack:
        lit = _show_copy(found, coarse.layout, light)
        stack.callback(lit.revert)
        fine = _Map(surfaces, wanted, settings.size, corners)
        report(f"fine pass: {fine.summary()}, {settings.samples} samples")
        stack.enter_context(kept(bpy.context.scene.cycles, max_bounces=2, diffuse_bounces=1))
        light = fine.bake(places, settings.samples, settings.seed + 1)
    seconds = time.perf_counter() - started
    recipe = {"schema_version": 1, "key": key, "seconds": round(seconds, 1), "charts": len(fine.charts.size_m), "texels": len(fine.texels.index),
              "coverage": round(len(fine.texels.index) / settings.size**2, 4), "texels_per_metre": round(fine.packing.density, 2)}
    light_map.store(folder, light, fine.layout, recipe)
    report(f"light map: {seconds:.0f} s, {folder}")


def _show_copy(found: list[Part], layout: MapLayout, light: np.ndarray) -> LitScene:
    """Show the scene by a map in memory; the parts' own meshes stay free of it."""
    copies = [Part(p.name, p.mesh.copy(), p.matrix, p.source, p.origin, p.single) for p in found]
    return lit_scene.show(copies, layout, lit_scene.image_from_pixels(light))


def _wanted_sides(found: list[Part]) -> np.ndarray:
    """(F, 2): sides of faces that a material shows diffuse light on, or lets light through from."""
    rows = []
    for part in found:
        kinds = [baked_materials.kind(m) for m in part.mesh.materials] or [baked_materials.kind(None)]
        shows = np.array([k.diffuse or k.translucent for k in kinds])
        rows.append(shows[np.maximum(light_surfaces.material_of_face(part), 0)])
    return np.repeat(np.concatenate(rows)[:, None], 2, 1)


def _seen_sides(surfaces: Surfaces, wanted: np.ndarray, places: np.ndarray, settings: BakeSettings) -> np.ndarray:
    """Those sides that a camera in free space may see, chart by chart."""
    sides = select(surfaces, wanted)
    laid = charts.chart(sides.surfaces)
    packed = packing.pack(laid, max(settings.coarse_size, 512))
    where = texels.texels(sides.surfaces, laid.chart, packing.map_coordinates(laid, packed, laid.chart[sides.surfaces.face_of_corner]), packed.size)
    points, normals = where.points(sides.surfaces)
    visible = light_view.seen(points, normals, places, 64, settings.seed)
    chart_seen = np.bincount(where.chart, visible, len(laid.size_m)) > 0
    result = np.zeros_like(wanted)
    result[sides.face, sides.side] = chart_seen[laid.chart]
    return result


class _Map:
    """One map over the wanted sides: its charts, where they lie, and the light in it."""

    def __init__(self, surfaces: Surfaces, wanted: np.ndarray, size: int, part_corners: tuple[int, ...]) -> None:
        self.sides: Sides = select(surfaces, wanted)
        self.charts = charts.chart(self.sides.surfaces)
        self.packing = packing.pack(self.charts, size)
        corners = packing.map_coordinates(self.charts, self.packing, self.charts.chart[self.sides.surfaces.face_of_corner])
        self.texels = texels.texels(self.sides.surfaces, self.charts.chart, corners, size)
        uv, has = np.zeros((2, len(surfaces.corners_m), 2)), np.zeros((2, len(surfaces.corners_m)), bool)
        side = np.repeat(self.sides.side, np.diff(self.sides.surfaces.face_start))
        for which in (FRONT, BACK):
            rows = side == which
            uv[which, self.sides.corner[rows]] = corners[rows] / size
            has[which, self.sides.corner[rows]] = True
        self.layout = MapLayout(uv, has, part_corners)

    def summary(self) -> str:
        count = len(self.texels.index)
        return f"{len(self.charts.size_m)} charts, {count} texels ({count / self.texels.size**2:.0%} of {self.texels.size} x {self.texels.size}), {1000 / self.packing.density:.1f} mm"

    def bake(self, places: np.ndarray, samples: int, seed: int) -> np.ndarray:
        """(size, size, 3): light at every texel, hidden texels and gutters filled, noise taken out."""
        points, normals = self.texels.points(self.sides.surfaces)
        visible = light_view.seen(points, normals, places, 32, seed)
        halves = [irradiance(points, normals, max(1, samples // 2), 2 * seed + k) for k in (0, 1)]
        chart = self.texels.image(self.texels.chart, -1)
        known, facing = self.texels.image(visible, False), self.texels.image(normals.astype(np.float32))
        light = denoise.denoise(*[self.texels.image(h) for h in halves], chart, facing, known)
        filled, reached = filling.fill(light, known, chart, 2)
        light = np.where(reached[..., None], filled, light)
        return filling.fill(light, chart >= 0, chart, 2)[0].astype(np.float32)
