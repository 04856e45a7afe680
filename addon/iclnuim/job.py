"""The frozen description of a render job, to and from JSON.

Panel, farm and worker exchange jobs in this form.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from . import shipped
from .channels import FURTHER, Channel, further_of
from .errors import InputError, StrPath
from .formats.files import read_bytes, read_json, sha256
from .geometry.camera import PinholeCamera, blender_from_pinhole
from .geometry.scene_axes import SceneReading
from .render_ways import Quality
from .sensor.exposure import Exposure
from .sensor.imu import ImuOnCamera
from .settings import Settings, declared, same_as, setting

SCHEMA_VERSION = 1
#: Values of settings that a job does not set. Baked light needs few samples: only reflections and
#: glass are sampled.
LIGHT_DEFAULTS = {
    "path": {"samples": 64, "denoise": True},
    "baked": {"samples": 1, "denoise": False},
}
#: Core-seconds that a bake of 2048 x 2048 (measured: 2047 x 2047) texels with 32 samples takes in
#: the living room (docs/measured/light.md).
_BAKE_CORE_S = 605.0
#: Files in the folder of a light map: the map, the layout of the surfaces in it, and what it was
#: baked from.
LIGHT_FILES = ("light.exr", "layout.npz", "recipe.json")


@dataclass(frozen=True)
class RenderJob(Settings):
    """All settings that determine the pixels of a run, and nothing else: not the requested frames,
    the folder or the threads.

    `scene` is a shipped scene's name or a file; `trajectory` is a shipped name such as
    `living_room/kt2` or a file. `reading`: axes and units of a scene file. `imu`: with one, the
    shutter follows its path. `reading`, `quality`, `ground_truth`, `channels`, `glass` and `imu` are
    left out of the recipe if they have their default values, so that the recipes of older runs stay
    the same.
    """

    group: ClassVar[str] = "a render job"

    sequence: str
    scene: str
    trajectory: str
    camera: PinholeCamera = field(default_factory=PinholeCamera)
    light: str = setting(
        "baked",
        "how light is computed",
        choices={
            "baked": "diffuse light from a map that is baked once per scene; "
            "reflections and glass are traced",
            "path": "every frame is fully path traced; slow, correct for moving objects",
            "auto": "the cheapest of both that holds the quality, the default of the command "
            "line; built-in scenes that ship with a light map: baked",
        },
        source="baked: paper, section III",
    )
    quality: str = setting(
        "40dB",
        "what light auto holds for a scene without a shipped light map: a PSNR such as 40dB, in "
        "the least time, or a time such as 10min, with the best PSNR",
    )
    samples: int | None = setting(
        None, "rays per pixel; default: 1 baked, 64 path traced", low=1, high=65536
    )
    denoise: bool | None = setting(
        None, "OpenImageDenoise; default: on for path tracing if this Blender has it"
    )
    antialias: bool = setting(
        False,
        "filter RGB over 1.5 pixels; Z is still that of the pixel centre; several samples filter "
        "textures, too, which then have no mipmaps",
        source="off in the paper, section II",
    )
    mipmaps: bool = setting(
        True,
        "filter textures for the distance at which they are seen; "
        "without, the pattern of distant cloth changes from frame to frame",
        source="Williams 1983; not in the paper",
    )
    lambertian: bool = setting(False, "render without reflections")
    map_size: int = setting(2048, "side of the light map", unit="texels", low=16, high=16384)
    map_samples: int = setting(
        32, "samples per texel of the light map and per light source", low=2, high=65536
    )
    seed: int = setting(0, "seed of Cycles' samples and of the noise", low=0, high=2**31 - 1)
    exposure_s: float = same_as(Exposure, "exposure_s")
    readout_s: float = same_as(Exposure, "readout_s")
    reading: SceneReading = field(default_factory=SceneReading)
    ground_truth: bool = setting(
        False,
        "also write instances, classes and normals of every pixel, "
        "and objects.json (docs/guide/ground_truth.md)",
    )
    channels: tuple[str, ...] = setting(
        (),
        "also write this image of every frame; the option may be given several times",
        choices=lambda: {name: channel.description for name, channel in FURTHER.items()},
        option="--channel",
    )
    glass: str = setting(
        "surface",
        "depth of pixels that show a pane of glass (a Transparent BSDF)",
        choices={
            "surface": "depth of the pane, as in the original",
            "none": "0 (missing), as most real sensors measure",
            "behind": "depth of the surface seen through the pane",
        },
    )

    imu: ImuOnCamera = field(default_factory=ImuOnCamera)

    def __post_init__(self) -> None:
        known = declared(RenderJob)
        object.__setattr__(self, "camera", PinholeCamera.of(self.camera))
        is_auto = known["light"].checked(self.light) == "auto"
        if is_auto and shipped.is_scene(self.scene) and shipped.has_light(self.scene):
            object.__setattr__(self, "light", "baked")
        for name, value in LIGHT_DEFAULTS.get(self.light, {}).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name, declaration in known.items():
            # the value keeps the type it has in the recipe: 0 does not become 0.0
            declaration.checked(getattr(self, name))
        if self.antialias and (self.samples or 1) > 1:  # these filter textures, too
            object.__setattr__(self, "mipmaps", False)
        for name in ("sequence", "scene", "trajectory"):
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InputError("text", setting=name, found=getattr(self, name))
        blender_from_pinhole(self.camera)
        Quality.of(self.quality)
        implied = {c.name for c in FURTHER.values() if c.ground_truth and self.ground_truth}
        chosen = tuple(n for n in FURTHER if n in self.channels and n not in implied)
        object.__setattr__(self, "channels", chosen)

    @property
    def further(self) -> tuple[Channel, ...]:
        """The channels of every frame besides colour and depth."""
        return further_of(vars(self))

    @property
    def exposure(self) -> Exposure:
        """The exposure and readout time of the shutter."""
        return Exposure(self.exposure_s, self.readout_s)

    def to_dict(self) -> dict[str, Any]:
        """The inverse of from_dict."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        late = {
            "reading": values.pop("reading").to_dict(),
            "ground_truth": values.pop("ground_truth"),
            "channels": list(values.pop("channels")),
        }
        if imu := values.pop("imu"):
            late["imu"] = imu.to_dict()
        for name in ("glass", "quality"):
            value = values.pop(name)
            if value != declared(RenderJob)[name].default:
                late[name] = value
        made = {"schema_version": SCHEMA_VERSION, **values, "camera": self.camera.to_dict()}
        return made | {key: value for key, value in late.items() if value}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "RenderJob":
        """The job of a run's recipe.

        Raises InputError for unknown keys, a newer schema_version, or values out of range.
        """
        if isinstance(content, Mapping) and "schema_version" in content:
            content = dict(content)
            if (version := content.pop("schema_version")) != SCHEMA_VERSION:
                raise InputError(
                    f"schema_version {SCHEMA_VERSION}", found=version, hint="a newer iclnuim"
                )
        return super().from_dict(content)

    def changed(self, **settings: Any) -> "RenderJob":
        """The same job with other settings; None means unchanged.

        If `light` changes, samples and denoise get the defaults of the new value.
        """
        settings = {key: value for key, value in settings.items() if value is not None}
        if settings.get("light", self.light) != self.light:
            settings = {"samples": None, "denoise": None, **settings}
        return replace(self, **settings)


def bake_core_s(job: RenderJob) -> float:
    """Estimated core-seconds to bake the light map of a job, from its texels and samples and those
    of the coarse map. Scenes differ.
    """
    # fine map: lamps and one bounce; coarse map: lamps and three bounces
    fine = job.map_size**2 * job.map_samples
    coarse = min(1024, job.map_size) ** 2 * 16
    return _BAKE_CORE_S * (2 * fine + 4 * coarse) / (2 * 2048**2 * 32 + 4 * 1024**2 * 16)


def shipped_light(job: RenderJob) -> Path | None:
    """The folder of the light map that is shipped with the job's built-in scene, for any seed. None
    for other scenes, for other settings of the map, and if the scene's file is not the one that was
    baked.
    """
    if job.scene not in shipped.SCENE_NAMES or job.lambertian:
        return None
    room = shipped.folder("blend") / f"{job.scene}.blend"
    folder = room.parent / "light" / job.scene
    if not all(file.is_file() for file in (room, *(folder / name for name in LIGHT_FILES))):
        return None
    fits = read_json(folder / LIGHT_FILES[-1]).get("fits", {})
    if (fits.get("size"), fits.get("samples")) != (job.map_size, job.map_samples):
        return None
    return folder if fits.get("scene_sha256") == sha256(read_bytes(room)) else None


def shipped_job(sequence: str) -> RenderJob:
    """The job of a built-in sequence, such as `kt2` or `office/kt0`."""
    name = shipped.full_name(sequence)
    return RenderJob(sequence=name, scene=name.split("/")[0], trajectory=name)


def read_recipe(path: StrPath) -> RenderJob:
    """The job of a recipe file (or of a run's sequence.json). Its paths are relative to the file
    and may not leave its folder.

    Raises InputError with the file's name for invalid content.
    """
    path = Path(path)
    content = read_json(path)
    if isinstance(content.get("job"), dict):
        content = content["job"]
    content.setdefault("sequence", path.stem)
    try:
        job = RenderJob.from_dict(content)
    except InputError as error:
        raise error.at(path) from None
    if PurePosixPath(job.sequence).is_absolute() or ".." in re.split(r"[/\\]", job.sequence):
        raise InputError("a sequence named such as living_room/kt2", path=path, found=job.sequence)
    reading = job.reading
    if reading.textures:
        reading = replace(reading, textures=_inside(path, reading.textures, ()))
    return replace(
        job,
        scene=_inside(path, job.scene, shipped.SCENE_NAMES),
        trajectory=_inside(path, job.trajectory, shipped.sequence_names()),
        reading=reading,
    )


def _inside(recipe: Path, name: str, shipped_names: Iterable[str]) -> str:
    """A shipped name is returned unchanged.

    A path is relative to the recipe's folder and may not leave it.
    """
    if name in shipped_names:
        return name
    folder = recipe.resolve().parent
    target = (folder / name).resolve()
    if not target.is_relative_to(folder):
        hint = "moving the file into the recipe's folder"
        raise InputError("paths inside the recipe's own folder", path=recipe, found=name, hint=hint)
    return str(target)
