"""What is drawn into the 3D view: the path with frusta, and an estimate coloured by its error. Drawing only, no objects."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from . import session
from .pictures import error_colours

PATH_COLOUR, FRUSTUM_COLOUR = (1.0, 0.55, 0.1, 1.0), (0.25, 0.75, 1.0, 0.9)
HIDDEN_ALPHA = 0.6  # of what lies behind a wall or the ceiling
_FRUSTA, _FRUSTUM_DEPTH_M = 30, 0.12

_shapes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
_batches: dict[str, list] = {}
_handle = None


def set_path(T_world_camera: SE3, camera: PinholeCamera) -> None:
    """Show poses (n,) as a curve, and every n/30th as a frustum."""
    curve = _segments(T_world_camera.translation)
    picked = T_world_camera[np.unique(np.linspace(0, len(T_world_camera) - 1, _FRUSTA).astype(int))]
    _set("path", curve, PATH_COLOUR)
    _set("frusta", _frusta(picked, camera), FRUSTUM_COLOUR)


def set_estimate(positions_m: np.ndarray, reference_m: np.ndarray, error_m: np.ndarray) -> None:
    """Show an aligned estimate (n, 3) coloured by its error (n,), and every n/60th error as a line to the truth."""
    colours = np.c_[error_colours(error_m), np.ones(len(error_m))]
    ties = np.unique(np.linspace(0, len(error_m) - 1, 60).astype(int))
    lines = np.stack([positions_m[ties], reference_m[ties]], 1).reshape(-1, 3)
    points = np.concatenate([_segments(positions_m), lines])
    _set("estimate", points, np.concatenate([_segments(colours), np.repeat(colours[ties], 2, 0)]))


def clear_path() -> None:
    for name in ("path", "frusta"):
        _shapes.pop(name, None)
        _batches.pop(name, None)


def shapes() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What is drawn: name -> line segments' ends (m, 3) and colours (m, 4)."""
    return dict(_shapes)


def _set(name: str, points: np.ndarray, colours: object) -> None:
    colours = np.broadcast_to(np.asarray(colours, np.float32), (len(points), 4))
    _shapes[name] = points.astype(np.float32), np.ascontiguousarray(colours)
    _batches.pop(name, None)


def _segments(values: np.ndarray) -> np.ndarray:
    """(n, k) along a curve -> (2n - 2, k) ends of its pieces."""
    return np.repeat(values, 2, axis=0)[1:-1]


def _frusta(poses: SE3, camera: PinholeCamera) -> np.ndarray:
    """(16 n, 3): eight lines a camera."""
    u, v = np.array([0, camera.width, camera.width, 0]) - 0.5, np.array([0, 0, camera.height, camera.height]) - 0.5
    corners = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(4)], -1) * _FRUSTUM_DEPTH_M
    world = np.einsum("nij,kj->nki", poses.rotation, corners) + poses.translation[:, None]
    lines = []
    for k in range(4):
        lines += [poses.translation, world[:, k], world[:, k], world[:, (k + 1) % 4]]
    return np.stack(lines, 1).reshape(-1, 3)


def _draw() -> None:
    """Called by Blender for every 3D view."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    settings = getattr(bpy.context.scene, "iclnuim", None)
    if settings is None or not settings.show_path or not _shapes:
        return
    if bpy.context.region_data is not None and bpy.context.region_data.view_perspective == "CAMERA":
        return  # the camera flies along its own path: it would see nothing but its own frusta
    shader = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    gpu.state.blend_set("ALPHA")
    for name, (points, colours) in _shapes.items():
        if name not in _batches:
            faint = colours * np.array([1, 1, 1, HIDDEN_ALPHA], np.float32)
            _batches[name] = [batch_for_shader(shader, "LINES", {"pos": points, "color": c}) for c in (faint, colours)]
        shader.uniform_float("lineWidth", 1.2 if name == "frusta" else 3.0)
        for batch, test in zip(_batches[name], ("NONE", "LESS_EQUAL"), strict=True):
            gpu.state.depth_test_set(test)
            batch.draw(shader)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")


@persistent
def _file_opened(*_) -> None:
    """Another file: its own path."""
    from . import path

    _shapes.clear()
    _batches.clear()
    path.refresh(bpy.context)


@persistent
def _undone(*_) -> None:
    """The settings may be other ones."""
    from . import path

    path.refresh_if_changed(bpy.context)


def register() -> None:
    global _handle
    bpy.app.handlers.load_post.append(_file_opened)
    bpy.app.handlers.undo_post.append(_undone)
    bpy.app.handlers.redo_post.append(_undone)
    if not bpy.app.background:
        session.later(_file_opened)
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    global _handle
    bpy.app.handlers.load_post.remove(_file_opened)
    bpy.app.handlers.undo_post.remove(_undone)
    bpy.app.handlers.redo_post.remove(_undone)
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    _shapes.clear()
    _batches.clear()
