"""The panel "ICL-NUIM Export" in the 3D view's sidebar. It only draws."""

import textwrap
from collections.abc import Callable, Iterable

import bpy
from bpy.types import Context, Panel, PropertyGroup, UILayout

from ..errors import InputError
from ..evaluation.align import AlignmentSettings
from ..geometry.camera import PinholeCamera, blender_from_pinhole
from ..geometry.scene_axes import SceneReading
from ..job import RenderJob
from . import inputs, state
from .properties import settings_of

_LETTER_WIDTH_PX = 7
_MAX_NOTES = 4
#: Settings of a job that are not drawn under Light.
_SENSOR = ("exposure_ms", "readout_ms", "seed")
_OUTPUT = ("depth_units", "names", "glass", "ground_truth", "channels")


def _text(layout: UILayout, context: Context, text: str, icon: str = "NONE") -> None:
    """Draw the text as several labels, because Blender's labels do not wrap."""
    letters = 40
    if context.region:
        width_px = context.region.width / context.preferences.system.ui_scale
        letters = max(int(width_px / _LETTER_WIDTH_PX) - 6, 16)
    column = layout.column(align=True)
    column.scale_y = 0.8
    for line in textwrap.wrap(text, letters) or [""]:
        column.label(text=line, icon=icon)
        if icon != "NONE":
            icon = "BLANK1"


def _props(layout: UILayout, settings: PropertyGroup, names: Iterable[str]) -> None:
    for name in names:
        layout.prop(settings, name)


def _panel(
    label: str, parent: str = "ICLNUIM_PT_main", closed: bool = False
) -> Callable[..., type[Panel]]:
    """Decorator: makes the panel ICLNUIM_PT_NAME from a function NAME(layout, settings, context)
    that draws it.
    """

    def made(content: Callable[..., None]) -> type[Panel]:
        def draw(self: Panel, context: Context) -> None:
            self.layout.use_property_split = bool(parent)
            self.layout.use_property_decorate = not parent
            content(self.layout, context.scene.iclnuim, context)

        members = {
            "bl_space_type": "VIEW_3D",
            "bl_region_type": "UI",
            "bl_category": "ICL-NUIM",
            "bl_label": label,
            "bl_parent_id": parent,
            "bl_options": {"DEFAULT_CLOSED"} if closed else set(),
            "draw": draw,
        }
        return type(f"ICLNUIM_PT_{content.__name__}", (Panel,), members)

    return made


@_panel("ICL-NUIM Export", parent="")
def main(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.menu("ICLNUIM_MT_presets")


@_panel("Scene")
def scene(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "scene_source", text="")
    if settings.scene_source == "FILE":
        layout.prop(settings, "scene_file", text="")
        _props(layout, settings, settings_of(SceneReading))
    if settings.scene_source != "OPEN":
        layout.operator("iclnuim.load_scene", icon="IMPORT")
        if getattr(context.space_data, "overlay", None) is not None:
            layout.prop(context.space_data.overlay, "show_extras", text="Lamp symbols")


@_panel("Trajectory")
def trajectory(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "trajectory_source", text="")
    if settings.trajectory_source == "FILE":
        layout.prop(settings, "trajectory_file", text="")
    _props(layout, settings, ("scale", "use_start"))
    if settings.use_start:
        _props(layout, settings, ("start_location", "start_rotation"))
    layout.prop(settings, "show_path")
    panel = state.current()
    for line in panel.trajectory_lines:
        _text(layout, context, line)
    if panel.trajectory_warning:
        _text(layout, context, panel.trajectory_warning, "ERROR")
    row = layout.row(align=True)
    row.operator("iclnuim.keyframe", icon="KEY_HLT")
    row.operator("iclnuim.save_path", text="", icon="EXPORT")
    row.operator("iclnuim.refresh", text="", icon="FILE_REFRESH")


@_panel("Camera", closed=True)
def camera(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    _props(layout.column(align=True), settings, settings_of(PinholeCamera))
    try:
        made = blender_from_pinhole(settings.camera())
    except InputError as error:
        _text(layout, context, error.worded(), "ERROR")
        return
    lens = f"lens {made.lens:.3f} mm on {made.sensor_width:g} mm"
    shift = f"shift {made.shift_x:z.4f}, {made.shift_y:z.4f}"
    aspect = f"pixel aspect {made.pixel_aspect_x:.4f} : {made.pixel_aspect_y:.4f}"
    _text(layout, context, f"In Blender: {lens}, {shift}, {aspect}")


@_panel("Light", closed=True)
def light(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "light", expand=True)
    names = [name for name in settings_of(RenderJob) if name not in ("light", *_SENSOR, *_OUTPUT)]
    maps = [name for name in names if name.startswith("map_")]
    _props(layout, settings, (name for name in names if name not in maps))
    if settings.light != "path":
        _props(layout, settings, maps)
        layout.operator("iclnuim.bake", icon="LIGHT_SUN")
        _text(layout, context, inputs.light_map_line(settings))


@_panel("Sensor", closed=True)
def sensor(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    _props(layout, settings, ("depth_noise", "rgb_noise", *_SENSOR))


@_panel("Output")
def output(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    folder = inputs.output_folder(settings)
    row = layout.row(align=True)
    row.prop(settings, "out", text="", placeholder=inputs.DEFAULT_OUT[2:])
    shown = row.row(align=True)
    shown.enabled = folder.is_dir()
    shown.operator("wm.path_open", text="", icon="FILEBROWSER").filepath = str(folder)
    if not bpy.data.filepath and (not settings.out or settings.out.startswith("//")):
        _text(layout, context, f"this file is not saved yet; the output folder is {folder}")
    layout.prop(settings, "frames")
    row = layout.row(align=True)
    row.prop(settings, "write_clean", toggle=True)
    row.prop(settings, "write_noisy", toggle=True)
    layout.label(text="Formats")
    columns = layout.grid_flow(columns=2, row_major=True, even_columns=True, align=True)
    columns.use_property_split = False
    for kind in settings.bl_rna.properties["formats"].enum_items:
        columns.prop_enum(settings, "formats", kind.identifier)
    _props(layout, settings, _OUTPUT)


@_panel("Render")
def render(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    work = state.current().work
    column = layout.column()
    column.enabled = not work.busy
    column.operator("iclnuim.preview", icon="IMAGE_DATA")
    row = column.row(align=True)
    row.operator("iclnuim.render", icon="RENDER_ANIMATION")
    row.operator("iclnuim.resume")
    if work.busy:
        if work.total:
            layout.progress(factor=work.done / work.total, text=f"{work.done} of {work.total}")
        else:
            layout.progress(factor=0.0, text=work.phase)
        left_s = work.seconds_left()
        if left_s is not None:
            rate = f"{work.frames_per_second():.2f} frames/s"
            layout.label(text=f"{rate}, {_duration(left_s)} left, last {work.last_frame}")
        layout.operator("iclnuim.cancel", icon="CANCEL")
    if work.message:
        icon = {"failed": "ERROR", "done": "CHECKMARK"}.get(work.phase, "INFO")
        _text(layout, context, work.message, icon)
    for note in work.notes[-_MAX_NOTES:]:
        if note != work.message:
            _text(layout, context, note, "DOT")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


@_panel("Evaluate")
def evaluate(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    alignment = list(settings_of(AlignmentSettings))
    if settings.align_method != "yaw":
        alignment.remove("align_up")
    _props(layout, settings, ("estimate", "truth", *alignment, "delta"))
    row = layout.row(align=True)
    row.operator("iclnuim.evaluate", icon="VIEWZOOM")
    row.operator("iclnuim.plot", icon="FCURVE")
    for line in state.current().evaluation_lines:
        _text(layout, context, line)


_PANELS = (main, scene, trajectory, camera, light, sensor, output, render, evaluate)
register, unregister = bpy.utils.register_classes_factory(_PANELS)
