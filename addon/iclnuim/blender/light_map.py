"""Baked light maps on disk: one folder each in the cache, whole or not there at all; and notes of which one belongs to which scene file,
so that a window can tell without opening the scene.
"""

import functools
import hashlib
import json
import shutil
import tempfile
import time
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from .. import __version__
from ..errors import IclnuimError, WorkError
from ..formats.exr import write_exr
from ..formats.files import read_bytes, read_json, sha256, write_json
from ..job import RenderJob
from ..shipped import cache_folder as cache_folder
from . import compat, scene
from .lit_scene import MapLayout

MAP, LAYOUT, RECIPE = "light.exr", "layout.npz", "recipe.json"


@dataclass(frozen=True)
class KnownMap:
    """A light map in the cache: its folder, size on disk in bytes, age in seconds."""

    folder: Path
    size_bytes: int
    age_s: float


def is_whole(folder: Path) -> bool:
    """Whether a finished light map lies there. The recipe is written last."""
    return all((folder / name).is_file() for name in (MAP, LAYOUT, RECIPE))


def store(folder: Path, light: np.ndarray, layout: MapLayout, recipe: dict) -> None:
    """Write a map (rows, columns, 3), row 0 at the bottom, beside the cache and rename: two processes cannot spoil each other.

    Light beyond what half floats hold, as close to a lamp of radius 0, is cut. Raises WorkError for light that is not a number.
    """
    if np.isnan(light).any():
        raise WorkError(
            "the light map has values that are not numbers and is not stored", hint="path tracing: {light} path"
        )
    light = np.minimum(light, np.finfo(np.float16).max)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        write_exr(temporary / MAP, {name: light[::-1, :, k].astype(np.float16) for k, name in enumerate("RGB")})
        stored = {"uv": layout.uv.astype(np.float32), "has": layout.has, "part_corners": np.array(layout.part_corners)}
        np.savez_compressed(temporary / LAYOUT, **stored)
        (temporary / RECIPE).write_text(json.dumps(recipe, indent=2) + "\n", encoding="utf-8")
        _move_into_place(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move_into_place(temporary: Path, folder: Path) -> None:
    temporary.chmod(0o755)
    try:
        temporary.rename(folder)
    except OSError:
        if is_whole(folder):
            return  # another process was first; equal keys make equal maps
        shutil.rmtree(folder, ignore_errors=True)
        temporary.rename(folder)


def load_layout(folder: Path) -> MapLayout:
    """Raises WorkError where the file is damaged."""
    try:
        with np.load(folder / LAYOUT) as stored:
            return MapLayout(stored["uv"], stored["has"], tuple(int(n) for n in stored["part_corners"]))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        problem = f"the light map cannot be read ({error}); delete this folder and bake again"
        raise WorkError(f"{folder}: {problem}") from None


def load_image(folder: Path) -> bpy.types.Image:
    """The map as an image of raw numbers."""
    image = bpy.data.images.load(str(folder / MAP), check_existing=False)
    image.colorspace_settings.name = "Non-Color"
    return image


def read_recipe(folder: Path) -> dict:
    """What the map was made from."""
    return json.loads((folder / RECIPE).read_text(encoding="utf-8"))


def note(cache: Path, job: RenderJob, folder: Path) -> None:
    """Remember that `folder` holds the light of the job's scene. A cache that cannot be written stays without the note."""
    with suppress(IclnuimError, OSError):
        (cache / "light/known").mkdir(parents=True, exist_ok=True)
        write_json(_note_file(cache, job), {"map": folder.name})


def find(cache: Path, job: RenderJob) -> KnownMap | None:
    """The map noted for the job's scene, settings and Blender; None where there is none, or not any more."""
    try:
        folder = cache / "light" / str(read_json(_note_file(cache, job))["map"])
        if not is_whole(folder):
            return None
        files = [path.stat() for path in folder.iterdir()]
    except (IclnuimError, OSError, KeyError):
        return None
    return KnownMap(folder, sum(f.st_size for f in files), time.time() - max(f.st_mtime for f in files))


def _note_file(cache: Path, job: RenderJob) -> Path:
    light = [job.map_size, job.map_samples, job.seed, job.lambertian]
    decides = [_scene_hash(job.scene), job.reading.to_dict(), *light, compat.version_line(), __version__]
    return cache / "light/known" / f"{hashlib.sha256(json.dumps(decides).encode()).hexdigest()[:20]}.json"


_shipped_hash = functools.lru_cache(maxsize=4)(scene.scene_sha256)


def _scene_hash(name: str) -> str:
    """Of the scene's own file alone: what lies beside it is known only once it is open."""
    if scene.is_shipped(name):
        return _shipped_hash(name)
    path = Path(name)
    return _file_hash(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=4)
def _file_hash(path: Path, changed_ns: int) -> str:
    return sha256(read_bytes(path))
