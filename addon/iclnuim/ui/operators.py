"""The panel's operators that render and evaluate: bake, preview, render, cancel, resume.

A worker process renders.
"""

import functools
import shutil
import tempfile
from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy.types import Context, Event, Operator, WindowManager

from ..errors import IclnuimError, InputError, WorkError
from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings
from ..evaluation.align import AlignmentSettings
from ..evaluation.relative_error import RelativeErrorSettings, parse_delta, relative_error
from ..geometry.trajectory import frame_slice
from ..job import RenderJob
from ..report.trajectory_report import ComparedFile, Report
from ..report.view import gather
from ..report.view.page import write_page
from ..sequences.frame_images import noisy_images
from ..sequences.frame_source import read_frame
from ..sequences.pose_lines import tied_to_poses
from ..sequences.run_folder import read_run
from ..sequences.sequence_options import SequenceOptions
from ..trajectory_files.trajectories import LoadedTrajectory, read_trajectory
from . import image_editor, inputs, pictures, state, trajectory_view
from .state import operator

_CAN_RENDER = state.idle, inputs.check_scene, inputs.check_trajectory
PREVIEW = "ICL-NUIM preview"
PLOT = "ICL-NUIM error"


@operator("Bake Light", state.idle, inputs.check_scene)
def bake(self: Operator, context: Context) -> None:
    """Bake the scene's light map into the extension's cache, in the background.

    A render also bakes it if it is missing
    """
    folder = Path(tempfile.mkdtemp(dir=state.user_folder("preview")))
    job = inputs.job(context, folder).changed(light="baked")
    finish = functools.partial(shutil.rmtree, folder, ignore_errors=True)
    baked = "the light map is baked and is in the cache"
    state.start("bake", job, folder / "raw", {"bake": True}, baked, finish)


def _ask_for_a_folder(self: Operator, context: Context, event: Event) -> set[str]:
    try:
        inputs.output_folder(context.scene.iclnuim)
    except InputError:  # the file is not saved yet
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}
    return self.execute(context)


@operator(
    "Render",
    *_CAN_RENDER,
    invoke=_ask_for_a_folder,
    directory=StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"}),
)
def render(self: Operator, context: Context) -> None:
    """Render the chosen frames in a second Blender process, then write the sequences.

    Finished frames are skipped
    """
    settings = context.scene.iclnuim
    if self.directory:
        settings.out = str(Path(self.directory) / "iclnuim")
    out = inputs.output_folder(settings)
    numbers = list(frame_slice(settings.frames, len(inputs.trajectory(context).trajectory)))
    _render(inputs.job(context, out), out, numbers, settings.sequences(out))


@operator("Resume", state.idle, inputs.run_to_resume)
def resume(self: Operator, context: Context) -> None:
    """Continue the render in the output folder, with the settings that it was started with"""
    settings = context.scene.iclnuim
    raw = inputs.run_to_resume(context)
    inputs.check_free(raw)
    run = read_run(raw)
    asked = settings.reading().allow_outside
    run.job.reading.check_asked(asked, raw / "sequence.json")
    numbers = list(frame_slice(settings.frames, len(run.truth())))
    _render(run.job, raw.parent, numbers, settings.sequences(raw.parent))


@operator("Open Folder", inputs.existing_output)
def open_folder(self: Operator, context: Context) -> None:
    """Open the output folder in the file manager"""
    folder = inputs.existing_output(context)
    bpy.ops.wm.path_open(filepath=str(folder))
    # without a file manager, Blender says nothing
    state.current().work.message = f"the output folder is {folder}"


@operator("View in a Browser", state.idle, inputs.folders_to_view)
def view(self: Operator, context: Context) -> None:
    """Show images, depth and the camera's path of the output in a page, view.html, beside the
    estimate if one is chosen
    """
    settings = context.scene.iclnuim
    folders = inputs.folders_to_view(context)
    page = folders[0].parent / "view.html"
    alignment = AlignmentSettings(**settings.values_of(AlignmentSettings))
    estimates = []
    if settings.estimate:
        estimates.append((Path(settings.estimate).name, read_trajectory(_estimate(context))))
    read = [gather.read_sequence(folder, folder.name) for folder in folders]
    error_settings = AbsoluteErrorSettings(alignment=alignment)
    contents = gather.gathered(page.parent.name, read, estimates, error_settings)
    manager = context.window_manager
    notes = write_page(page, contents, progress=functools.partial(_PointerProgress, manager))
    manager.progress_end()
    bpy.ops.wm.url_open(url=page.as_uri())
    work = state.current().work
    work.message = f"the page is {page}"  # where there is no browser, Blender says nothing
    work.notes += [*contents.notes, *notes]


class _PointerProgress:
    """Progress beside the mouse pointer."""

    def __init__(self, manager: WindowManager, total: int, label: str) -> None:
        self._manager = manager
        self._done = 0
        manager.progress_begin(0, total)

    def advance(self) -> None:
        self._done += 1
        self._manager.progress_update(self._done)


def _busy(context: Context) -> None:
    if not state.current().work.busy:
        raise WorkError("nothing is running")


@operator("Cancel", _busy)
def cancel(self: Operator, context: Context) -> None:
    """Stop after the current frame. Finished frames stay, and Resume continues after them"""
    state.current().work.cancel()


@operator("Preview Pose", *_CAN_RENDER)
def preview(self: Operator, context: Context) -> None:
    """Render the pose at the timeline's current frame.

    Colour and depth are shown without noise above and with the sensor's noise below
    """
    settings = context.scene.iclnuim
    folder = Path(tempfile.mkdtemp(dir=state.user_folder("preview")))
    count = len(inputs.trajectory(context).trajectory)
    number = min(inputs.current_pose(context), count - 1)
    options = SequenceOptions(**settings.values_of(SequenceOptions))
    sensor = options.sequence_settings()
    job = inputs.job(context, folder)

    def finish() -> None:
        light, depth_z_m = read_frame(folder / "raw" / "exr" / f"{number:06}.exr", job.camera)
        clean = noisy_images(light, depth_z_m, job.camera, number, options.without_noise())[0]
        noisy, units, _ = noisy_images(light, depth_z_m, job.camera, number, sensor)
        shutil.rmtree(folder, ignore_errors=True)
        noisy_z_m = units / sensor.depth_units_per_metre
        picture = pictures.frame_picture(clean, depth_z_m, noisy, noisy_z_m)
        image_editor.show(bpy.context, PREVIEW, picture)
        state.current().work.message = f"pose {number} is shown in the image editor as “{PREVIEW}”"

    command = {"frames": [number]}
    state.start("preview", job, folder / "raw", command, "the preview is rendered", finish)


def _mm(metres: float) -> str:
    return f"{1000 * metres:.3f} mm"


def _estimate(context: Context) -> str:
    estimate = context.scene.iclnuim.estimate
    if not estimate:
        hint = "choosing a file as {estimate}"
        raise InputError("an estimated trajectory", found="none", hint=hint)
    return bpy.path.abspath(estimate)


@operator("Evaluate", _estimate)
def evaluate(self: Operator, context: Context) -> None:
    """Compute ATE and RPE of the estimate, and draw it: blue for no error, red for the largest
    error
    """
    panel = state.current()
    panel.evaluation, panel.evaluation_lines = None, []
    try:
        _evaluate(context)
    except IclnuimError as error:  # also below the button, from where the top is out of sight
        panel.evaluation_warnings = [error.worded(panel.work.name_of)]
        raise


def _evaluate(context: Context) -> None:
    settings = context.scene.iclnuim
    panel = state.current()
    if settings.truth:
        reference = read_trajectory(bpy.path.abspath(settings.truth))
    else:
        reference = inputs.trajectory(context)
    reference, estimate = tied_to_poses(reference, read_trajectory(_estimate(context)))
    alignment = AlignmentSettings(**settings.values_of(AlignmentSettings))
    files = ComparedFile("ground truth", reference), ComparedFile(settings.estimate, estimate)
    report = Report.of(*files, AbsoluteErrorSettings(alignment=alignment))
    assert isinstance(report.result, AbsoluteError)
    ate = panel.evaluation = report.result
    panel.evaluation_warnings = report.warnings
    position = ate.translation_m
    panel.evaluation_lines = [
        f"ATE rmse {_mm(position.rmse)}",
        f"median {_mm(position.median)}, max {_mm(position.max)}",
        f"rotation rmse {ate.rotation_deg.rmse:.3f} deg",
        f"RPE over {settings.delta}: {_drift(reference, estimate, settings.delta)}",
        f"{len(ate.stamps_s)} pairs, {100 * ate.completeness.coverage:.0f} % of the ground truth",
    ]
    trajectory_view.show_estimate(ate.aligned.translation, ate.translation_error_m)
    state.redraw()


def _drift(reference: LoadedTrajectory, estimate: LoadedTrajectory, delta: str) -> str:
    """The RPE, or that no poses are so far apart: single frames of a trajectory have an ATE."""
    over = RelativeErrorSettings(*parse_delta(delta))
    try:
        rpe = relative_error(reference.trajectory, estimate.trajectory, over)
    except InputError as error:
        return f"none, {error.worded(state.current().work.name_of)}"
    return f"{_mm(rpe.translation_m.rmse)}, {rpe.rotation_deg.rmse:.3f} deg"


def _evaluation(context: Context) -> AbsoluteError:
    ate = state.current().evaluation
    if ate is None:
        raise InputError("an evaluation to plot", found="none", hint="Evaluate first")
    return ate


@operator("Show the Plot", _evaluation)
def plot(self: Operator, context: Context) -> None:
    """Show a plot of the position error over time in the image editor"""
    ate = _evaluation(context)
    plot = pictures.error_plot(ate.stamps_s, ate.translation_error_m, ate.translation_m.rmse)
    image_editor.show(context, PLOT, plot)


def _render(job: RenderJob, out: Path, numbers: list[int], sequences: dict | None) -> None:
    frames = "1 frame is" if len(numbers) == 1 else f"{len(numbers)} frames are"
    when_done = f"{frames} in {out / 'raw'}"
    if sequences is not None:
        names = [Path(folder).name for folder in sequences["variants"]]
        when_done += f"; sequences: {', '.join(names)}"
    look = image_editor.LastFrame(out / "raw/exr", job.camera).look
    command = {"frames": numbers, "sequences": sequences}
    state.start("render", job, out / "raw", command, when_done, on_tick=look)


_OPERATORS = (
    bake,
    render,
    resume,
    open_folder,
    view,
    cancel,
    preview,
    evaluate,
    plot,
)
register, unregister = bpy.utils.register_classes_factory(_OPERATORS)
