"""A light map on disk: one folder, which is complete or absent."""

import shutil
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from ...errors import WorkError
from ...formats.exr import write_exr
from ...formats.files import read_json, write_json
from ...job import LIGHT_FILES
from .lit_scene import MapLayout

MAP, LAYOUT, RECIPE = LIGHT_FILES
#: The texture coordinates of the scene whose light it is.
UV = "uv.npz"


def is_whole(folder: Path) -> bool:
    """Whether the folder contains a complete light map. The recipe is written last."""
    return all((folder / name).is_file() for name in LIGHT_FILES)


def store(folder: Path, light: np.ndarray, layout: MapLayout, uv: np.ndarray, recipe: dict) -> None:
    """Write a map (rows, columns, 3), row 0 at the bottom, and the texture coordinates (n, 2) of the
    scene to a temporary folder and rename it, so that two processes cannot interfere.

    Light above the range of half floats, as close to a lamp of radius 0, is clipped. Raises
    WorkError for NaN.
    """
    if np.isnan(light).any():
        problem = "the light map contains NaN and is not stored"
        raise WorkError(problem, hint="path tracing: {light} path")
    half = np.minimum(light, np.finfo(np.float16).max)[::-1].astype(np.float16)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        write_exr(temporary / MAP, {name: half[..., k] for k, name in enumerate("RGB")})
        np.savez_compressed(
            temporary / LAYOUT,
            uv=layout.uv.astype(np.float32),
            has=layout.has,
            part_corners=np.array(layout.part_corners),
        )
        np.savez_compressed(temporary / UV, uv=uv)
        write_json(temporary / RECIPE, recipe)
        temporary.chmod(0o755)
        try:
            temporary.rename(folder)
        except OSError:
            # another process may have been first
            if not is_whole(folder):
                shutil.rmtree(folder, ignore_errors=True)
                temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def load_layout(folder: Path) -> MapLayout:
    """Read the layout of a light map. Raises WorkError if the file is damaged."""
    try:
        with np.load(folder / LAYOUT) as stored:
            part_corners = tuple(int(n) for n in stored["part_corners"])
            return MapLayout(stored["uv"], stored["has"], part_corners)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        problem = f"the light map cannot be read ({error}); delete this folder and bake again"
        raise WorkError(f"{folder}: {problem}") from None


def load_uv(folder: Path) -> np.ndarray:
    """(n, 2) float32: the texture coordinates of the scene whose light it is; of a file that is
    damaged or not there, none.
    """
    try:
        with np.load(folder / UV) as stored:
            return stored["uv"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return np.zeros((0, 2), np.float32)


def read_recipe(folder: Path) -> dict:
    """The recipe of a light map: what it was baked from."""
    return read_json(folder / RECIPE)
