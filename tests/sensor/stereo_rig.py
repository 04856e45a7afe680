"""Renders what the two imagers of a stereo camera see of a projected pattern, with Cycles.

python stereo_rig.py VIEWS.npz '{"scenes": [[[left, right, bottom, top, z], ...], ...], ...}'

The keys of the JSON: `camera` (width, height and focal length in pixels), `baseline_m`, `scenes`,
each a list of upright rectangles in metres (x right, y up, z away from the left imager). VIEWS.npz
gets `views` (scenes, 2, h, w), float32, in proportion to the light.
"""

import json
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

#: Pixels of the pattern: each dot is as large as a pixel of an imager, at any distance.
_PATTERN = 1024
_SHARE_OF_DOTS = 0.12


def rendered(camera, baseline_m, scenes):
    """The views (scenes, 2, h, w)."""
    _, _, focal_px = camera
    return np.stack(
        [
            [view(camera, baseline_m, eye * baseline_m, rectangles, seed) for eye in (0, 1)]
            for seed, rectangles in enumerate(scenes)
        ]
    )


def view(camera, baseline_m, x_m, rectangles, seed):
    """(h, w) of an imager at x_m on the baseline, whose middle is the projector's place."""
    width, height, focal_px = camera
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    add(projector(focal_px, seed), (baseline_m / 2, 0, 0))
    for left, right, bottom, top, z in rectangles:
        corners = [(left, bottom, -z), (right, bottom, -z), (right, top, -z), (left, top, -z)]
        mesh = bpy.data.meshes.new("rectangle")
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        add(mesh)
    imager = bpy.data.cameras.new("imager")
    imager.lens = imager.sensor_width * focal_px / width
    scene.camera = add(imager, (x_m, 0, 0))
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "view.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1, :, 0]


def add(data, place=(0, 0, 0)):
    """An object that looks along -z, as cameras and lamps do."""
    made = bpy.data.objects.new(data.name, data)
    made.location = place
    bpy.context.scene.collection.objects.link(made)
    return made


def projector(focal_px, seed):
    """A point-like lamp that throws a pattern of random dots."""
    dots = np.random.default_rng(seed).random((_PATTERN, _PATTERN, 1)) < _SHARE_OF_DOTS
    slide = bpy.data.images.new("pattern", _PATTERN, _PATTERN, float_buffer=True, is_data=True)
    slide.pixels.foreach_set(np.broadcast_to(dots, (_PATTERN, _PATTERN, 4)).astype("f").ravel())
    lamp = bpy.data.lights.new("projector", "SPOT")
    lamp.energy, lamp.spot_size, lamp.shadow_soft_size = 1000, 2.6, 0
    lamp.use_nodes = True
    nodes, link = lamp.node_tree.nodes, lamp.node_tree.links.new
    along = nodes.new("ShaderNodeSeparateXYZ")
    link(nodes.new("ShaderNodeTexCoord").outputs["Normal"], along.inputs[0])
    place = nodes.new("ShaderNodeCombineXYZ")
    for axis in (0, 1):
        slope = nodes.new("ShaderNodeMath")
        slope.operation = "DIVIDE"
        link(along.outputs[axis], slope.inputs[0])
        link(along.outputs[2], slope.inputs[1])
        on_slide = nodes.new("ShaderNodeMath")
        on_slide.operation = "MULTIPLY_ADD"
        link(slope.outputs[0], on_slide.inputs[0])
        on_slide.inputs[1].default_value = focal_px / _PATTERN
        on_slide.inputs[2].default_value = 0.5
        link(on_slide.outputs[0], place.inputs[axis])
    image = nodes.new("ShaderNodeTexImage")
    image.image = slide
    link(place.outputs[0], image.inputs[0])
    link(image.outputs["Color"], nodes["Emission"].inputs["Color"])
    return lamp


if __name__ == "__main__":
    np.savez(sys.argv[1], views=rendered(**json.loads(sys.argv[2])))
