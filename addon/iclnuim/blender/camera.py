"""The keyframed camera: one key of location and quaternion a frame, exactly the trajectory's poses."""

from __future__ import annotations

import bpy
import mathutils
import numpy as np

from ..geometry import axes
from ..geometry.camera import BlenderCamera, PinholeCamera, blender_from_pinhole
from ..geometry.se3 import SE3
from . import compat

NAME = "ICL-NUIM camera"


def keyframe(T_world_cv: SE3, camera: PinholeCamera) -> bpy.types.Object:
    """Make the scene's active camera follow the poses (n,), pose i at frame i, and look through `camera`.

    Keys are linear and the quaternions continuous in sign, so that the timeline plays the motion as it is.
    """
    scene = bpy.context.scene
    thing = bpy.data.objects.new(NAME, bpy.data.cameras.new(NAME))
    scene.collection.objects.link(thing)
    scene.camera = thing
    for marker in scene.timeline_markers:
        marker.camera = None
    set_intrinsics(scene, thing.data, blender_from_pinhole(camera))
    thing.rotation_mode = "QUATERNION"
    _set_keys(thing, *_locations_and_quaternions(T_world_cv))
    scene.frame_start, scene.frame_end = 0, len(T_world_cv) - 1
    return thing


def set_intrinsics(scene: bpy.types.Scene, lens: bpy.types.Camera, settings: BlenderCamera) -> None:
    """The exact view of a K, without depth of field, clipping from 1 mm to 10 km."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = (
        settings.resolution_x,
        settings.resolution_y,
        100,
    )
    render.pixel_aspect_x, render.pixel_aspect_y = settings.pixel_aspect_x, settings.pixel_aspect_y
    lens.type, lens.lens_unit, lens.sensor_fit = "PERSP", "MILLIMETERS", settings.sensor_fit
    lens.sensor_width, lens.lens = settings.sensor_width, settings.lens
    lens.shift_x, lens.shift_y = settings.shift_x, settings.shift_y
    lens.dof.use_dof = False
    lens.clip_start, lens.clip_end = 1e-3, 1e4


def _locations_and_quaternions(T_world_cv: SE3) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3), (n, 4) scalar first, by way of mathutils as Blender itself would take the matrices apart."""
    locations, quaternions = [], []
    for matrix in axes.world_blender_from_world_cv(T_world_cv).matrix:
        location, quaternion, _ = mathutils.Matrix(matrix).decompose()
        if quaternions:
            quaternion.make_compatible(quaternions[-1])
        locations.append(location)
        quaternions.append(quaternion)
    return np.array(locations), np.array(quaternions)


def _set_keys(thing: bpy.types.Object, locations: np.ndarray, quaternions: np.ndarray) -> None:
    curves = compat.fcurves(thing, bpy.data.actions.new(NAME))
    for path, values in (("location", locations), ("rotation_quaternion", quaternions)):
        for index in range(values.shape[1]):
            _linear_keys(curves.new(data_path=path, index=index), values[:, index])


def _linear_keys(curve: bpy.types.FCurve, values: np.ndarray) -> None:
    points = curve.keyframe_points
    points.add(len(values))
    points.foreach_set("co", np.stack([np.arange(len(values)), values], -1).astype(np.float32).ravel())
    points.foreach_set("interpolation", np.ones(len(values), np.int32))  # 1 is LINEAR
    curve.update()
