"""Frames of a user's scene as plain Cycles renders them, to compare ours with."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np
from iclnuim.blender.open import missing_images, neutral_light
from iclnuim.blender.render import camera, frames
from iclnuim.geometry.se3 import SE3
from iclnuim.job import RenderJob
from iclnuim.native_output import native_output_in
from iclnuim.sensor.transfer import srgb8
from iclnuim.sequences.run_folder import load_trajectory

#: Samples of a pixel: a block has 16 times as many.
SAMPLES = 256
#: Sides of a block in pixels: much wider than Blender's filter, which spreads a pixel's samples
#: over its neighbours, and narrow enough to show a shadow in another place.
BLOCK_PX = 4
_OPEN: dict[str, Callable[..., object]] = {
    ".blend": lambda path: bpy.ops.wm.open_mainfile(filepath=path, use_scripts=False),
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path),
    ".fbx": lambda path: bpy.ops.import_scene.fbx(filepath=path),
}


def plain_frames(job: RenderJob, numbers: Sequence[int]) -> np.ndarray:
    """(n, h, w, 3) scene-linear RGB: the file as Blender's own operators open it, with the file's
    bounces and Blender's filter, not denoised. Only the light and the plain colours that we add
    where a file has none are added here too.
    """
    with tempfile.TemporaryDirectory() as folder, native_output_in(Path(folder) / "blender.log"):
        _open(job)
        raw = [frames.render(n, Path(folder) / "raw.exr", in_memory=True) for n in numbers]
        return np.array([frames.read(one, one)[0] for one in raw])


def _open(job: RenderJob) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _OPEN[Path(job.scene).suffix.lower()](job.scene)
    scene = bpy.context.scene
    _, lost_sky = missing_images.replace_missing(scene)
    neutral_light.light_up(scene, lost_sky)
    T_world_camera = load_trajectory(job).T_world_camera
    in_file = T_world_camera.translation / (job.reading.unit_m or 1.0)
    camera.keyframe(SE3(T_world_camera.rotation, in_file), job.camera)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = SAMPLES
    for switch in ("use_adaptive_sampling", "use_denoising"):
        setattr(scene.cycles, switch, False)
    for switch in ("use_freestyle", "use_compositing", "use_sequencer"):
        setattr(scene.render, switch, False)
    scene.view_layers[0].use_pass_z = True


def blocks(rgb: np.ndarray) -> np.ndarray:
    """(n, h, w, 3) scene-linear -> (n, h / 4, w / 4, 3) 8-bit sRGB of the mean light of each block,
    whose pixels are saturated one by one.
    """
    n, rows, columns, _ = rgb.shape
    parts = rgb.clip(0, 1).reshape(n, rows // BLOCK_PX, BLOCK_PX, columns // BLOCK_PX, BLOCK_PX, 3)
    return srgb8(parts.mean(axis=(2, 4)))
