"""Light baked once: find or make the light map of the open scene, and show the scene by it.

The map holds irradiance, direct and indirect, without surface colour. Direct light is sampled lamp by lamp. Indirect light comes
by gathering: rays that end at the first surface and read the light there from a map. A coarse map is made so, bounce after bounce,
and lights the last gathering, for the fine map. So no ray is longer than one bounce, and none of them finds its lamp by chance.

On disk a map is one folder in the cache, whole or not there at all; notes say which one belongs to which scene file, so that a window
can tell without opening the scene. The light of the built-in rooms at the default size travels with them, in blend/light.
"""

import functools
import hashlib
import json
import shutil
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from .. import __version__
from ..errors import IclnuimError, InputError, WorkError
from ..formats.exr import write_exr
from ..formats.files import read_bytes, read_json, sha256, write_json
from ..job import LIGHT_FILES, RenderJob, bake_core_s, shipped_light
from ..lightmap.denoise import beside_known, contrast, denoise, fill
from ..lightmap.layout import Layout, lay_out
from ..lightmap.surfaces import BACK, FRONT
from ..shipped import cache_folder as cache_folder
from . import compat, light_sampling, lit_scene, scene, scene_key, surfaces
from .lit_scene import LitScene, MapLayout
from .surfaces import Part

MAP, LAYOUT, RECIPE = LIGHT_FILES
#: Cycles for a frame by baked light: diffuse light is in the map, two reflections show what mirrors and gloss need.
BOUNCES = {
    "max_bounces": 8, "diffuse_bounces": 0, "glossy_bounces": 2, "transmission_bounces": 8, "transparent_max_bounces": 16,
}  # fmt: skip
_VIEWPOINTS = 64
#: The back of a surface needs no light when this little of it is seen, compared with the front: cracks between walls.
_GLIMPSE = 0.02
#: Side and samples of the map in between.
_COARSE_SIZE, _COARSE_SAMPLES = 1024, 16
_MAX_BOUNCES = 8
_STEPS_INTO_VIEW = (0.2, 0.4, 0.6, 0.8, 1.0)


def prepare(job: RenderJob, report: Callable[[str], None]) -> tuple[Path, bool]:
    """The folder with the light map of the open scene, of the job's size, samples and seed, shipped or in the cache, and whether it had to be made.

    Leaves the scene as it was. The coarse map in between is never larger than the map itself.
    """
    if (own := shipped_light(job)) is not None:
        return own, False
    with surfaces.rendered_parts() as (found, depsgraph):
        if not found:
            raise InputError("a scene with surfaces to bake light on", found="none")
        asked = {
            "size": job.map_size,
            "samples": job.map_samples,
            "coarse_size": min(_COARSE_SIZE, job.map_size),
            "coarse_samples": _COARSE_SAMPLES,
            "seed": job.seed,
        }
        versions = {"blender": compat.version_line(), "iclnuim": __version__, "extra": {}}
        key = {**scene_key.key_parts(found, bpy.context.scene), "settings": asked, **versions}
        name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:20]
        cache = cache_folder()
        folder = cache / "light" / name
        if lacking := not is_whole(folder):
            report(_beforehand(job))
            _make(folder, found, depsgraph, asked, key, report)
    with suppress(IclnuimError, OSError):  # a note for `find`; a cache that cannot be written stays without it
        (cache / "light/known").mkdir(parents=True, exist_ok=True)
        write_json(_note_file(cache, job), {"map": folder.name})
    return folder, lacking


def _beforehand(job: RenderJob) -> str:
    """What is baked now and about how long: as a map of the scene with the other choice of reflections took, or by its texels."""
    known = find(cache_folder(), job.changed(lambertian=not job.lambertian))
    estimate = bake_core_s(job) / bpy.context.scene.render.threads
    seconds = read_recipe(known[0]).get("seconds", estimate) if known else estimate
    if job.lambertian:
        return f"light map: without reflections light is another, so a map of its own is baked, in about {max(1, seconds):.0f} s"
    return f"light map: baked in about {max(1, seconds):.0f} s"


def apply(folder: Path, limit: float | None = None) -> LitScene:
    """Show the open scene by the light map in `folder`, in memory; the result can be reverted. limit: as of lit_scene.baked_copy."""
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        image = bpy.data.images.load(str(folder / MAP), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        if limit is not None:  # materials are as simple as the light allows
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            limit = limit if pixels.max() > limit else None
        lit = lit_scene.show(surfaces.parts(depsgraph), load_layout(folder), image, limit=limit)
    for lamp in bpy.context.scene.objects:  # those that reflections do not show have given all their light to the map
        portal = lamp.type == "LIGHT" and lamp.data.type == "AREA" and lamp.data.cycles.is_portal
        if (
            lamp.type == "LIGHT"
            and not lamp.hide_render
            and (portal or not (lamp.visible_glossy or lamp.visible_camera))
        ):
            lit.hidden.append((lamp, lamp.name, False))
            lamp.hide_render = True
    return lit


def _make(
    folder: Path,
    found: list[Part],
    depsgraph: bpy.types.Depsgraph,
    asked: dict[str, int],
    key: dict,
    report: Callable[[str], None],
) -> None:
    started, seed = time.perf_counter(), asked["seed"]
    whole = surfaces.joined(found)
    places = light_sampling.viewpoints(depsgraph, whole, _VIEWPOINTS, seed)
    report(f"light map: {len(found)} objects, {whole.faces} faces, {len(places)} viewpoints")
    shows, translucent, sends = _kinds(found)
    layout = lay_out(whole, np.repeat(sends[:, None], 2, 1), asked["coarse_size"])
    seen = light_sampling.seen(*layout.points(), places, seed)
    wanted, exposure = _seen_sides(layout, seen, shows, translucent)
    coarse = _Points(layout, seen > 0, places, asked["coarse_samples"], seed, translucent)
    report(f"coarse map: {coarse.layout.summary()}")
    first = coarse.direct()
    layout = lay_out(whole, wanted, asked["size"], exposure, coarse.contrast(first))
    seen = light_sampling.seen(*layout.points(), places, seed + 1)
    fine = _Points(layout, seen > 0, places, asked["samples"], seed + 1, translucent)
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
        "coverage": round(len(fine.points_m) / asked["size"] ** 2, 4),
        "texels_per_metre": round(fine.layout.density, 2),
    }
    store(folder, light, _map_layout(found, fine.layout), recipe)
    report(f"light map: {seconds:.0f} s, {folder}")


@contextmanager
def _bounced(found: list[Part], coarse: "_Points", first: np.ndarray) -> Iterator[None]:
    """The scene lit by the coarse map with all bounces but the last; `first` is the light that comes straight."""
    cycles = bpy.context.scene.cycles
    light = coarse.map(first)
    image = bpy.data.images.new("light map", light.shape[1], light.shape[0], float_buffer=True, is_data=True)
    lit_scene.set_pixels(image, light)
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
    # by the root, a lamp close by counts less
    exposure = (layout.per_side(np.sqrt(light)) / np.maximum(share, 1e-9)) ** 2
    share[:, BACK] *= share[:, BACK] > _GLIMPSE * share[:, FRONT]
    exposure = np.where(translucent[:, None], exposure.max(1, keepdims=True), exposure)
    share = np.where(translucent[:, None], share.max(1, keepdims=True), share)
    return shows[:, None] & (share > 0), exposure


def _kinds(found: list[Part]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F,) faces that show baked light, (F,) faces that let light through, (F,) faces that send light to others."""
    rows = []
    for part in found:
        table = np.array([lit_scene.kind(m) for m in part.mesh.materials] or [lit_scene.kind(None)])
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
        # what is seen, and what lets its light shine through to a side in view
        seen, rows = seen.copy(), np.flatnonzero(translucent[layout.face_of_texel] & ~seen)
        seen[rows] = light_sampling.seen(self.points_m[rows], -self.normals[rows], places, seed) > 0
        self.visible = image(seen, False)
        self._into_view(places)

    def _into_view(self, places: np.ndarray) -> None:
        """Hidden texels beside a seen one take the light of the last point that is seen on the way to it.

        So light right up to a contact is the contact's own, not that of a texel farther on.
        """
        hidden, near = beside_known(self.visible, self.chart)
        hidden_row, near_row = (np.searchsorted(self.layout.texels.index, k) for k in (hidden, near))
        share = np.array(_STEPS_INTO_VIEW)[:, None, None]
        points, normals = ((1 - share) * v[hidden_row] + share * v[near_row] for v in (self.points_m, self.normals))
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        seen = light_sampling.seen(points.reshape(-1, 3), normals.reshape(-1, 3), places, self.seed) > 0
        seen = seen.reshape(points.shape[:2])
        seen[-1] = True  # the seen texel itself
        first = seen.argmax(0), np.arange(len(hidden))
        self.points_m[hidden_row], self.normals[hidden_row] = points[first], normals[first]
        self.visible.ravel()[hidden] = True

    def direct(self) -> np.ndarray:
        """(2, N, 3), as light_sampling has it."""
        return light_sampling.direct(self.points_m, self.normals, self.samples, self.seed, list(bpy.data.materials))

    def gathered(self) -> np.ndarray:
        return light_sampling.gathered(self.points_m, self.normals, self.samples, self.seed)

    def contrast(self, light: np.ndarray) -> np.ndarray:
        """(F, 2) how much light changes on each side from texel to texel."""
        image = self.layout.texels.image
        steps = contrast(image(light[0]), image(light[1]), self.chart)
        return self.layout.per_side(steps.ravel()[self.layout.texels.index])

    def map(self, light: np.ndarray) -> np.ndarray:
        """(size, size, 3): noise taken out, hidden texels next to seen ones and gutters filled."""
        image = self.layout.texels.image
        smooth = denoise(image(light[0]), image(light[1]), self.chart, self.facing, self.visible)
        filled, reached = fill(smooth, self.visible, self.chart, 2)
        smooth = np.where(reached[..., None], filled, smooth)
        return fill(smooth, self.chart >= 0, self.chart, 2)[0].astype(np.float32)


def is_whole(folder: Path) -> bool:
    """Whether a finished light map lies there. The recipe is written last."""
    return all((folder / name).is_file() for name in LIGHT_FILES)


def store(folder: Path, light: np.ndarray, layout: MapLayout, recipe: dict) -> None:
    """Write a map (rows, columns, 3), row 0 at the bottom, beside the cache and rename: two processes cannot spoil each other.

    Light beyond what half floats hold, as close to a lamp of radius 0, is cut. Raises WorkError for light that is not a number.
    """
    if np.isnan(light).any():
        problem = "the light map has values that are not numbers and is not stored"
        raise WorkError(problem, hint="path tracing: {light} path")
    light = np.minimum(light, np.finfo(np.float16).max)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        write_exr(temporary / MAP, {name: light[::-1, :, k].astype(np.float16) for k, name in enumerate("RGB")})
        stored = {"uv": layout.uv.astype(np.float32), "has": layout.has, "part_corners": np.array(layout.part_corners)}
        np.savez_compressed(temporary / LAYOUT, **stored)
        write_json(temporary / RECIPE, recipe)
        temporary.chmod(0o755)
        try:
            temporary.rename(folder)
        except OSError:
            if not is_whole(folder):  # else another process was first; equal keys make equal maps
                shutil.rmtree(folder, ignore_errors=True)
                temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def load_layout(folder: Path) -> MapLayout:
    """Raises WorkError where the file is damaged."""
    try:
        with np.load(folder / LAYOUT) as stored:
            return MapLayout(stored["uv"], stored["has"], tuple(int(n) for n in stored["part_corners"]))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        problem = f"the light map cannot be read ({error}); delete this folder and bake again"
        raise WorkError(f"{folder}: {problem}") from None


def read_recipe(folder: Path) -> dict:
    """What the map was made from."""
    return read_json(folder / RECIPE)


def find(cache: Path, job: RenderJob) -> tuple[Path, int, float] | None:
    """(folder, size in bytes, age in seconds) of the map shipped or noted for the job's scene, settings and Blender; None where none is."""
    try:
        folder = shipped_light(job) or cache / "light" / str(read_json(_note_file(cache, job))["map"])
        if not is_whole(folder):
            return None
        files = [path.stat() for path in folder.iterdir()]
    except (IclnuimError, OSError, KeyError):
        return None
    return folder, sum(f.st_size for f in files), time.time() - max(f.st_mtime for f in files)


def _note_file(cache: Path, job: RenderJob) -> Path:
    light = [job.map_size, job.map_samples, job.seed, job.lambertian]
    # the scene's own file alone: what lies beside it is known only once it is open
    path = scene.shipped_file(job.scene) if scene.is_shipped(job.scene) else Path(job.scene)
    decides = [
        _file_hash(path, path.stat().st_mtime_ns),
        job.reading.to_dict(),
        *light,
        compat.version_line(),
        __version__,
    ]
    return cache / "light/known" / f"{hashlib.sha256(json.dumps(decides).encode()).hexdigest()[:20]}.json"


@functools.lru_cache(maxsize=4)
def _file_hash(path: Path, changed_ns: int) -> str:
    return sha256(read_bytes(path))
