"""Rendering one frame to arrays: scene-linear RGB and exact planar Z, by way of Blender's multilayer EXR."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError, WorkError
from ..formats import exr

#: Blender writes 1e10 where a ray meets nothing.
_BACKGROUND = 1e9


def render(number: float, raw_file: Path) -> None:
    """Render frame `number`, which may lie between two, of the open scene to `raw_file`, Blender's own EXR.

    Raises WorkError where Blender fails.
    """
    scene = bpy.context.scene
    scene.frame_set(math.floor(number), subframe=number % 1)
    scene.render.filepath = str(raw_file)
    try:
        result = bpy.ops.render.render(write_still=True)
    except RuntimeError as error:
        raise WorkError(f"frame {number}: Blender: {' '.join(str(error).split())}") from None
    if result != {"FINISHED"} or not raw_file.is_file():
        raise WorkError(f"frame {number}: Blender ended with {result} and wrote no frame")


def read(raw_file: Path, raw_depth_file: Path) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) scene-linear RGB from the one and (h, w) planar Z in metres, 0 for background, from the other (often the same).

    Raises WorkError for a file cut short: on a full disk Blender says that all went well.
    """
    channels = _whole(raw_file)
    with_depth = channels if raw_depth_file == raw_file else _whole(raw_depth_file)
    rgb = np.stack([_ending(channels, f"Combined.{c}") for c in "RGB"], -1)
    depth_z_m = _ending(with_depth, "Depth.Z")
    return rgb, np.where(depth_z_m < _BACKGROUND, depth_z_m, 0.0).astype(np.float32)


def _whole(raw_file: Path) -> dict[str, np.ndarray]:
    try:
        return exr.read_exr(raw_file)
    except InputError as error:
        raise WorkError(f"cannot write a whole frame, is the disk full? {error}") from None


def _ending(channels: dict[str, np.ndarray], name: str) -> np.ndarray:
    """The channel of that name in whichever view layer."""
    found = [array for key, array in channels.items() if key.endswith(name)]
    if len(found) != 1:
        raise WorkError(f"expected one channel *{name} in Blender's frame, found {sorted(channels)}")
    return found[0]
