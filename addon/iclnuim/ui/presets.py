"""Presets: built-in presets, and the user's presets as JSON files in the extension's user folder. A
preset contains only values that differ
from the defaults.
"""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ..errors import InputError
from ..formats.files import read_json, write_json
from ..geometry.camera import PinholeCamera
from . import state
from .properties import properties_of_a_preset
from .state import operator

BUILT_IN: dict[str, dict[str, Any]] = {
    "Benchmark": {},
    "Quick look": {
        **PinholeCamera.parse("320x240").to_dict(),
        "light": "path",
        "samples": 4,
        "frames": "::60",
    },
    "Reference, path traced": {"light": "path", "samples": 256, "frames": "::"},
}


def values(settings: bpy.types.PropertyGroup) -> dict[str, Any]:
    """The values that differ from the defaults, ready for JSON."""
    found = {
        name: getattr(settings, name)
        for name in properties_of_a_preset()
        if settings.is_property_set(name)
    }
    for name, value in found.items():
        if not isinstance(value, bool | int | float | str):
            found[name] = sorted(value) if isinstance(value, set) else list(value)
    return found


def apply(settings: bpy.types.PropertyGroup, chosen: dict[str, Any]) -> None:
    """Set the values of a preset, and all other settings to their defaults.

    Raises InputError for an unknown name or value.
    """
    known = properties_of_a_preset()
    unknown = sorted(set(chosen) - set(known))
    if unknown:
        raise InputError(f"a preset of {', '.join(known)}", found=", ".join(unknown))
    for name in known:
        settings.property_unset(name)
    for name, value in chosen.items():
        try:
            setattr(
                settings, name, set(value) if isinstance(getattr(settings, name), set) else value
            )
        except (TypeError, ValueError) as error:
            raise InputError("a value that fits", setting=name, found=error) from None


def own() -> dict[str, Path]:
    """The files of the user's presets by name."""
    return {path.stem: path for path in sorted(state.user_folder("presets").glob("*.json"))}


@operator("Use Preset", undo=True, preset=StringProperty())
def preset(self, context):
    """Use the settings of a preset. Folder, files, scene and trajectory do not change"""
    stored = own()
    if self.preset not in (*BUILT_IN, *stored):
        raise InputError(f"a preset ({', '.join((*BUILT_IN, *stored))})", found=self.preset)
    apply(
        context.scene.iclnuim,
        BUILT_IN[self.preset] if self.preset in BUILT_IN else read_json(stored[self.preset]),
    )


@operator(
    "Save Preset",
    invoke=lambda self, context, event: context.window_manager.invoke_props_dialog(self),
    preset=StringProperty(name="Name", default="My preset"),
)
def preset_save(self, context):
    """Save the current settings as a new preset, in the extension's user folder"""
    name = "".join(c for c in self.preset if c.isalnum() or c in " -_").strip()
    if not name or name in BUILT_IN:
        raise InputError(
            "a name of letters and digits that no built-in preset has", found=self.preset
        )
    write_json(state.user_folder("presets") / f"{name}.json", values(context.scene.iclnuim))


class ICLNUIM_MT_presets(bpy.types.Menu):
    """Load or save settings as a preset"""

    bl_idname, bl_label = "ICLNUIM_MT_presets", "Presets"

    def draw(self, context):
        for name in (*BUILT_IN, *own()):
            self.layout.operator("iclnuim.preset", text=name).preset = name
        self.layout.separator()
        self.layout.operator("iclnuim.preset_save", text="Save as...")


register, unregister = bpy.utils.register_classes_factory((preset, preset_save, ICLNUIM_MT_presets))
