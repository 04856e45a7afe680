"""The code that builds the shipped scenes: one module a scene with `build(seed, detail)`, on shared shapes and materials. Needs bpy."""

from __future__ import annotations

import importlib

from iclnuim.shipped import SCENES


def build_scene(name: str, seed: int = 0, detail: float = 1.0) -> None:
    """Fill the current, emptied Blender scene with the scene `name`; lengths in metres, z up. KeyError names the known ones."""
    if name not in SCENES:
        raise KeyError(f"scene {name!r} is not known; there are: {', '.join(SCENES)}")
    importlib.import_module(f".{name}", __package__).build(seed=seed, detail=detail)
