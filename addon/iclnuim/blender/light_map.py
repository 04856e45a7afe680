"""A baked light map on disk: one folder in the cache, whole or not there at all."""

from __future__ import annotations

import json
import shutil
import tempfile
import zipfile
from pathlib import Path

import bpy
import numpy as np

from ..errors import WorkError
from ..formats.exr import write_exr
from ..shipped import cache_folder as cache_folder
from .lit_scene import MapLayout

MAP, LAYOUT, RECIPE = "light.exr", "layout.npz", "recipe.json"


def is_whole(folder: Path) -> bool:
    """Whether a finished light map lies there. The recipe is written last."""
    return all((folder / name).is_file() for name in (MAP, LAYOUT, RECIPE))


def store(folder: Path, light: np.ndarray, layout: MapLayout, recipe: dict) -> None:
    """Write a map (rows, columns, 3), row 0 at the bottom, beside the cache and rename: two processes cannot spoil each other."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        channels = {name: light[::-1, :, k].astype(np.float16) for k, name in enumerate("RGB")}
        write_exr(temporary / MAP, channels)
        np.savez_compressed(
            temporary / LAYOUT,
            uv=layout.uv.astype(np.float32),
            has=layout.has,
            part_corners=np.array(layout.part_corners),
        )
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
            return  # somebody else was first; equal keys make equal maps
        shutil.rmtree(folder, ignore_errors=True)
        temporary.rename(folder)


def load_layout(folder: Path) -> MapLayout:
    """Raises WorkError where the file is damaged."""
    try:
        with np.load(folder / LAYOUT) as stored:
            return MapLayout(stored["uv"], stored["has"], tuple(int(n) for n in stored["part_corners"]))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise WorkError(
            f"{folder}: the light map cannot be read ({error}); delete this folder and bake again"
        ) from None


def load_image(folder: Path) -> bpy.types.Image:
    """The map as an image of raw numbers."""
    image = bpy.data.images.load(str(folder / MAP), check_existing=False)
    image.colorspace_settings.name = "Non-Color"
    return image


def read_recipe(folder: Path) -> dict:
    """What the map was made from."""
    return json.loads((folder / RECIPE).read_text(encoding="utf-8"))
