"""The panel's settings as Blender properties, saved in the .blend with each scene. They are made
from the declared settings and registries, and converted to a render job.
"""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    StringProperty,
)
from bpy.types import Context, PropertyGroup

from ..blender.render import camera as keyed_camera
from ..errors import InputError
from ..evaluation.align import AlignmentSettings
from ..geometry.camera import PinholeCamera
from ..geometry.handheld_plan import PlanSettings
from ..geometry.scene_axes import UNITS_M, SceneReading
from ..job import RenderJob
from ..sequences.sequence_options import SequenceOptions
from ..settings import Setting, Settings, declared, setting
from ..shipped import SCENES, TRAJECTORIES
from . import state

#: An entry of an enum: value, name, tooltip.
Entry = tuple[str, str, str]
#: Choices other than built-in scenes and trajectories, by the number that is stored in a saved
#: .blend.
_OTHER_SCENES = {
    2: (
        "OPEN",
        "This File",
        "The scene in this window; a copy of it is saved in the output folder and rendered",
    ),
    3: (
        "FILE",
        "Another File",
        "A .blend, .glb, .gltf, .obj, .ply, .usd or .fbx; converted to z up and metres",
    ),
}
_OTHER_TRAJECTORIES = {
    4: (
        "FILE",
        "Trajectory File",
        "TUM, *.gt.freiburg, *.gt.sim, KITTI, EuRoC or POV-Ray; "
        "the format is detected by name and content",
    ),
    5: (
        "CAMERA",
        "Active Camera",
        "The animation of the scene's active camera, one pose per frame of the timeline",
    ),
}
_FILE_OF_POSES = (
    "Camera-to-world poses; right-handed unless the file is named *.gt.freiburg "
    "or starts like the released trajectories"
)
_OUT = (
    "raw/, clean/ and noisy/ are created in it. If empty: iclnuim next to the saved .blend; "
    "Render asks for a folder if it is not saved, and makes iclnuim in it"
)
#: Blender's integers have 32 bits.
_MAX_INT = 2**31 - 1
_AUTO = {0: ("AUTO", "Auto", "The default")}
_EQUATION_2 = "paper, equation 2"


@dataclass(frozen=True)
class PanelSettings(Settings):
    """Settings that only the panel has: where the trajectory starts, what is drawn, and which
    frames and sequences are written.
    """

    scale: float = setting(
        1.0, "factor on the trajectory's lengths", low=1e-3, high=1e3, source=_EQUATION_2
    )
    use_start: bool = setting(
        False,
        "move the trajectory so that its first pose is the one below",
        source=_EQUATION_2,
        label="Custom Start Pose",
    )
    start_location: tuple[float, float, float] = setting(
        (0.0, 0.0, 1.5),
        "position of the first pose, metres in Blender's world, z up",
        label="Start",
    )
    start_rotation: tuple[float, float, float] = setting(
        (math.pi / 2, 0.0, 0.0),
        "rotation of Blender's camera at the first pose, XYZ Euler; "
        "(90, 0, 0) degrees looks along +y",
        label="Rotation",
    )
    show_path: bool = setting(
        True,
        "draw the trajectory as a curve with camera frusta; it is never rendered",
        label="Show in 3D View",
    )
    write_clean: bool = setting(True, "write a sequence without noise", label="Clean")
    write_noisy: bool = setting(True, "write a sequence with the sensor's noise", label="Noisy")
    frames: str = setting(
        ":60",
        "poses to render, as A:B:S: from A to before B, every S-th (30 per second); "
        ":: means all, a number means one frame",
    )
    delta: str = setting(
        "1s",
        "distance between the two poses of an RPE pair: 30 (frames), 1s (seconds) or 0.5m (metres)",
        label="RPE Delta",
    )


#: Groups of declared settings in the panel -> prefix of their properties' names. If two groups have
#: the same setting, the later group's is used. Those of a plan are in the dialog of Make a Path.
_GROUPS: dict[type, str] = {
    PlanSettings: "",
    PanelSettings: "",
    AlignmentSettings: "align_",
    SequenceOptions: "",
    PinholeCamera: "",
    RenderJob: "",
    SceneReading: "scene_",
}
_SUBTYPES = {"textures": "DIR_PATH", "start_location": "TRANSLATION", "start_rotation": "EULER"}
#: Subtypes of units that Blender writes behind the number; other units are in the label.
_WRITTEN_UNITS = {"px": "PIXEL", "texels": "PIXEL"}
#: Properties that change the trajectory or how it lies in the scene.
OF_THE_TRAJECTORY = (
    "scene_source",
    "scene_file",
    "trajectory_source",
    "trajectory_file",
    "scale",
    "use_start",
    "start_location",
    "start_rotation",
)


def properties_of_this_file() -> dict[str, Any]:
    """Name -> property, of the settings that belong to this file or this machine.

    Presets do not change them.
    """
    scenes = _items(((s.name, s.title, s.description) for s in SCENES.values()), _OTHER_SCENES)
    paths = _items(((name, name, text) for name, text in TRAJECTORIES.items()), _OTHER_TRAJECTORIES)
    units = [(name, name, f"One unit of the file is {UNITS_M[name]:g} m") for name in UNITS_M]
    kinds = f"Scene file: {_OTHER_SCENES[3][2].partition(';')[0]}"
    estimate = "Estimated trajectory, camera to world, stamps in seconds (TUM and others)"
    truth = "Ground-truth trajectory; empty: the trajectory chosen above"
    return {
        "scene_source": EnumProperty(name="Scene", items=scenes),
        "scene_file": _file("File", kinds),
        **properties_of(SceneReading),
        "scene_unit": _choice(declared(SceneReading)["unit_m"], units),
        "trajectory_source": EnumProperty(name="Trajectory", items=paths, default="kt2"),
        "trajectory_file": _file("File", _FILE_OF_POSES),
        "out": _file("Output Folder", _OUT, "DIR_PATH"),
        "estimate": _file("Estimate", estimate),
        "truth": _file("Ground Truth", truth),
    }


def properties_of_a_preset() -> dict[str, Any]:
    """Name -> property, of all other settings."""
    noise = {"depth_noise": "released", "rgb_noise": "released"}
    groups = (PanelSettings, PinholeCamera, SequenceOptions, RenderJob, AlignmentSettings)
    found: dict[str, Any] = {}
    for group in groups:
        found |= properties_of(group, **noise)
    return found


def label_of(setting: str) -> str:
    """The panel's label of a setting of the library, for error messages."""
    for group in reversed(_GROUPS):
        if setting in declared(group):
            return declared(group)[setting].label
    files = properties_of_this_file()
    found = files.get(setting) or files.get(f"{setting}_source")
    return found.keywords["name"] if found else setting


class ICLNUIM_PG_settings(PropertyGroup):
    """The settings of one scene. The properties are created when the class is registered."""

    def has_own_lens(self) -> bool:
        """Whether the lens and the size are those of the active camera, and not of the panel."""
        return self.trajectory_source == "CAMERA" and self.id_data.camera is not None

    def camera(self) -> PinholeCamera:
        """K and image size, without the rounding of Blender's single-precision floats: the
        benchmark's fx is exact, other values have four decimals. With the active camera's animation
        they are those of its lens and of the render's size. Raises InputError if it is not a
        perspective camera.
        """
        if self.has_own_lens():
            own = keyed_camera.pinhole(self.id_data, self.id_data.camera)
            if own is None:
                kind = self.id_data.camera.data.type
                raise InputError("a perspective camera", found=kind, hint="another trajectory")
            numbers = {name: round(getattr(own, name), 4) for name in ("fx", "fy", "cx", "cy")}
            return replace(own, **numbers)
        exact = (self.width / 1.33, PinholeCamera().fx)
        fx = next((f for f in exact if abs(self.fx - f) < 5e-4), round(self.fx, 4))
        return PinholeCamera(**{**self.values_of(PinholeCamera), "fx": fx})

    def reading(self) -> SceneReading:
        """How a scene file is read: axes, units, textures."""
        if self.scene_source != "FILE":
            return SceneReading()
        return SceneReading(**self.values_of(SceneReading))

    def to_job(self, scene: str, trajectory: str) -> RenderJob:
        """The render job; `scene` and `trajectory` are built-in names or files (inputs.py).

        Raises InputError.
        """
        return RenderJob(
            sequence=trajectory if "/" in trajectory and "." not in trajectory else "own",
            scene=scene,
            trajectory=trajectory,
            camera=self.camera(),
            reading=self.reading(),
            **self.values_of(RenderJob),
        )

    def values_of(self, group: type) -> dict[str, Any]:
        """The values of a group of settings, by name."""
        return values_in(self, group)

    def sequences(self, out: Path) -> dict[str, Any] | None:
        """The sequences that the worker process writes (see sequences.writer.writer_of); None if
        none are chosen. Raises InputError.
        """
        if not (self.write_clean or self.write_noisy):
            return None
        options = SequenceOptions(**self.values_of(SequenceOptions))
        if not options.formats:
            hint = "switching Clean and Noisy off"
            raise InputError("one or more", setting="formats", found="none", hint=hint)
        variants = {}
        if self.write_clean:
            clean = options.changed(depth_noise="none", rgb_noise="none")
            variants[str(out / "clean")] = clean.to_dict()
        if self.write_noisy:
            variants[str(out / "noisy")] = options.to_dict()
        return {"formats": list(options.formats), "variants": variants}


def values_in(holder: Any, group: type) -> dict[str, Any]:
    """The values of a group of settings, by name, in the properties of a group or an operator."""
    return {s.name: _value(s, getattr(holder, name)) for name, s in settings_of(group).items()}


def settings_of(group: type) -> dict[str, Setting]:
    """Name of the property -> setting, of a group of declared settings.

    The name ends in the unit that the panel shows: exposure_s -> exposure_ms.
    """
    names = {}
    for s in declared(group).values():
        name = s.name.removesuffix(f"_{s.unit}")
        if s.shown[0] != s.unit:
            name += f"_{s.shown[0]}"
        names[_GROUPS[group] + name] = s
    return names


def properties_of(group: type, **defaults: Any) -> dict[str, Any]:
    """Name -> property, of a group.

    `defaults`: the panel's defaults where they differ from the declaration.
    """
    settings = settings_of(group).items()
    return {name: _property(s, defaults.get(name, s.default)) for name, s in settings}


def _property(s: Setting, default: Any) -> Any:
    more = _words(s)
    if s.choices is not None:
        # names of formats and channels are those of files and folders
        shown = str if s.length == 0 else state.sentence
        entries = [(v, shown(v), _sentence(about)) for v, about in s.choices.items()]
        return _choice(s, entries, default)
    if s.kind is bool and s.optional:
        return _choice(s, (("ON", "On", ""), ("OFF", "Off", "")))
    if s.kind is bool:
        return BoolProperty(default=default, **more)
    more["subtype"] = _SUBTYPES.get(s.name) or _WRITTEN_UNITS.get(s.shown[0], "NONE")
    if s.kind is str:
        return StringProperty(default=default or "", **more)
    if s.length is not None:
        return FloatVectorProperty(size=s.length, default=default, **more)
    unit, factor = s.shown
    if unit and unit not in _WRITTEN_UNITS:
        more["name"] += f" ({unit})"
    if math.isfinite(s.low):
        more["min"] = s.kind(s.low * factor)
    if math.isfinite(s.high):
        high = s.high * factor
        more["max"] = min(int(high), _MAX_INT) if s.kind is int else high
    if s.optional:
        more["min"] = 0  # 0 means the default
    default = s.kind((default or 0) * factor)
    if s.kind is int:
        return IntProperty(default=default, **more)
    return FloatProperty(default=default, precision=3, **more)


def _value(s: Setting, shown: Any) -> Any:
    """The value of a setting, from the value that its property shows."""
    if s.length == 0:
        return tuple(value for value in s.choices or () if value in shown)
    if s.kind is bool:
        return {"AUTO": None, "ON": True, "OFF": False}.get(shown, shown)
    if s.optional and shown in ("AUTO", "", 0):
        return None
    if isinstance(shown, str) and s.parse is not None:
        return s.parse(bpy.path.abspath(shown))
    return round(shown, 4) / s.shown[1] if s.kind is float else shown


def _words(s: Setting) -> dict[str, Any]:
    """The name and tooltip of a property: help and source."""
    description = _sentence(s.help)
    if s.source:
        description += f" ({s.source})"
    return {"name": s.label, "description": description}


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _choice(s: Setting, entries: Iterable[Entry], default: Any = None) -> Any:
    """The enum property of a setting; an enum of flags if several values are allowed."""
    if s.length == 0:
        flags = [(*entry, 1 << k) for k, entry in enumerate(entries)]
        return EnumProperty(items=flags, options={"ENUM_FLAG"}, default=set(default), **_words(s))
    items = _items(entries, _AUTO if s.optional else {})
    return EnumProperty(items=items, default=default or items[0][0], **_words(s))


def _items(entries: Iterable[Entry], own: Mapping[int, Entry]) -> list[tuple[str, str, str, int]]:
    """Items of an enum with the numbers that are stored in a .blend: `own` has fixed numbers,
    entries of a registry get the free ones.
    """
    free = (number for number in itertools.count() if number not in own)
    numbered = {**dict(zip(free, entries, strict=False)), **own}
    return [(*numbered[number], number) for number in sorted(numbered)]


def _file(name: str, description: str, subtype: str = "FILE_PATH") -> Any:
    return StringProperty(name=name, description=description, subtype=subtype)


def _trajectory_changed(self: PropertyGroup, context: Context) -> None:
    state.current().trajectory_changed(context)


def register() -> None:
    made = {**properties_of_this_file(), **properties_of_a_preset()}
    for name in OF_THE_TRAJECTORY:
        made[name].keywords["update"] = _trajectory_changed
    ICLNUIM_PG_settings.__annotations__ = made
    bpy.utils.register_class(ICLNUIM_PG_settings)
    bpy.types.Scene.iclnuim = bpy.props.PointerProperty(type=ICLNUIM_PG_settings)


def unregister() -> None:
    del bpy.types.Scene.iclnuim
    bpy.utils.unregister_class(ICLNUIM_PG_settings)
