"""Presets: ready-made settings, and the user's own as JSON files in the extension's folder."""

import json
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..errors import InputError
from ..formats.files import read_json, write_json
from . import session
from .messages import in_words

SHIPPED = {
    "Benchmark": {},
    "Quick look": {
        "width": 320,
        "height": 240,
        "fx": 320 / 1.33,
        "fy": 240.0,
        "cx": 159.5,
        "cy": 119.5,
        "light": "path",
        "samples": 4,
        "frames": "::60",
    },
    "Reference, path traced": {"light": "path", "samples": 256, "frames": "::"},
}
#: Of this file or this machine, not of a preset.
_OWN = {
    "rna_type",
    "name",
    "out",
    "scene_file",
    "scene_up",
    "scene_unit",
    "scene_mirror",
    "scene_textures",
    "trajectory_file",
    "estimate",
    "truth",
    "scene_source",
    "trajectory_source",
}


def values(settings) -> dict:
    """Settings as plain values."""
    return {
        p.identifier: _plain(getattr(settings, p.identifier))
        for p in settings.bl_rna.properties
        if p.identifier not in _OWN
    }


def apply(settings, chosen: dict) -> None:
    """Set what a preset names, the rest to its default. Raises InputError for an unknown name or value."""
    known = {p.identifier: p for p in settings.bl_rna.properties if p.identifier not in _OWN}
    unknown = sorted(set(chosen) - set(known))
    if unknown:
        raise InputError(f"a preset of {', '.join(known)}", found=", ".join(unknown))
    for name in known:
        settings.property_unset(name)
    for name, value in chosen.items():
        try:
            setattr(settings, name, set(value) if name == "dialects" else value)
        except (TypeError, ValueError) as error:
            raise InputError(f"a value for {name}", found=error) from None


def own() -> dict[str, Path]:
    """The user's presets by name."""
    return {path.stem: path for path in sorted(session.user_folder("presets").glob("*.json"))}


def _plain(value):
    if isinstance(value, (bool, int, float, str)):
        return value
    return sorted(value) if isinstance(value, set) else list(value)


class ICLNUIM_OT_preset(bpy.types.Operator):
    """Take over the settings of a preset (folder, files, scene and trajectory stay)"""

    bl_idname, bl_label, bl_options = "iclnuim.preset", "Use Preset", {"REGISTER", "UNDO"}
    preset: StringProperty()

    @in_words
    def execute(self, context):
        stored = own()
        if self.preset in SHIPPED:
            apply(context.scene.iclnuim, SHIPPED[self.preset])
        elif self.preset in stored:
            apply(context.scene.iclnuim, read_json(stored[self.preset]))
        else:
            raise InputError(f"a preset ({', '.join((*SHIPPED, *stored))})", found=self.preset)


class ICLNUIM_OT_preset_save(bpy.types.Operator):
    """Keep the settings as a preset of your own, in the extension's folder"""

    bl_idname, bl_label = "iclnuim.preset_save", "Save Preset"
    preset: StringProperty(name="Name", default="My preset")

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self)

    @in_words
    def execute(self, context):
        name = "".join(c for c in self.preset if c.isalnum() or c in " -_").strip()
        if not name or name in SHIPPED:
            raise InputError("a name of letters and digits that no shipped preset has", found=self.preset)
        write_json(
            session.user_folder("presets") / f"{name}.json", json.loads(json.dumps(values(context.scene.iclnuim)))
        )


class ICLNUIM_MT_presets(bpy.types.Menu):
    """Ready-made settings"""

    bl_idname, bl_label = "ICLNUIM_MT_presets", "Presets"

    def draw(self, context):
        for name in (*SHIPPED, *own()):
            self.layout.operator("iclnuim.preset", text=name).preset = name
        self.layout.separator()
        self.layout.operator("iclnuim.preset_save", text="Save as...")


register, unregister = bpy.utils.register_classes_factory(
    (ICLNUIM_OT_preset, ICLNUIM_OT_preset_save, ICLNUIM_MT_presets)
)
