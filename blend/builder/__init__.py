"""The code that builds the shipped scenes: one module per scene with `build(seed, detail)`; shapes
and materials are shared. Needs bpy.
"""

from __future__ import annotations

import importlib

from iclnuim.shipped import SCENES


def build_scene(name: str, seed: int = 0, detail: float = 1.0) -> None:
    """Build the scene `name` in the current, empty Blender scene; lengths in metres, z up.

    Raises KeyError with the known names.
    """
    if name not in SCENES:
        raise KeyError(f"scene {name!r} is not known; there are: {', '.join(SCENES)}")
    importlib.import_module(f".{name}", __package__).build(seed=seed, detail=detail)
