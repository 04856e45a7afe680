"""Light baked once: find or make the light map of the open scene, and show the scene by it.

The map holds irradiance, direct and indirect, without surface colour. Direct light is sampled lamp by lamp. Indirect light comes
by gathering: rays that end at the first surface and read the light there from a map. A coarse map is made so, bounce after bounce,
and lights the last gathering, for the fine map. So no ray is longer than one bounce, and none of them finds its lamp by chance.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from .. import __version__
from ..errors import InputError
from ..lightmap.denoise import beside_known, contrast, denoise, fill
from ..lightmap.layout import Layout, lay_out
from ..lightmap.surfaces import BACK, FRONT
from . import baked_materials, compat, light_map, light_sampling, lit_scene, scene_key, surfaces
from .light_sampling import Halves
from .lit_scene import LitScene, MapLayout
from .surfaces import Part

Report = Callable[[str], None]
#: A frame by baked light: diffuse light is in the map, two reflections show what mirrors and gloss need.
RENDER_SETTINGS = {
    "max_bounces": 8,
    "diffuse_bounces": 0,
    "glossy_bounces": 2,
    "transmission_bounces": 8,
    "transparent_max_bounces": 16,
}
_VIEWPOINTS = 64
#: The back of a surface needs no light when this little of it is seen, compared with the front: cracks between walls.
_GLIMPSE = 0.02
_MAX_BOUNCES = 8
_STEPS_INTO_VIEW = (0.2, 0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class BakeSettings:
    """size: of the square map, in texels; samples: a texel and source of light.

    coarse_size, coarse_samples: of the map in between, which is never larger than the map itself.
    """

    size: int = 2048
    samples: int = 32
    coarse_size: int = 1024
    coarse_samples: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            least = 0 if name == "seed" else 16 if name.endswith("size") else 2
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InputError(f"{name} as a whole number from {least} up", found=value)
        object.__setattr__(self, "coarse_size", min(self.coarse_size, self.size))


def prepare(settings: BakeSettings, cache: Path, report: Report = lambda text: None) -> Path:
    """The folder in `cache` with the light map of the open scene, found or made. Leaves the scene as it was."""
    scene = bpy.context.scene
    with surfaces.as_rendered(scene) as depsgraph:
        found = surfaces.parts(depsgraph)
        if not found:
            raise InputError("a scene with surfaces to bake light on", found="none")
        try:
            parts = scene_key.key_parts(found, scene)
            whole = {
                **parts,
                "settings": asdict(settings),
                "blender": compat.version_line(),
                "iclnuim": __version__,
                "extra": {},
            }
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
    with surfaces.as_rendered(scene) as depsgraph:
        found = surfaces.parts(depsgraph)
        lit = lit_scene.show(found, light_map.load_layout(folder), light_map.load_image(folder))
    lit_scene.disable_lamps(lit)
    return lit


def apply_render_settings(scene: bpy.types.Scene) -> None:
    """For frames by baked light: bounces; and reflections find the sky by themselves, at less cost than by aiming at it."""
    for name, value in RENDER_SETTINGS.items():
        setattr(scene.cycles, name, value)
    if scene.world is not None:
        scene.world.cycles.sampling_method = "NONE"


def _make(
    folder: Path, found: list[Part], depsgraph: bpy.types.Depsgraph, settings: BakeSettings, key: dict, report: Report
) -> None:
    started = time.perf_counter()
    whole = surfaces.joined(found)
    places = light_sampling.viewpoints(depsgraph, whole, _VIEWPOINTS, settings.seed)
    report(f"light map: {len(found)} objects, {whole.faces} faces, {len(places)} viewpoints")
    shows, translucent, sends = _kinds(found)
    layout = lay_out(whole, np.repeat(sends[:, None], 2, 1), settings.coarse_size)
    seen = light_sampling.seen(*layout.points(), places, settings.seed)
    wanted, exposure = _seen_sides(layout, seen, shows, translucent)
    coarse = _Points(layout, seen > 0, places, settings.coarse_samples, settings.seed, translucent)
    report(f"coarse map: {coarse.layout.summary()}")
    first = coarse.direct()
    layout = lay_out(whole, wanted, settings.size, exposure, coarse.contrast(first))
    seen = light_sampling.seen(*layout.points(), places, settings.seed + 1)
    fine = _Points(layout, seen > 0, places, settings.samples, settings.seed + 1, translucent)
    with _bounced(found, coarse, first):
        report(f"fine map: {fine.layout.summary()}")
        light = fine.map(fine.direct() + fine.gathered())
    seconds = time.perf_counter() - started
    recipe = {
        "schema_version": 1,
        "key": key,
        "seconds": round(seconds, 1),
        "charts": len(fine.layout.charts.size_m),
        "texels": len(fine.points_m),
        "coverage": round(len(fine.points_m) / settings.size**2, 4),
        "texels_per_metre": round(fine.layout.packing.density, 2),
    }
    light_map.store(folder, light, _map_layout(found, fine.layout), recipe)
    report(f"light map: {seconds:.0f} s, {folder}")


@contextmanager
def _bounced(found: list[Part], coarse: "_Points", first: Halves) -> Iterator[None]:
    """The scene lit by the coarse map with all bounces but the last; `first` is the light that comes straight."""
    cycles = bpy.context.scene.cycles
    image = lit_scene.image_from_pixels(coarse.map(first))
    copies = [replace(part, mesh=part.mesh.copy()) for part in found]
    lit = lit_scene.show(copies, _map_layout(found, coarse.layout), image, gathering=True)
    try:
        for _ in range(min(cycles.max_bounces, cycles.diffuse_bounces, _MAX_BOUNCES) - 1):
            lit_scene.set_pixels(image, coarse.map(first + coarse.gathered()))
        yield
    finally:
        lit.revert()
        bpy.data.images.remove(image)


def _map_layout(found: list[Part], layout: Layout) -> MapLayout:
    return MapLayout(*layout.uv(), tuple(len(part.mesh.loops) for part in found))


def _seen_sides(
    layout: Layout, light: np.ndarray, shows: np.ndarray, translucent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F, 2) sides that need light, and (F, 2) how much of an image each may fill, by `light` (N,) from cameras' places.

    A side needs light when a camera in free space may see it; the far side of cloth that light passes through, too.
    """
    share = layout.per_side(light > 0)
    exposure = (
        layout.per_side(np.sqrt(light)) / np.maximum(share, 1e-9)
    ) ** 2  # by the root, a lamp close by counts less
    share[:, BACK] *= share[:, BACK] > _GLIMPSE * share[:, FRONT]
    exposure = np.where(translucent[:, None], exposure.max(1, keepdims=True), exposure)
    share = np.where(translucent[:, None], share.max(1, keepdims=True), share)
    return shows[:, None] & (share > 0), exposure


def _kinds(found: list[Part]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F,) faces that show baked light, (F,) faces that let light through, (F,) faces that send light to others."""
    rows = []
    for part in found:
        kinds = [baked_materials.kind(m) for m in part.mesh.materials] or [baked_materials.kind(None)]
        table = np.array([(k.diffuse, k.translucent, k.sends) for k in kinds])
        rows.append(table[np.maximum(surfaces.material_of_face(part), 0)])
    diffuse, translucent, sends = np.concatenate(rows).T
    return diffuse | translucent, translucent, sends


class _Points:
    """The texels of one map: their points, which of them can be seen, and light on them."""

    def __init__(
        self, layout: Layout, seen: np.ndarray, places: np.ndarray, samples: int, seed: int, translucent: np.ndarray
    ) -> None:
        self.layout, self.samples, self.seed = layout, samples, seed
        self.points_m, self.normals = layout.points()
        image = layout.texels.image
        self.chart, self.facing = image(layout.texels.chart, -1), image(self.normals.astype(np.float32))
        self.visible = image(self._shown(seen, places, translucent[layout.face_of_texel]), False)
        self._into_view(places)

    def _shown(self, seen: np.ndarray, places: np.ndarray, translucent: np.ndarray) -> np.ndarray:
        """(N,) texels that show: those `seen`, and those whose light shines through to a side in view."""
        seen = seen.copy()
        rows = np.flatnonzero(translucent & ~seen)
        seen[rows] = light_sampling.seen(self.points_m[rows], -self.normals[rows], places, self.seed) > 0
        return seen

    def _into_view(self, places: np.ndarray) -> None:
        """Hidden texels beside a seen one take the light of the last point that is seen on the way to it.

        So light right up to a contact is the contact's own, not that of a texel farther on.
        """
        hidden, near = beside_known(self.visible, self.chart)
        hidden_row, near_row = (np.searchsorted(self.layout.texels.index, k) for k in (hidden, near))
        share = np.array(_STEPS_INTO_VIEW)[:, None, None]
        points, normals = ((1 - share) * v[hidden_row] + share * v[near_row] for v in (self.points_m, self.normals))
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        seen = (
            light_sampling.seen(points.reshape(-1, 3), normals.reshape(-1, 3), places, self.seed).reshape(
                points.shape[:2]
            )
            > 0
        )
        seen[-1] = True  # the seen texel itself
        first = seen.argmax(0), np.arange(len(hidden))
        self.points_m[hidden_row], self.normals[hidden_row] = points[first], normals[first]
        self.visible.ravel()[hidden] = True

    def direct(self) -> Halves:
        return light_sampling.direct(self.points_m, self.normals, self.samples, self.seed, list(bpy.data.materials))

    def gathered(self) -> Halves:
        return light_sampling.gathered(self.points_m, self.normals, self.samples, self.seed)

    def contrast(self, light: Halves) -> np.ndarray:
        """(F, 2) how much light changes on each side from texel to texel."""
        steps = contrast(*self._images(light), self.chart)
        return self.layout.per_side(steps.ravel()[self.layout.texels.index])

    def _images(self, light: Halves) -> tuple[np.ndarray, np.ndarray]:
        return self.layout.texels.image(light.a), self.layout.texels.image(light.b)

    def map(self, light: Halves) -> np.ndarray:
        """(size, size, 3): noise taken out, hidden texels next to seen ones and gutters filled."""
        smooth = denoise(*self._images(light), self.chart, self.facing, self.visible)
        filled, reached = fill(smooth, self.visible, self.chart, 2)
        smooth = np.where(reached[..., None], filled, smooth)
        return fill(smooth, self.chart >= 0, self.chart, 2)[0].astype(np.float32)
