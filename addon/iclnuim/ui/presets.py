"""Presets: built-in ones, and the user's as JSON files in the extension's user folder. A preset
contains only values that differ from the defaults.
"""

from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty
from bpy.types import Context, Menu, Operator, PropertyGroup

from ..errors import InputError
from ..formats.files import read_json, write_json
from ..geometry.camera import PinholeCamera
from . import state
from .properties import properties_of_a_preset
from .state import operator

_SMALL = PinholeCamera.parse("320x240").to_dict()
_PRESETS: list[tuple[str, dict[str, Any]]] = [
    ("Benchmark", {}),
    ("Quick look", {**_SMALL, "light": "path", "samples": 4, "frames": "::60"}),
    ("Reference, path traced", {"light": "path", "samples": 256, "frames": "::"}),
]
BUILT_IN = dict(_PRESETS)


def values(settings: PropertyGroup) -> dict[str, Any]:
    """The values that differ from the defaults, ready for JSON."""
    found = {}
    for name in filter(settings.is_property_set, properties_of_a_preset()):
        value = getattr(settings, name)
        if isinstance(value, set):
            value = sorted(value)
        elif not isinstance(value, bool | int | float | str):
            value = list(value)
        found[name] = value
    return found


def apply(settings: PropertyGroup, chosen: dict[str, Any]) -> None:
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
            if isinstance(getattr(settings, name), set):
                value = set(value)
            setattr(settings, name, value)
        except (TypeError, ValueError) as error:
            raise InputError("a value that fits", setting=name, found=error) from None


def own() -> dict[str, Path]:
    """The files of the user's presets by name."""
    return {path.stem: path for path in sorted(state.user_folder("presets").glob("*.json"))}


@operator("Use Preset", undo=True, preset=StringProperty())
def preset(self: Operator, context: Context) -> None:
    """Use the settings of a preset. Folder, files, scene and trajectory do not change"""
    stored = own()
    if self.preset not in (*BUILT_IN, *stored):
        raise InputError(f"a preset ({', '.join((*BUILT_IN, *stored))})", found=self.preset)
    chosen = BUILT_IN.get(self.preset)
    if chosen is None:
        chosen = read_json(stored[self.preset])
    apply(context.scene.iclnuim, chosen)


@operator(
    "Save Preset",
    invoke=lambda self, context, event: context.window_manager.invoke_props_dialog(self),
    preset=StringProperty(name="Name", default="My preset"),
)
def preset_save(self: Operator, context: Context) -> None:
    """Save the current settings as a new preset, in the extension's user folder"""
    name = "".join(c for c in self.preset if c.isalnum() or c in " -_").strip()
    if not name or name in BUILT_IN:
        expected = "a name of letters and digits that no built-in preset has"
        raise InputError(expected, found=self.preset)
    write_json(state.user_folder("presets") / f"{name}.json", values(context.scene.iclnuim))


class ICLNUIM_MT_presets(Menu):
    """Load or save settings as a preset"""

    bl_idname = "ICLNUIM_MT_presets"
    bl_label = "Presets"

    def draw(self, context: Context) -> None:
        for name in (*BUILT_IN, *own()):
            self.layout.operator("iclnuim.preset", text=name).preset = name
        self.layout.separator()
        self.layout.operator("iclnuim.preset_save", text="Save as...")


register, unregister = bpy.utils.register_classes_factory((preset, preset_save, ICLNUIM_MT_presets))
