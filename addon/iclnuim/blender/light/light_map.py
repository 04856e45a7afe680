"""Baked light: find or bake the light map of the open scene, and show the scene lit by it.

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

from ... import shipped
from ...errors import IclnuimError, InputError, WorkError
from ...formats.exr import write_exr
from ...formats.files import read_bytes, read_json, sha256, write_json
from ...job import LIGHT_FILES, RenderJob, bake_core_s, shipped_light
from ...lightmap.denoise import contrast, denoise, fill, grown, next_to_known
from ...lightmap.layout import Layout, lay_out
from ...lightmap.surfaces import BACK, FRONT
from ...version import __version__
from .. import compat, materials, surfaces
from ..surfaces import Part
from . import light_sampling, lit_scene, scene_key
from .lit_scene import LitScene, MapLayout

MAP, LAYOUT, RECIPE = LIGHT_FILES
#: Cycles' bounces for a frame with baked light: diffuse light is in the map; two reflections are
#: enough for mirrors and gloss.
BOUNCES = {
    "max_bounces": 8, "diffuse_bounces": 0, "glossy_bounces": 2, "transmission_bounces": 8, "transparent_max_bounces": 16,
}  # fmt: skip
_VIEWPOINTS = 64
#: The back of a surface gets no texels if less than this share of it is visible, relative to the
#: front: it is seen only through cracks.
_GLIMPSE = 0.02
#: Side and samples of the coarse map. A gathered ray averages over its texels, so that with twice
#: the samples frames are no closer to those of many samples (addon/README.md).
_COARSE_SIZE, _COARSE_SAMPLES = 1024, 8
_MAX_BOUNCES = 8
#: Hidden texels get the samples divided by this, for all lamps together: they are not shown, and a
#: gathered ray averages over many of them.
_HIDDEN_SHARE = 4
_STEPS_INTO_VIEW = (0.2, 0.4, 0.6, 0.8, 1.0)
#: A dark texel is hidden without further tests if its chart has at least this number of texels, and
#: none of them within this number of steps was found visible by the first tests.
_LARGE_CHART, _NEAR_STEPS = 64, 4


def prepare(job: RenderJob, report: Callable[[str], None]) -> tuple[Path, bool]:
    """Find the light map of the open scene with the job's size, samples and seed, shipped or in the
    cache, or bake it. Returns its folder, and
    whether it was baked.

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
        versions = {"blender": compat.version_line(), "iclnuim": __version__, "extra": {}}
        key = {**scene_key.key_parts(found, bpy.context.scene), "settings": chosen, **versions}
        name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:20]
        cache = shipped.cache_folder()
        folder = cache / "light" / name
        if lacking := not is_whole(folder):
            report(_beforehand(job))
            _make(folder, found, depsgraph, chosen, key, report)
    with suppress(
        IclnuimError, OSError
    ):  # a note for `find`; it is optional if the cache cannot be written
        (cache / "light/known").mkdir(parents=True, exist_ok=True)
        write_json(_note_file(cache, job), {"map": folder.name})
    return folder, lacking


def _beforehand(job: RenderJob) -> str:
    """A message with the estimated time of the bake: the time of the scene's map with the other
    setting of `lambertian`, or from its texels.
    """
    known = find(shipped.cache_folder(), job.changed(lambertian=not job.lambertian))
    estimate = bake_core_s(job) / bpy.context.scene.render.threads
    seconds = read_recipe(known[0]).get("seconds", estimate) if known else estimate
    if job.lambertian:
        return f"light map: without reflections the light differs, so a separate map is baked, in about {max(1, seconds):.0f} s"
    return f"light map: baked in about {max(1, seconds):.0f} s"


def apply(folder: Path, limit: float | None = None) -> LitScene:
    """Show the open scene lit by the light map in `folder`, in memory; the result can be reverted.
    limit: as in lit_scene.baked_copy.
    """
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        image = bpy.data.images.load(str(folder / MAP), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        if (
            limit is not None
        ):  # without brighter light the limit is not needed, and materials are simpler
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            limit = limit if pixels.max() > limit else None
        lit = lit_scene.show(surfaces.parts(depsgraph), load_layout(folder), image, limit=limit)
    for lamp in (
        bpy.context.scene.objects
    ):  # lamps that are not visible in reflections: all their light is in the map
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
    chosen: dict[str, int],
    key: dict,
    report: Callable[[str], None],
) -> None:
    started, seed = time.perf_counter(), chosen["seed"]
    whole = surfaces.joined(found)
    places = light_sampling.viewpoints(depsgraph, whole, _VIEWPOINTS, seed)
    report(f"light map: {len(found)} objects, {whole.faces} faces, {len(places)} viewpoints")
    shows, translucent, sends = _kinds(found)
    layout = lay_out(whole, np.repeat(sends[:, None], 2, 1), chosen["coarse_size"])
    seen = _seen(layout, places, seed)
    wanted, exposure = _seen_sides(layout, seen, shows, translucent)
    coarse = _Points(layout, seen > 0, places, chosen["coarse_samples"], seed, translucent)
    report(f"coarse map: {coarse.layout.summary()}")
    first = coarse.direct()
    layout = lay_out(whole, wanted, chosen["size"], exposure, coarse.contrast(first))
    seen = _seen(layout, places, seed + 1)
    fine = _Points(layout, seen > 0, places, chosen["samples"], seed + 1, translucent)
    with _bounced(found, coarse, first):
        report(f"fine map: {fine.layout.summary()}")
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
    store(folder, light, _map_layout(found, fine.layout), recipe)
    report(f"light map: {seconds:.0f} s, {folder}")


@contextmanager
def _bounced(found: list[Part], coarse: "_Points", first: np.ndarray) -> Iterator[None]:
    """The scene lit by the coarse map with all bounces except the last; `first` is the direct
    light.
    """
    cycles = bpy.context.scene.cycles
    light = coarse.map(first)
    image = bpy.data.images.new(
        "light map", light.shape[1], light.shape[0], float_buffer=True, is_data=True
    )
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


def _seen(layout: Layout, places: np.ndarray, seed: int) -> np.ndarray:
    """(N,) light of lamps at the cameras' places on each texel, see light_sampling.seen."""
    texels = layout.texels
    chart = texels.image(texels.chart, -1)
    large = np.bincount(texels.chart)[texels.chart] >= _LARGE_CHART

    def hidden(found: np.ndarray) -> np.ndarray:
        near = grown(texels.image(found, False), chart, _NEAR_STEPS)
        return large & ~near.ravel()[texels.index]

    return light_sampling.seen(*layout.points(), places, seed, hidden)


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


class _Points:
    """The texels of a map: their points, whether they are visible, and the light on them."""

    def __init__(
        self,
        layout: Layout,
        seen: np.ndarray,
        places: np.ndarray,
        samples: int,
        seed: int,
        translucent: np.ndarray,
    ) -> None:
        self.layout, self.samples, self.seed = layout, samples, seed
        self.points_m, self.normals = layout.points()
        image = layout.texels.image
        self.chart, self.facing = (
            image(layout.texels.chart, -1),
            image(self.normals.astype(np.float32)),
        )
        # visible texels, and texels whose light passes through to a visible side
        seen, rows = seen.copy(), np.flatnonzero(translucent[layout.face_of_texel] & ~seen)
        seen[rows] = light_sampling.seen(self.points_m[rows], -self.normals[rows], places, seed) > 0
        self.visible = image(seen, False)
        self._into_view(places)

    def _into_view(self, places: np.ndarray) -> None:
        """Move the point of each hidden texel next to a visible one to the first visible point on
        the line to that texel.

        So the light close to a contact of two surfaces is sampled there, and not at a texel farther
        away.
        """
        hidden, near = next_to_known(self.visible, self.chart)
        hidden_row, near_row = (
            np.searchsorted(self.layout.texels.index, k) for k in (hidden, near)
        )
        share = np.array(_STEPS_INTO_VIEW)[:, None, None]
        points, normals = (
            (1 - share) * v[hidden_row] + share * v[near_row] for v in (self.points_m, self.normals)
        )
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        seen = np.ones(points.shape[:2], bool)  # the last is the visible texel itself
        tested = light_sampling.seen(
            points[:-1].reshape(-1, 3), normals[:-1].reshape(-1, 3), places, self.seed
        )
        seen[:-1] = tested.reshape(seen[:-1].shape) > 0
        first = seen.argmax(0), np.arange(len(hidden))
        self.points_m[hidden_row], self.normals[hidden_row] = points[first], normals[first]
        self.visible.ravel()[hidden] = True

    def direct(self, sky: bool = True) -> np.ndarray:
        """(2, N, 3) direct light by two halves of the samples, see light_sampling.direct."""
        method = functools.partial(
            light_sampling.direct, materials=list(bpy.data.materials), sky=sky
        )
        return self._sampled(method, functools.partial(method, together=True))

    def gathered(self, sky: bool = False) -> np.ndarray:
        """(2, N, 3) light from the surfaces of the open scene, see light_sampling.gathered."""
        method = functools.partial(light_sampling.gathered, sky=sky)
        return self._sampled(method, method)

    def _sampled(
        self, method: Callable[..., np.ndarray], for_hidden: Callable[..., np.ndarray]
    ) -> np.ndarray:
        visible = self.visible.ravel()[self.layout.texels.index]
        light = np.zeros((2, len(visible), 3), np.float32)
        hidden_samples = max(2, self.samples // _HIDDEN_SHARE)
        for rows, sampled, samples in (
            (visible, method, self.samples),
            (~visible, for_hidden, hidden_samples),
        ):
            light[:, rows] = sampled(self.points_m[rows], self.normals[rows], samples, self.seed)
        return light

    def contrast(self, light: np.ndarray) -> np.ndarray:
        """(F, 2) mean squared change of light between neighbouring texels, for each side."""
        image = self.layout.texels.image
        steps = contrast(image(light[0]), image(light[1]), self.chart)
        return self.layout.per_side(steps.ravel()[self.layout.texels.index])

    def map(self, light: np.ndarray) -> np.ndarray:
        """The map (size, size, 3): denoised, with hidden texels next to visible ones and gutters
        filled.
        """
        image = self.layout.texels.image
        smooth = denoise(image(light[0]), image(light[1]), self.chart, self.facing, self.visible)
        filled, reached = fill(smooth, self.visible, self.chart, 2)
        smooth = np.where(reached[..., None], filled, smooth)
        return fill(smooth, self.chart >= 0, self.chart, 2)[0].astype(np.float32)


def is_whole(folder: Path) -> bool:
    """Whether the folder contains a complete light map. The recipe is written last."""
    return all((folder / name).is_file() for name in LIGHT_FILES)


def store(folder: Path, light: np.ndarray, layout: MapLayout, recipe: dict) -> None:
    """Write a map (rows, columns, 3), row 0 at the bottom, to a temporary folder and rename it, so
    that two processes cannot interfere.

    Light above the range of half floats, as close to a lamp of radius 0, is clipped. Raises
    WorkError for NaN.
    """
    if np.isnan(light).any():
        problem = "the light map contains NaN and is not stored"
        raise WorkError(problem, hint="path tracing: {light} path")
    light = np.minimum(light, np.finfo(np.float16).max)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        write_exr(
            temporary / MAP,
            {name: light[::-1, :, k].astype(np.float16) for k, name in enumerate("RGB")},
        )
        stored = {
            "uv": layout.uv.astype(np.float32),
            "has": layout.has,
            "part_corners": np.array(layout.part_corners),
        }
        np.savez_compressed(temporary / LAYOUT, **stored)
        write_json(temporary / RECIPE, recipe)
        temporary.chmod(0o755)
        try:
            temporary.rename(folder)
        except OSError:
            if not is_whole(
                folder
            ):  # otherwise another process was first; equal keys give equal maps
                shutil.rmtree(folder, ignore_errors=True)
                temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def load_layout(folder: Path) -> MapLayout:
    """Read the layout of a light map. Raises WorkError if the file is damaged."""
    try:
        with np.load(folder / LAYOUT) as stored:
            return MapLayout(
                stored["uv"], stored["has"], tuple(int(n) for n in stored["part_corners"])
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        problem = f"the light map cannot be read ({error}); delete this folder and bake again"
        raise WorkError(f"{folder}: {problem}") from None


def read_recipe(folder: Path) -> dict:
    """The recipe of a light map: what it was baked from."""
    return read_json(folder / RECIPE)


def find(cache: Path, job: RenderJob) -> tuple[Path, int, float] | None:
    """(folder, size in bytes, age in seconds) of the shipped or noted light map for the job's
    scene, settings and Blender; None if there is none.
    """
    try:
        folder = shipped_light(job) or cache / "light" / str(
            read_json(_note_file(cache, job))["map"]
        )
        if not is_whole(folder):
            return None
        files = [path.stat() for path in folder.iterdir()]
    except (IclnuimError, OSError, KeyError):
        return None
    return folder, sum(f.st_size for f in files), time.time() - max(f.st_mtime for f in files)


def _note_file(cache: Path, job: RenderJob) -> Path:
    light = [job.map_size, job.map_samples, job.seed, job.lambertian]
    # only the scene's own file: other files it refers to are known only when it is open
    path = shipped.scene_file(job.scene) if shipped.is_scene(job.scene) else Path(job.scene)
    decides = [
        _file_hash(path, path.stat().st_mtime_ns),
        job.reading.to_dict(),
        *light,
        compat.version_line(),
        __version__,
    ]
    return (
        cache
        / "light/known"
        / f"{hashlib.sha256(json.dumps(decides).encode()).hexdigest()[:20]}.json"
    )


@functools.lru_cache(maxsize=4)
def _file_hash(path: Path, changed_ns: int) -> str:
    return sha256(read_bytes(path))
