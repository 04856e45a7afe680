"""The office's light, and the settings its file opens with."""

from __future__ import annotations

import bpy
import numpy as np

from .office_measures import LUMINAIRES, Z1

POWER_W = 14.5  # of a luminaire's pair of panels
SPREAD_DEG = 172.0  # the louvers keep light from the very top of the walls


def light() -> None:
    """One rectangle beneath each luminaire; unseen by the camera and by reflections, which show the glowing panels instead."""
    for k, (x, y) in enumerate(LUMINAIRES, 1):
        data = bpy.data.lights.new(f"luminaire_light_{k}", "AREA")
        data.shape, data.size, data.size_y = "RECTANGLE", 0.94, 0.44
        data.energy, data.color, data.spread = POWER_W, (1.0, 0.985, 0.90), np.radians(SPREAD_DEG)
        obj = bpy.data.objects.new(data.name, data)
        obj.location = (x, y, Z1 - 0.006)
        obj.visible_camera = obj.visible_glossy = False
        bpy.context.scene.collection.objects.link(obj)
    world = bpy.data.worlds.new("dark")
    if world.node_tree is None:
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    bpy.context.scene.world = world


def defaults() -> None:
    """Render settings that the file opens with; a camera stands in the middle."""
    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = "CYCLES", "//"
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 640, 480, 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1.0, 481.2 / 480.0
    scene.unit_settings.system = "METRIC"
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", 36.0, 481.2 * 36.0 / 640
    camera.clip_start, camera.clip_end = 0.01, 100.0
    obj = bpy.data.objects.new("camera", camera)
    obj.location, obj.rotation_euler = (0.6, 1.2, 4.55), (np.radians(80), 0.0, np.radians(168))
    scene.collection.objects.link(obj)
    scene.camera = obj
