"""The panel "ICL-NUIM Export" in the 3D view's sidebar. It only draws."""

import textwrap
from collections.abc import Callable, Iterable, Mapping
from datetime import timedelta

import bpy
from bpy.types import Context, Panel, PropertyGroup, UILayout

from ..errors import InputError
from ..evaluation.align import AlignmentSettings
from ..geometry.camera import PinholeCamera, blender_from_pinhole
from ..geometry.scene_axes import SceneReading
from ..job import RenderJob
from ..settings import Setting
from ..shipped import SCENES
from . import inputs, state, trajectory_view
from .properties import settings_of
from .work import Work

_LETTER_WIDTH_PX = 7
_MAX_NOTES = 4
#: Width of Blender's labels where properties are split.
_LABEL_SHARE = 0.4
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
    for line in textwrap.wrap(state.sentence(text), letters):
        column.label(text=line, icon=icon)
        if icon != "NONE":
            icon = "BLANK1"


def _props(layout: UILayout, settings: PropertyGroup, names: Iterable[str]) -> None:
    for name in names:
        layout.prop(settings, name)


def _numbers_or_auto(
    layout: UILayout, settings: PropertyGroup, declared: Mapping[str, Setting]
) -> None:
    """Settings as _props draws them; a number of 0, which means the default, as Auto."""
    for name, s in declared.items():
        if s.kind is not int or not s.optional:
            layout.prop(settings, name)
            continue
        value = getattr(settings, name)
        if value:
            row = layout.row(align=True)
            row.prop(settings, name)
            auto = row.operator("wm.context_set_int", text="", icon="LOOP_BACK")
        else:
            row = layout.split(factor=_LABEL_SHARE)
            row.alignment = "RIGHT"
            row.label(text=s.label)
            auto = row.operator("wm.context_set_int", text="Auto")
        auto.data_path = f"scene.iclnuim.{name}"
        auto.value = int(not value)


def _panel(
    label: str, parent: str = "ICLNUIM_PT_main", closed: bool = False, region: str = "UI"
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
            "bl_region_type": region,
            "bl_label": label,
            "bl_parent_id": parent,
            "bl_options": {"DEFAULT_CLOSED"} if closed else set(),
            "draw": draw,
        }
        if region == "UI":
            members["bl_category"] = "ICL-NUIM"
        return type(f"ICLNUIM_PT_{content.__name__}", (Panel,), members)

    return made


@_panel("ICL-NUIM Export", parent="")
def main(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    trajectory_view.begin()
    layout.menu("ICLNUIM_MT_presets")
    column = layout.column(align=True)
    preview = f"Preview Pose {inputs.current_pose(context)}"
    column.operator("iclnuim.preview", text=preview, icon="IMAGE_DATA")
    row = column.row(align=True)
    row.operator("iclnuim.render", icon="RENDER_ANIMATION")
    row.operator("iclnuim.resume")
    work = state.current().work
    if work.busy:
        _progress(layout, work)
    if work.message:
        icon = {"failed": "ERROR", "done": "CHECKMARK"}.get(work.phase, "INFO")
        _text(layout, context, work.message, icon)
    for note in work.notes[-_MAX_NOTES:]:
        if note != work.message:
            _text(layout, context, note, "DOT")


def _progress(layout: UILayout, work: Work) -> None:
    share = work.done / max(work.total, 1)
    text = state.sentence(work.phase)
    if work.total > 1:
        text += f": {work.done} of {work.total} frames"
    if work.phase in ("starting", "preparing"):
        text += f" ({work.seconds_here():.0f} s)"
    layout.progress(factor=share, text=text)
    left_s = work.seconds_left()
    if left_s is not None:
        rate = f"{work.frames_per_second():.2f} frames/s"
        layout.label(text=f"{rate}, {timedelta(seconds=round(left_s))} left")
    layout.operator("iclnuim.cancel", icon="CANCEL")


@_panel("Scene")
def scene(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "scene_source", text="")
    if settings.scene_source == "FILE":
        layout.prop(settings, "scene_file", text="")
        _props(layout, settings, settings_of(SceneReading))
    row = layout.row(align=True)
    row.operator("iclnuim.load_scene", icon="IMPORT")
    row.operator("iclnuim.remove_scene", icon="X")


@_panel("Trajectory")
def trajectory(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "trajectory_source", text="")
    if settings.trajectory_source == "FILE":
        layout.prop(settings, "trajectory_file", text="")
    if settings.scene_source not in SCENES:
        layout.operator("iclnuim.make_path", icon="CON_FOLLOWPATH")
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
    try:
        used = settings.camera()
        made = blender_from_pinhole(used)
    except InputError as error:
        _props(layout.column(align=True), settings, settings_of(PinholeCamera))
        _text(layout, context, error.worded(), "ERROR")
        return
    if settings.has_own_lens():
        size = f"{used.width} x {used.height}, fx {used.fx:.2f}, fy {used.fy:.2f} pixels"
        _text(layout, context, f"The active camera's lens, the render's size: {size}")
    else:
        _props(layout.column(align=True), settings, settings_of(PinholeCamera))
    lens = f"lens {made.lens:.3f} mm on {made.sensor_width:g} mm"
    shift = f"shift {made.shift_x:z.4f}, {made.shift_y:z.4f}"
    aspect = f"pixel aspect {made.pixel_aspect_x:.4f} : {made.pixel_aspect_y:.4f}"
    _text(layout, context, f"In Blender: {lens}, {shift}, {aspect}")


@_panel("Light", closed=True)
def light(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    layout.prop(settings, "light", expand=True)
    shown = settings_of(RenderJob)
    for name in ("light", *_SENSOR, *_OUTPUT):
        shown.pop(name, None)
    if settings.light == "path":
        del shown["map_size"], shown["map_samples"]
    if settings.light != "auto":
        del shown["quality"]
    _numbers_or_auto(layout, settings, shown)
    if settings.light != "path":
        layout.operator("iclnuim.bake", icon="LIGHT_SUN")
        _text(layout, context, inputs.light_map_line(settings))


@_panel("Sensor", closed=True)
def sensor(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    _props(layout, settings, ("depth_noise", "rgb_noise", *_SENSOR))


@_panel("Output")
def output(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    row = layout.row(align=True)
    row.prop(settings, "out", text="", placeholder=inputs.DEFAULT_OUT[2:])
    row.operator("iclnuim.open_folder", text="", icon="WINDOW")
    layout.operator("iclnuim.view", icon="URL")
    if not bpy.data.filepath and (not settings.out or settings.out.startswith("//")):
        _text(layout, context, "this file is not saved yet: Render asks for a folder")
    layout.prop(settings, "frames")
    row = layout.row(align=True)
    row.prop(settings, "write_clean", toggle=True)
    row.prop(settings, "write_noisy", toggle=True)
    for name in ("formats", "channels"):  # several values: in menus
        row = layout.row(heading=settings.bl_rna.properties[name].name)
        chosen = ", ".join(sorted(getattr(settings, name))) or "None"
        row.popover(f"ICLNUIM_PT_{name}", text=chosen)
    _props(layout, settings, _OUTPUT[:-1])


@_panel("Formats", parent="", region="HEADER")
def formats(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    _several(layout, settings, "formats")


@_panel("Channels", parent="", region="HEADER")
def channels(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    _several(layout, settings, "channels")


def _several(layout: UILayout, settings: PropertyGroup, name: str) -> None:
    layout.label(text="Shift-click for several")
    layout.column().prop(settings, name)


@_panel("Evaluate", closed=True)
def evaluate(layout: UILayout, settings: PropertyGroup, context: Context) -> None:
    alignment = settings_of(AlignmentSettings)
    if settings.align_method != "yaw":
        del alignment["align_up"]
    _props(layout, settings, ("estimate", "truth"))
    _numbers_or_auto(layout, settings, alignment)
    layout.prop(settings, "delta")
    row = layout.row(align=True)
    row.operator("iclnuim.evaluate", icon="VIEWZOOM")
    row.operator("iclnuim.plot", icon="FCURVE")
    panel = state.current()
    for line in panel.evaluation_lines:
        _text(layout, context, line)
    for line in panel.evaluation_warnings:
        _text(layout, context, line, "ERROR")


_PANELS = (main, scene, trajectory, camera, light, sensor, output, formats, channels, evaluate)
register, unregister = bpy.utils.register_classes_factory(_PANELS)
