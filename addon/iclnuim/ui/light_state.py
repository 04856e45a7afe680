"""What the panel says of the chosen scene's light: whether the cache holds it, how large and how old it is."""

from __future__ import annotations

import time

import bpy

from ..blender import light_index
from ..errors import IclnuimError
from . import inputs, session

#: The panel asks at every redraw; files are looked at this often.
_FRESH_S = 1.0
_told: dict = {"question": None, "at_s": 0.0, "line": ""}


def line(settings: bpy.types.PropertyGroup) -> str:
    """One sentence."""
    if settings.scene_source == "OPEN":
        return "the open file's light is looked up, or baked, by Bake Light and Render"
    name = inputs.scene_name(settings)
    question = (name, settings.map_size, settings.map_samples, settings.seed, settings.reading())
    if _told["question"] != question or time.monotonic() - _told["at_s"] > _FRESH_S:
        _told.update(question=question, line=_line(settings, name), at_s=time.monotonic())
    return _told["line"]


def forget() -> None:
    """Look again at the next question."""
    _told["question"] = None


def _line(settings: bpy.types.PropertyGroup, name: str) -> str:
    try:
        found = light_index.find(session.cache_folder(), settings.to_job(name, "kt2"))
    except (IclnuimError, OSError):
        return "no scene file is chosen yet"
    if found is None:
        return "this scene's light is not in the cache: Bake Light or the first render makes it, once, in minutes"
    return f"this scene's light is in the cache: {found.size_bytes / 1e6:.1f} MB, baked {_ago(found.age_s)} ago"


def _ago(seconds: float) -> str:
    for unit_s, unit in ((86400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= unit_s:
            count = int(seconds // unit_s)
            return f"{count} {unit}{'' if count == 1 else 's'}"
    return "less than a minute"
