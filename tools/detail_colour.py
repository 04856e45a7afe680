"""Renders the colours of a room without a bake and almost without noise: its only light is a point
lamp at the camera, so that one ray per pixel is enough.
"""

import time
from pathlib import Path

import bpy
import numpy as np
from iclnuim.blender.render import camera, frames, settings
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.job import RenderJob

#: White paper at 2.5 m appears at about half of white.
_POWER_W = 120.0


def by_lamp(
    room: str, views: Trajectory, pinhole: PinholeCamera, folder: Path
) -> tuple[np.ndarray, float]:
    """(n, h, w, 3) scene-linear colour of the scene in the session, and the median seconds per
    frame, without the first.

    The lamp stays in the scene. The scene's own lamps and sky are disabled; emissive materials are
    not.
    """
    job = RenderJob(
        room, room, room, pinhole, light="path", samples=1, denoise=False, lambertian=True
    )
    settings.apply(job)
    scene = bpy.context.scene
    scene.cycles.max_bounces = 0
    scene.cycles.use_light_tree = False
    scene.cycles.light_sampling_threshold = 0.0  # otherwise weak light is sampled at random
    scene.world = None
    for thing in scene.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
    camera.keyframe(views.T_world_camera, pinhole)
    name = "lamp at the camera"
    lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
    lamp.data.energy = _POWER_W
    lamp.data.shadow_soft_size = 0.0
    scene.collection.objects.link(lamp)
    lamp.parent = scene.camera
    found = []
    seconds = []
    for number in range(len(views)):
        raw = folder / "lamp.exr"
        begun = time.perf_counter()
        frames.render(number, raw)
        seconds.append(time.perf_counter() - begun)
        found.append(frames.read(raw, raw)[0])
    return np.stack(found).astype(np.float32), float(np.median(seconds[1:]))
