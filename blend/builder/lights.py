"""Lights of a scene: sun, sky, ceiling spots, lamps; few, soft and easy to sample."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

Place = tuple[float, float, float]


def _add(
    name: str, data: bpy.types.Light, location: Place, towards: Place | None = None
) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, data)
    obj.location = location
    if towards is not None:
        obj.rotation_euler = (
            (Vector(towards) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
        )
    bpy.context.scene.collection.objects.link(obj)
    return obj


def sun(
    name: str,
    azimuth_deg: float,
    elevation_deg: float,
    strength: float,
    colour: Place,
    angle_deg: float = 0.9,
) -> bpy.types.Object:
    """A sun standing in direction azimuth (counter-clockwise from +x) and elevation; strength is
    irradiance in W/m2.
    """
    a, e = np.radians([azimuth_deg, elevation_deg])
    direction = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    data = bpy.data.lights.new(name, "SUN")
    data.energy = strength
    data.color = colour
    data.angle = np.radians(angle_deg)
    return _add(name, data, tuple(10 * direction), (0.0, 0.0, 0.0))


def spot(
    name: str,
    location: Place,
    towards: Place,
    power: float,
    colour: Place,
    cone_deg: float,
    soft: float,
    radius: float,
) -> bpy.types.Object:
    data = bpy.data.lights.new(name, "SPOT")
    data.energy = power
    data.color = colour
    data.shadow_soft_size = radius
    data.spot_size = np.radians(cone_deg)
    data.spot_blend = soft
    return _unseen(_add(name, data, location, towards))


def lamp(
    name: str, location: Place, power: float, colour: Place, radius: float
) -> bpy.types.Object:
    data = bpy.data.lights.new(name, "POINT")
    data.energy = power
    data.color = colour
    data.shadow_soft_size = radius
    return _unseen(_add(name, data, location))


def _unseen(light: bpy.types.Object) -> bpy.types.Object:
    """Hide a lamp from the camera and from reflections: there, in floors and screens too, the
    emission of its fitting is visible instead.
    """
    light.visible_camera = light.visible_glossy = False
    return light


def portal(
    name: str, location: Place, towards: Place, width: float, height: float
) -> bpy.types.Object:
    """A portal: an opening through which the sky is sampled. It emits no light."""
    data = bpy.data.lights.new(name, "AREA")
    data.shape = "RECTANGLE"
    data.size = width
    data.size_y = height
    data.cycles.is_portal = True
    return _add(name, data, location, towards)


def daylight(
    name: str,
    location: Place,
    towards: Place,
    width: float,
    height: float,
    power: float,
    colour: Place,
) -> bpy.types.Object:
    """A soft rectangle outside a window for the light of sky and street that the painted
    surroundings do not emit; invisible to the camera.
    """
    data = bpy.data.lights.new(name, "AREA")
    data.shape = "RECTANGLE"
    data.size = width
    data.size_y = height
    data.energy = power
    data.color = colour
    obj = _add(name, data, location, towards)
    obj.visible_camera = False
    obj.visible_glossy = False
    return obj


def sky(image: bpy.types.Image, strength: float) -> None:
    """The world: an equirectangular image around the scene."""
    world = bpy.data.worlds.new("sky")
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    background = tree.nodes.new("ShaderNodeBackground")
    out = tree.nodes.new("ShaderNodeOutputWorld")
    texture.image = image
    background.inputs["Strength"].default_value = strength
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs[0], out.inputs["Surface"])
    bpy.context.scene.world = world
