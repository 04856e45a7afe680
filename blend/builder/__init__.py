"""The code that builds the shipped scenes: one module per scene with `build(seed, detail)`; shapes
and materials are shared. Needs bpy.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec

from iclnuim.errors import InputError
from iclnuim.shipped import SCENES


def build_scene(name: str, seed: int = 0, detail: float = 1.0) -> None:
    """Build the scene `name` in the current, empty Blender scene; lengths in metres, z up.

    Raises InputError for a scene that is not built by code.
    """
    if find_spec(f".{name}", __package__) is None:
        built = [scene for scene in SCENES if find_spec(f".{scene}", __package__)]
        raise InputError(f"a scene that is built by code ({', '.join(built)})", found=name)
    importlib.import_module(f".{name}", __package__).build(seed=seed, detail=detail)
