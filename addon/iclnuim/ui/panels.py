"""The panel "ICL-NUIM Export" in the 3D view's sidebar. It only draws."""

import textwrap

import bpy

from ..geometry.camera import blender_from_pinhole
from . import inputs, light_state, session

_WIDTH_OF_A_LETTER_PX = 7
_MOST_NOTES = 4


def _words(layout, context, text: str, icon: str = "NONE") -> None:
    """Wrapped lines: labels do not wrap by themselves."""
    scale = context.preferences.system.ui_scale
    letters = max(int(context.region.width / scale / _WIDTH_OF_A_LETTER_PX) - 6, 16) if context.region else 40
    column = layout.column(align=True)
    column.scale_y = 0.8
    for k, line in enumerate(textwrap.wrap(text, letters) or [""]):
        column.label(text=line, icon=icon if k == 0 else ("BLANK1" if icon != "NONE" else "NONE"))


class _Panel:
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "ICL-NUIM"


class ICLNUIM_PT_main(_Panel, bpy.types.Panel):
    bl_idname, bl_label = "ICLNUIM_PT_main", "ICL-NUIM Export"

    def draw(self, context):
        self.layout.menu("ICLNUIM_MT_presets")


class _SubPanel(_Panel):
    bl_parent_id = "ICLNUIM_PT_main"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        self.content(layout, context.scene.iclnuim, context)


class ICLNUIM_PT_scene(_SubPanel, bpy.types.Panel):
    bl_label = "Scene"

    def content(self, layout, settings, context):
        layout.prop(settings, "scene_source", text="")
        if settings.scene_source == "FILE":
            layout.prop(settings, "scene_file", text="")
            for name in ("scene_up", "scene_unit", "scene_mirror", "scene_textures"):
                layout.prop(settings, name)
        if settings.scene_source != "OPEN":
            layout.operator("iclnuim.load_scene", icon="IMPORT")
            if getattr(context.space_data, "overlay", None) is not None:
                layout.prop(context.space_data.overlay, "show_extras", text="Lamp symbols")


class ICLNUIM_PT_trajectory(_SubPanel, bpy.types.Panel):
    bl_label = "Trajectory"

    def content(self, layout, settings, context):
        layout.prop(settings, "trajectory_source", text="")
        if settings.trajectory_source == "FILE":
            layout.prop(settings, "trajectory_file", text="")
        layout.prop(settings, "scale")
        layout.prop(settings, "use_start")
        if settings.use_start:
            layout.prop(settings, "start_location")
            layout.prop(settings, "start_rotation")
        layout.prop(settings, "show_path")
        held = session.current
        for line in held.path_lines:
            _words(layout, context, line)
        if held.path_warning:
            _words(layout, context, held.path_warning, "ERROR")
        row = layout.row(align=True)
        row.operator("iclnuim.keyframe", icon="KEY_HLT")
        row.operator("iclnuim.save_path", text="", icon="EXPORT")
        row.operator("iclnuim.refresh", text="", icon="FILE_REFRESH")


class ICLNUIM_PT_camera(_SubPanel, bpy.types.Panel):
    bl_label, bl_options = "Camera", {"DEFAULT_CLOSED"}

    def content(self, layout, settings, context):
        for names in (("width", "height"), ("fx", "fy"), ("cx", "cy")):
            column = layout.column(align=True)
            for name in names:
                column.prop(settings, name)
        made = blender_from_pinhole(settings.camera())
        _words(
            layout,
            context,
            f"In Blender: lens {made.lens:.3f} mm on {made.sensor_width:g} mm, shift {made.shift_x:z.4f}, {made.shift_y:z.4f}, "
            f"pixel aspect {made.pixel_aspect_x:.4f} : {made.pixel_aspect_y:.4f}",
        )


class ICLNUIM_PT_light(_SubPanel, bpy.types.Panel):
    bl_label, bl_options = "Light", {"DEFAULT_CLOSED"}

    def content(self, layout, settings, context):
        layout.prop(settings, "light", expand=True)
        for name in ("samples", "denoise", "antialias"):
            layout.prop(settings, name)
        if settings.light == "baked":
            layout.prop(settings, "map_size")
            layout.prop(settings, "map_samples")
            layout.operator("iclnuim.bake", icon="LIGHT_SUN")
            _words(layout, context, light_state.line(settings))


class ICLNUIM_PT_sensor(_SubPanel, bpy.types.Panel):
    bl_label, bl_options = "Sensor", {"DEFAULT_CLOSED"}

    def content(self, layout, settings, context):
        for name in ("depth_noise", "rgb_noise", "exposure_ms", "readout_ms", "seed"):
            layout.prop(settings, name)


class ICLNUIM_PT_output(_SubPanel, bpy.types.Panel):
    bl_label = "Output"

    def content(self, layout, settings, context):
        folder = inputs.output_folder(settings)
        row = layout.row(align=True)
        row.prop(settings, "out", text="", placeholder=inputs.DEFAULT_OUT[2:])
        shown = row.row(align=True)
        shown.enabled = folder.is_dir()
        shown.operator("wm.path_open", text="", icon="FILEBROWSER").filepath = str(folder)
        if not bpy.data.filepath and (not settings.out or settings.out.startswith("//")):
            _words(layout, context, f"until the file is saved: {folder}")
        layout.prop(settings, "frames")
        row = layout.row(align=True)
        row.prop(settings, "write_clean", toggle=True)
        row.prop(settings, "write_noisy", toggle=True)
        layout.column(align=True).prop(settings, "dialects")


class ICLNUIM_PT_render(_SubPanel, bpy.types.Panel):
    bl_label = "Render"

    def content(self, layout, settings, context):
        work = session.current.work
        column = layout.column()
        column.enabled = not work.busy
        column.operator("iclnuim.preview", icon="IMAGE_DATA")
        row = column.row(align=True)
        row.operator("iclnuim.render", icon="RENDER_ANIMATION")
        row.operator("iclnuim.resume")
        if work.busy:
            self._progress(layout, work)
            layout.operator("iclnuim.cancel", icon="CANCEL")
        if work.message:
            icon = {"failed": "ERROR", "done": "CHECKMARK"}.get(work.phase, "INFO")
            _words(layout, context, work.message, icon)
        for note in work.notes[-_MOST_NOTES:]:
            if note != work.message:
                _words(layout, context, note, "DOT")

    def _progress(self, layout, work):
        share = work.done / work.total if work.total else 0.0
        left = work.seconds_left()
        text = f"{work.done} of {work.total}" if work.total else work.phase
        layout.progress(factor=share, text=text)
        if left is not None:
            layout.label(
                text=f"{work.frames_per_second():.2f} frames/s, {_duration(left)} left, last {work.last_frame}"
            )


class ICLNUIM_PT_evaluate(_SubPanel, bpy.types.Panel):
    bl_label = "Evaluate"

    def content(self, layout, settings, context):
        for name in ("estimate", "truth", "alignment", "delta"):
            layout.prop(settings, name)
        row = layout.row(align=True)
        row.operator("iclnuim.evaluate", icon="VIEWZOOM")
        row.operator("iclnuim.plot", icon="FCURVE")
        for line in session.current.evaluation_lines:
            _words(layout, context, line)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min {rest} s"
        if minutes
        else f"{rest} s"
    )


register, unregister = bpy.utils.register_classes_factory(
    (
        ICLNUIM_PT_main,
        ICLNUIM_PT_scene,
        ICLNUIM_PT_trajectory,
        ICLNUIM_PT_camera,
        ICLNUIM_PT_light,
        ICLNUIM_PT_sensor,
        ICLNUIM_PT_output,
        ICLNUIM_PT_render,
        ICLNUIM_PT_evaluate,
    )
)
