"""Draws the trajectory chosen in the panel and an estimate into the 3D view, without objects.

The trajectory is read when the panel is first drawn for a scene, and when a setting changes.
"""

from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.types import Context, Scene

from ..errors import IclnuimError
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, trajectory_statistics
from . import inputs, properties, state
from .pictures import error_colours

#: The collection of the scene loaded into the window, and its property that contains the name of
#: that scene.
COLLECTION = "ICL-NUIM scene"
SHOWN = "iclnuim_scene"
TRAJECTORY_COLOUR = (1.0, 0.55, 0.1, 1.0)
FRUSTUM_COLOUR = (0.25, 0.75, 1.0, 0.9)
HIDDEN_ALPHA = 0.6  # opacity of lines behind a wall or the ceiling
_FRUSTA = 30
_FRUSTUM_DEPTH_M = 0.12


def refresh(context: Context) -> None:
    """Read the trajectory, store its statistics as lines of text for the panel, and draw it.

    An error is stored as the warning.
    """
    panel = state.current()
    panel.trajectory_key = _key(context.scene)
    panel.trajectory_warning = ""
    try:
        loaded = inputs.trajectory(context)
    except IclnuimError as error:
        panel.trajectory_lines = []
        panel.trajectory_warning = error.worded(panel.work.name_of)
        panel.shapes = {name: shape for name, shape in panel.shapes.items() if name == "estimate"}
        return
    chosen = loaded.trajectory
    s = trajectory_statistics(chosen)
    panel.trajectory_lines = [
        loaded.read_as.sentence,
        f"{s.frames} poses, {s.length_m:.2f} m in {s.duration_s:.1f} s",
        f"speed {s.mean_speed:.3f} m/s, max {s.max_speed:.2f} m/s",
        f"rotation {s.mean_rotation_rate:.1f} deg/s, max {s.max_rotation_rate:.0f} deg/s",
    ]
    panel.trajectory_warning = _collisions(context, chosen)
    camera = context.scene.iclnuim.camera()
    count = len(chosen)
    picked = chosen.T_world_camera[np.unique(np.linspace(0, count - 1, _FRUSTA).astype(int))]
    _show("trajectory", _segments(chosen.positions_m), TRAJECTORY_COLOUR)
    _show("frusta", _frusta(picked, camera), FRUSTUM_COLOUR)


def begin() -> None:
    """Read and draw the trajectory of the first window's scene, soon after the panel was drawn
    for it.
    """
    panel = state.current()
    scene = bpy.context.window_manager.windows[0].scene
    if panel.trajectory_key[:1] != (scene.name,):
        panel.trajectory_key = (scene.name,)
        state.later(_refresh_here)


def _refresh_here() -> None:
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        refresh(bpy.context)
    state.redraw()


def show_estimate(positions_m: np.ndarray, error_m: np.ndarray) -> None:
    """Draw an aligned estimate (n, 3) coloured by its error (n,)."""
    colours = np.c_[error_colours(error_m), np.ones(len(error_m))]
    _show("estimate", _segments(positions_m), _segments(colours))


def _key(scene: Scene) -> tuple:
    values = [np.array(getattr(scene.iclnuim, n)).tolist() for n in properties.OF_THE_TRAJECTORY]
    return scene.name, bpy.data.collections.get(COLLECTION, {}).get(SHOWN), *values


def is_chosen_scene_open(context: Context) -> bool:
    """Whether the chosen scene is the one in this window."""
    shown = bpy.data.collections.get(COLLECTION, {}).get(SHOWN)
    return inputs.scene_name(context.scene.iclnuim) in ("OPEN", shown)


def _collisions(context: Context, trajectory: Trajectory) -> str:
    """A warning if the line between two successive poses hits a surface of the open scene; only if
    that is the chosen scene.
    """
    if not is_chosen_scene_open(context):
        is_shown = COLLECTION in bpy.data.collections
        return "another scene is shown: press Show the Scene" if is_shown else ""
    depsgraph = context.evaluated_depsgraph_get()
    points = trajectory.positions_m
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    through = []
    for i in np.flatnonzero(lengths > 1e-9):
        length = float(lengths[i])
        hit = context.scene.ray_cast(depsgraph, points[i], steps[i] / length, distance=length)
        if hit[0]:
            through.append(i)
    if not through:
        return ""
    place = f"frame {through[0]}"
    if len(through) > 1:
        place += f" and {len(through) - 1} more"
    return f"the trajectory passes through a surface at {place}"


def _show(name: str, points: np.ndarray, colours: object) -> None:
    panel = state.current()
    colours = np.broadcast_to(np.asarray(colours, np.float32), (len(points), 4))
    panel.shapes[name] = points.astype(np.float32), np.ascontiguousarray(colours)
    panel.batches.pop(name, None)


def _segments(values: np.ndarray) -> np.ndarray:
    """(n, k) points of a curve -> (2n - 2, k) end points of its line segments."""
    return np.repeat(values, 2, axis=0)[1:-1]


def _frusta(poses: SE3, camera: PinholeCamera) -> np.ndarray:
    """(16 n, 3) end points of line segments: eight lines per camera."""
    u = [-0.5, camera.width - 0.5, camera.width - 0.5, -0.5]
    v = [-0.5, -0.5, camera.height - 0.5, camera.height - 0.5]
    rays = np.linalg.solve(camera.K, np.array([u, v, [1.0] * 4]))
    corners = np.swapaxes(poses.rotation @ rays, 1, 2) * _FRUSTUM_DEPTH_M
    world = corners + poses.translation[:, None]
    around = np.roll(world, -1, axis=1)
    eye = np.broadcast_to(poses.translation[:, None], world.shape)
    return np.stack([eye, world, world, around], 2).reshape(-1, 3)


def draw() -> None:
    """Called by Blender for every 3D view."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    panel = state.current()
    settings = bpy.context.scene.iclnuim
    if not settings.show_path or not panel.shapes:
        return
    if bpy.context.region_data is not None and bpy.context.region_data.view_perspective == "CAMERA":
        return  # the camera is on the trajectory: its own frusta would fill the view
    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    gpu.state.blend_set("ALPHA")
    for name, (points, colours) in panel.shapes.items():
        if name not in panel.batches:
            faint = colours * np.array([1, 1, 1, HIDDEN_ALPHA], np.float32)
            both = ({"pos": points, "color": c} for c in (faint, colours))
            panel.batches[name] = [batch_for_shader(shader, "LINES", content) for content in both]
        shader.uniform_float("lineWidth", 1.2 if name == "frusta" else 3.0)
        for batch, test in zip(panel.batches[name], ("NONE", "LESS_EQUAL"), strict=True):
            gpu.state.depth_test_set(test)
            batch.draw(shader)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")


@persistent
def _file_opened(*_: Any) -> None:
    """Another file was opened: nothing is drawn until the panel is, and no evaluation is left."""
    panel = state.current()
    panel.evaluation = None
    panel.evaluation_lines = []
    panel.evaluation_warnings = []
    panel.shapes.clear()
    panel.batches.clear()
    panel.trajectory_key = ()
    panel.trajectory_lines = []
    panel.trajectory_warning = ""


@persistent
def _undone(*_: Any) -> None:
    """Undo and redo change settings without calling their update functions."""
    key = state.current().trajectory_key
    if key and key != _key(bpy.context.scene):
        refresh(bpy.context)


_HANDLERS = {"load_post": _file_opened, "undo_post": _undone, "redo_post": _undone}


def register() -> None:
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).append(handler)
    if not bpy.app.background:
        state.current().draw_handle = bpy.types.SpaceView3D.draw_handler_add(
            draw, (), "WINDOW", "POST_VIEW"
        )


def unregister() -> None:
    for event, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, event).remove(handler)
    if state.current().draw_handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(state.current().draw_handle, "WINDOW")
