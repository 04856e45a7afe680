"""The path that the panel shows: read once when a setting changes, drawn from what is kept here."""

from __future__ import annotations

import bpy
import numpy as np

from ..errors import IclnuimError
from ..geometry.trajectory import Trajectory, statistics
from . import inputs, session, viewport
from .work import in_panel_words

COLLECTION = "ICL-NUIM scene"
#: A property of that collection: the scene it was filled with.
SHOWN = "iclnuim_scene"
_DECIDES = (
    "scene_source",
    "scene_file",
    "trajectory_source",
    "trajectory_file",
    "scale",
    "use_start",
    "start_location",
    "start_rotation",
)


def refresh(context: bpy.types.Context) -> None:
    """Read the path chosen, note its statistics, hand it to the viewport. Bad input becomes a line in the panel."""
    held = session.current
    held.path_key = _key(context.scene)
    try:
        chosen, sentence = inputs.trajectory(context)
    except IclnuimError as error:
        held.path_lines, held.path_warning = [], in_panel_words(str(error))
        viewport.clear_path()
        return
    held.path_lines = _lines(chosen, sentence)
    held.path_warning = _walls(context, chosen)
    viewport.set_path(chosen.T_world_camera, context.scene.iclnuim.camera())


def refresh_if_changed(context: bpy.types.Context) -> None:
    """After an undo or redo, which change settings without saying so."""
    if session.current.path_key != _key(context.scene):
        refresh(context)


def _key(scene: bpy.types.Scene) -> tuple:
    values = (getattr(scene.iclnuim, name) for name in _DECIDES)
    return scene.name, _shown(), *(v if isinstance(v, (str, float, bool)) else tuple(v) for v in values)


def _shown() -> str | None:
    """Which scene stands in our collection."""
    collection = bpy.data.collections.get(COLLECTION)
    return collection.get(SHOWN) if collection is not None else None


def _lines(path: Trajectory, sentence: str) -> list[str]:
    s = statistics(path)
    return [
        sentence,
        f"{s.frames} poses, {s.length_m:.2f} m in {s.duration_s:.1f} s",
        f"speed {s.mean_speed:.3f} m/s, at most {s.max_speed:.2f}",
        f"turning {s.mean_rotation_rate:.1f} deg/s, at most {s.max_rotation_rate:.0f}",
    ]


def _walls(context: bpy.types.Context, path: Trajectory) -> str:
    """A warning where the straight way between two poses meets a surface of the open scene, if that is the one chosen."""
    name = inputs.scene_name(context.scene.iclnuim)
    if name not in ("OPEN", _shown()):
        return "another scene stands here: Show the Scene Here" if _shown() else ""
    depsgraph = context.evaluated_depsgraph_get()
    points = path.positions_m
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    through = [
        i
        for i in np.flatnonzero(lengths > 1e-9)
        if context.scene.ray_cast(depsgraph, points[i], steps[i] / lengths[i], distance=float(lengths[i]))[0]
    ]
    if not through:
        return ""
    return f"the path passes through a surface at frame {through[0]}" + (
        f" and {len(through) - 1} more" if len(through) > 1 else ""
    )
