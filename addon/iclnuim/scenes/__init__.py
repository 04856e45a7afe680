"""The built-in scenes: a registry that can be read without Blender; a scene's module is imported only when it is
built.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass


@dataclass(frozen=True)
class SceneEntry:
    """Where a scene is built: `module` (relative to this package) holds `build(seed, detail)`."""

    name: str
    module: str
    title: str

    def build(self, seed: int = 0, detail: float = 1.0) -> None:
        """Fill the current, emptied Blender scene (needs bpy); lengths in metres, z up."""
        importlib.import_module(self.module, __package__).build(seed=seed, detail=detail)


SCENES: dict[str, SceneEntry] = {
    entry.name: entry
    for entry in (
        SceneEntry("living_room", ".living_room", "living room, 4.94 x 5.02 x 2.50 m"),
        SceneEntry("office", ".office", "office, 5.0 x 7.4 x 2.40 m"),
    )
}


def build_scene(name: str, seed: int = 0, detail: float = 1.0) -> None:
    """Build the scene `name` into the current Blender scene; KeyError names the known ones."""
    if name not in SCENES:
        raise KeyError(f"scene {name!r} is not known; there are: {', '.join(SCENES)}")
    SCENES[name].build(seed=seed, detail=detail)
