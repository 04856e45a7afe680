"""Initial state of a scene's file: render settings, and a camera with the paper's intrinsics."""

from __future__ import annotations

import bpy
import numpy as np

FARTHEST_M = 200.0


def open_with(place_m: tuple[float, float, float], down_deg: float, turn_deg: float) -> None:
    """A camera at `place_m`, tilted `down_deg` up from straight down and rotated by `turn_deg`
    about z.
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.filepath = "//"
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = 640
    scene.render.resolution_y = 480
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x = 1.0
    scene.render.pixel_aspect_y = 481.2 / 480.0
    scene.unit_settings.system = "METRIC"
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = 36.0
    camera.lens = 481.2 * 36.0 / 640
    camera.clip_start = 0.01
    camera.clip_end = FARTHEST_M
    obj = bpy.data.objects.new("camera", camera)
    obj.location = place_m
    obj.rotation_euler = (np.radians(down_deg), 0.0, np.radians(turn_deg))
    scene.collection.objects.link(obj)
    scene.camera = obj
