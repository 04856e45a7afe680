"""Operators of rendering: bake, preview, render, cancel, resume. Each only describes a task and hands it to the child."""

import functools
import shutil
import tempfile
from pathlib import Path

import bpy

from ..dataset.frames import read_frame
from ..dataset.sequence import SequenceSettings, noisy_images
from ..errors import InputError
from ..formats.files import read_json
from ..formats.trajectories import read_trajectory
from ..job import RenderJob
from ..sensor.models import depth_model, rgb_model
from . import images, inputs, session
from .last_frame import LastFrame
from .messages import in_words
from .pictures import frame_picture

PREVIEW = "ICL-NUIM preview"


class ICLNUIM_OT_bake(bpy.types.Operator):
    """Bake the scene's light map into the extension's cache, in the background; a render does it too where it is missing"""

    bl_idname, bl_label = "iclnuim.bake", "Bake Light"

    @in_words
    def execute(self, context):
        folder = _own_folder()
        job = inputs.job(context, folder).changed(light="baked")
        finish = functools.partial(shutil.rmtree, folder, ignore_errors=True)
        session.start("bake", job, folder / "raw", {"bake": True}, "the light is baked and lies in the cache", finish)


class ICLNUIM_OT_render(bpy.types.Operator):
    """Render the frames asked for in a child Blender, then write the sequences; finished frames are skipped"""

    bl_idname, bl_label = "iclnuim.render", "Render"

    @in_words
    def execute(self, context):
        settings = context.scene.iclnuim
        out = inputs.output_folder(settings)
        numbers = settings.frame_numbers(len(inputs.trajectory(context)[0]))
        _render(inputs.job(context, out), out, numbers, settings.sequences(out))


class ICLNUIM_OT_resume(bpy.types.Operator):
    """Go on with the render that lies in the output folder, with the settings it was begun with"""

    bl_idname, bl_label = "iclnuim.resume", "Resume"

    @in_words
    def execute(self, context):
        settings = context.scene.iclnuim
        out = inputs.output_folder(settings)
        recipe = out / "raw" / "sequence.json"
        if not recipe.is_file():
            raise InputError(
                "a render to go on with", path=recipe.parent, found="none", hint="Render, or the Folder it was begun in"
            )
        inputs.check_free(out / "raw")
        job = RenderJob.from_dict(read_json(recipe).get("job", {}))
        poses = read_trajectory(out / "raw" / "groundtruth.txt", "tum").trajectory
        _render(job, out, settings.frame_numbers(len(poses)), settings.sequences(out))


class ICLNUIM_OT_cancel(bpy.types.Operator):
    """Stop after the frame in work; finished frames stay, and Resume goes on from there"""

    bl_idname, bl_label = "iclnuim.cancel", "Cancel"

    def execute(self, context):
        session.current.work.cancel()
        session.redraw()
        return {"FINISHED"}


class ICLNUIM_OT_preview(bpy.types.Operator):
    """Render the timeline's current frame of the path, and show colour and depth, clean above and as the sensor sees them below"""

    bl_idname, bl_label = "iclnuim.preview", "Preview Frame"

    @in_words
    def execute(self, context):
        settings = context.scene.iclnuim
        folder = _own_folder()
        chosen = inputs.trajectory(context)[0]
        number = min(max(context.scene.frame_current, 0), len(chosen) - 1)
        sensor = SequenceSettings(depth_model(settings.depth_noise), rgb_model(settings.rgb_noise), settings.seed)
        job = inputs.job(context, folder)

        def finish() -> None:
            light, depth_z_m = read_frame(folder / "raw" / "exr" / f"{number:06}.exr", job.camera)
            clean = noisy_images(light, depth_z_m, job.camera, number, SequenceSettings())[0]
            noisy, units, _ = noisy_images(light, depth_z_m, job.camera, number, sensor)
            shutil.rmtree(folder, ignore_errors=True)
            picture = frame_picture(clean, depth_z_m, noisy, units / sensor.depth_units_per_metre)
            images.show(bpy.context, PREVIEW, picture)
            session.current.work.message = f"frame {number} stands in the image editor as “{PREVIEW}”"

        session.start("preview", job, folder / "raw", {"frames": [number]}, "the preview is rendered", finish)


def _own_folder() -> Path:
    """A new folder for what is soon thrown away; all of them go when the extension is switched off."""
    return Path(tempfile.mkdtemp(dir=session.user_folder("preview")))


def _render(job: RenderJob, out: Path, numbers: list[int], sequences: dict | None) -> None:
    when_done = f"{len(numbers)} frames are" if len(numbers) != 1 else "1 frame is"
    when_done += f" in {out / 'raw'}"
    if sequences is not None:
        when_done += "; sequences: " + ", ".join(Path(folder).name for folder in sequences["variants"])
    session.start(
        "render",
        job,
        out / "raw",
        {"frames": numbers, "sequences": sequences},
        when_done,
        on_tick=LastFrame(out / "raw/exr", job.camera).look,
    )


register, unregister = bpy.utils.register_classes_factory(
    (ICLNUIM_OT_bake, ICLNUIM_OT_render, ICLNUIM_OT_resume, ICLNUIM_OT_cancel, ICLNUIM_OT_preview)
)
