"""The office's light."""

from __future__ import annotations

import bpy
import numpy as np

from .office_measures import LOW, LUMINAIRES, Z1

POWER_W = 15.5  # of a luminaire's pair of panels
SPREAD_DEG = 172.0  # the louvers block light to the top of the walls


def light() -> None:
    """One rectangle 1 mm beneath each luminaire's frame, invisible to the camera and in
    reflections, which show the emitting panels instead.
    """
    for k, (x, y) in enumerate(LUMINAIRES, 1):
        data = bpy.data.lights.new(f"luminaire_light_{k}", "AREA")
        data.shape = "RECTANGLE"
        data.size = 0.94
        data.size_y = 0.44
        data.energy = POWER_W
        data.color = (1.0, 0.985, 0.90)
        data.spread = np.radians(SPREAD_DEG)
        obj = bpy.data.objects.new(data.name, data)
        obj.location = (x, y, Z1 - LOW - 0.001)
        obj.visible_camera = obj.visible_glossy = False
        bpy.context.scene.collection.objects.link(obj)
    world = bpy.data.worlds.new("dark")
    if world.node_tree is None:
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    bpy.context.scene.world = world
