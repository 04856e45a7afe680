"""Operators of rendering: bake, preview, render, cancel, resume. Each describes a task and hands it to the worker process."""

import functools
import shutil
import tempfile
from pathlib import Path

import bpy

from ..dataset.frames import read_frame
from ..dataset.sequence import noisy_images
from ..dataset.sequence_options import SequenceOptions
from ..errors import InputError
from ..formats.files import read_json
from ..formats.trajectories import read_trajectory
from ..job import RenderJob
from . import image_editor, inputs, state
from .image_editor import LastFrame
from .pictures import frame_picture
from .state import reported

PREVIEW = "ICL-NUIM preview"


class ICLNUIM_OT_bake(bpy.types.Operator):
    """Bake the scene's light map into the extension's cache, in the background; a render does it too where it is missing"""

    bl_idname, bl_label = "iclnuim.bake", "Bake Light"

    @reported
    def execute(self, context):
        folder = _own_folder()
        job = inputs.job(context, folder).changed(light="baked")
        finish = functools.partial(shutil.rmtree, folder, ignore_errors=True)
        state.start("bake", job, folder / "raw", {"bake": True}, "the light is baked and is in the cache", finish)


class ICLNUIM_OT_render(bpy.types.Operator):
    """Render the chosen frames in a second Blender, then write the sequences; finished frames are skipped"""

    bl_idname, bl_label = "iclnuim.render", "Render"

    @reported
    def execute(self, context):
        settings = context.scene.iclnuim
        out = inputs.output_folder(settings)
        numbers = settings.frame_numbers(len(inputs.trajectory(context)[0]))
        _render(inputs.job(context, out), out, numbers, settings.sequences(out))


class ICLNUIM_OT_resume(bpy.types.Operator):
    """Continue the render in the output folder with the settings it was started with"""

    bl_idname, bl_label = "iclnuim.resume", "Resume"

    @reported
    def execute(self, context):
        settings = context.scene.iclnuim
        out = inputs.output_folder(settings)
        recipe = out / "raw" / "sequence.json"
        if not recipe.is_file():
            raise InputError(
                "a render to resume", path=recipe.parent, found="none", hint="Render, or the {out} it was started in"
            )
        inputs.check_free(out / "raw")
        job = RenderJob.from_dict(read_json(recipe).get("job", {}))
        poses = read_trajectory(out / "raw" / "groundtruth.txt", "tum").trajectory
        _render(job, out, settings.frame_numbers(len(poses)), settings.sequences(out))


class ICLNUIM_OT_cancel(bpy.types.Operator):
    """Stop after the current frame; finished frames stay, and Resume continues from there"""

    bl_idname, bl_label = "iclnuim.cancel", "Cancel"

    def execute(self, context):
        state.current().work.cancel()
        state.redraw()
        return {"FINISHED"}


class ICLNUIM_OT_preview(bpy.types.Operator):
    """Render the pose of the timeline's current frame, and show colour and depth, clean above and with the sensor's noise below"""

    bl_idname, bl_label = "iclnuim.preview", "Preview Frame"

    @reported
    def execute(self, context):
        settings = context.scene.iclnuim
        folder = _own_folder()
        chosen = inputs.trajectory(context)[0]
        number = min(max(context.scene.frame_current, 0), len(chosen) - 1)
        options = SequenceOptions(**settings.values_of(SequenceOptions))
        sensor = options.sequence_settings()
        job = inputs.job(context, folder)

        def finish() -> None:
            light, depth_z_m = read_frame(folder / "raw" / "exr" / f"{number:06}.exr", job.camera)
            clean = noisy_images(light, depth_z_m, job.camera, number, options.without_noise())[0]
            noisy, units, _ = noisy_images(light, depth_z_m, job.camera, number, sensor)
            shutil.rmtree(folder, ignore_errors=True)
            picture = frame_picture(clean, depth_z_m, noisy, units / sensor.depth_units_per_metre)
            image_editor.show(bpy.context, PREVIEW, picture)
            state.current().work.message = f"frame {number} is shown in the image editor as “{PREVIEW}”"

        state.start("preview", job, folder / "raw", {"frames": [number]}, "the preview is rendered", finish)


def _own_folder() -> Path:
    """A new temporary folder; all of them are removed when the extension is switched off."""
    return Path(tempfile.mkdtemp(dir=state.user_folder("preview")))


def _render(job: RenderJob, out: Path, numbers: list[int], sequences: dict | None) -> None:
    when_done = f"{len(numbers)} frames are" if len(numbers) != 1 else "1 frame is"
    when_done += f" in {out / 'raw'}"
    if sequences is not None:
        when_done += "; sequences: " + ", ".join(Path(folder).name for folder in sequences["variants"])
    state.start(
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
