"""Cameras of the open scene: keyframes with a trajectory's exact poses; an animated camera as a
trajectory, its lens as a pinhole camera.
"""

import bpy
import mathutils
import numpy as np
from bpy.types import Camera, Object, RenderSettings, Scene

from ...errors import InputError
from ...geometry import axes
from ...geometry.camera import BlenderCamera, PinholeCamera, blender_from_pinhole
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory
from .. import compat
from ..notes import names_of
from ..open import motion

NAME = "ICL-NUIM camera"
#: Number of the interpolation LINEAR of keys.
_LINEAR = 1


def keyframe(T_world_cv: SE3, camera: PinholeCamera, frames: np.ndarray | None = None) -> Object:
    """Add an active camera that follows the poses (n,), pose i at frame i or at that of `frames`
    (n,), with the intrinsics of `camera`: exactly its K, without depth of field, with clipping at
    1 mm and 10 km.

    Interpolation is linear and the signs of the quaternions are continuous, so that the timeline
    plays the motion correctly.
    """
    scene = bpy.context.scene
    thing = bpy.data.objects.new(NAME, bpy.data.cameras.new(NAME))
    scene.collection.objects.link(thing)
    scene.camera = thing
    for marker in scene.timeline_markers:
        marker.camera = None
    _set_lens(scene.render, thing.data, blender_from_pinhole(camera))
    thing.rotation_mode = "QUATERNION"
    # Time Stretching: frame n shows the keys at n times this factor
    pace = scene.render.frame_map_old / scene.render.frame_map_new
    places = np.arange(len(T_world_cv)) if frames is None else frames
    curves = compat.fcurves(thing, bpy.data.actions.new(NAME))
    locations, quaternions = _locations_and_quaternions(T_world_cv)
    for path, values in (("location", locations), ("rotation_quaternion", quaternions)):
        for index, column in enumerate(values.T):
            points = curves.new(data_path=path, index=index).keyframe_points
            points.add(len(column))
            points.foreach_set(
                "co", np.stack([places * pace, column], -1).astype(np.float32).ravel()
            )
            points.foreach_set("interpolation", np.full(len(column), _LINEAR, np.int32))
    for curve in curves:
        curve.update()
    scene.frame_start = 0
    scene.frame_end = int(places[-1])
    return thing


def _set_lens(render: RenderSettings, lens: Camera, settings: BlenderCamera) -> None:
    for name in ("resolution_x", "resolution_y", "pixel_aspect_x", "pixel_aspect_y"):
        setattr(render, name, getattr(settings, name))
    render.resolution_percentage = 100
    lens.type = "PERSP"
    lens.lens_unit = "MILLIMETERS"
    for name in ("sensor_fit", "sensor_width", "lens", "shift_x", "shift_y"):
        setattr(lens, name, getattr(settings, name))
    lens.dof.use_dof = False
    lens.clip_start = 1e-3
    lens.clip_end = 1e4


def _locations_and_quaternions(T_world_cv: SE3) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) locations and (n, 4) quaternions, scalar first, decomposed by mathutils as Blender
    itself does.
    """
    locations: list[mathutils.Vector] = []
    quaternions: list[mathutils.Quaternion] = []
    for matrix in axes.world_blender_from_world_cv(T_world_cv).matrix:
        location, quaternion, _ = mathutils.Matrix(matrix).decompose()
        if quaternions:
            quaternion.make_compatible(quaternions[-1])
        locations.append(location)
        quaternions.append(quaternion)
    return np.array(locations), np.array(quaternions)


def active(scene: Scene, name: str | None = None) -> Object:
    """The camera of that name, or the active camera. Raises InputError if there is none."""
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if name is not None:
        found = next((o for o in cameras if o.name == name), None)
        if found is None:
            names = ", ".join(sorted(o.name for o in cameras)) or "none"
            raise InputError(f"a camera of the scene: {names}", found=name)
        return found
    if scene.camera is None:
        hint = "adding a camera (Add > Camera), or another trajectory"
        raise InputError("an active camera", found="none", hint=hint)
    return scene.camera


def trajectory(scene: Scene, camera: Object | None = None) -> Trajectory:
    """The poses of the camera at every frame of the timeline, with stamps from 1 s on at the
    scene's frame rate. The current frame is restored.

    If no `camera` is given, markers that change the active camera are followed.
    """
    if camera is None:
        active(scene)
    before = scene.frame_current
    matrices = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        matrices.append(np.array((camera or active(scene)).matrix_world))
    scene.frame_set(before)
    rate_hz = scene.render.fps / scene.render.fps_base
    return Trajectory.at_rate(axes.world_cv_from_world_blender(_poses(np.array(matrices))), rate_hz)


def timeline_note(scene: Scene) -> str | None:
    """A warning if the poses of `trajectory` and the scene's motion would be rendered at different
    times: pose 0 is rendered at frame 0.
    """
    moving = motion.moving_names(scene) if scene.frame_start else []
    if not moving:
        return None
    start = f"the timeline starts at frame {scene.frame_start}"
    shift = f"pose 0 is rendered with moving objects as at frame 0 ({names_of(moving)})"
    return f"{start}, but {shift}: shift all animations so that the timeline starts at 0"


def _poses(matrices: np.ndarray) -> SE3:
    """Rigid poses of matrices (n, 4, 4) that may scale or mirror: view and up directions are kept,
    and the right direction is computed from them.
    """
    back = matrices[:, :3, 2] / np.linalg.norm(matrices[:, :3, 2], axis=1, keepdims=True)
    right = np.cross(matrices[:, :3, 1], back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return SE3(np.stack([right, np.cross(back, right), back], -1), matrices[:, :3, 3])


def pinhole(scene: Scene, camera: Object) -> PinholeCamera | None:
    """The camera's K at the render's resolution; None if it is not a perspective camera."""
    lens = camera.data
    render = scene.render
    if lens.type != "PERSP":
        return None
    width = max(1, render.resolution_x * render.resolution_percentage // 100)
    height = max(1, render.resolution_y * render.resolution_percentage // 100)
    across = width * render.pixel_aspect_x
    down = height * render.pixel_aspect_y
    is_auto = lens.sensor_fit == "AUTO"
    is_horizontal = lens.sensor_fit == "HORIZONTAL" or (is_auto and across >= down)
    view = across if is_horizontal else down
    sensor = lens.sensor_width if is_horizontal or is_auto else lens.sensor_height
    focal = lens.lens * view / sensor
    fx = focal / render.pixel_aspect_x
    fy = focal / render.pixel_aspect_y
    cx = (width - 1) / 2 - lens.shift_x * view / render.pixel_aspect_x
    cy = (height - 1) / 2 + lens.shift_y * view / render.pixel_aspect_y
    return PinholeCamera(width, height, fx, fy, cx, cy)
